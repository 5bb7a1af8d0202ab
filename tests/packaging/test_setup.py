"""What a fresh machine needs is found, or the one line that says what is missing is printed."""

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from project_files import ROOT

FIND_PYTHON = ROOT / "tools" / "find_python.sh"
SYSTEM_TOOLS = ("which", "env", "sh", "cat", "cksum")


def executable(path: Path, body: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"#!/bin/sh\n{body}\n")
    path.chmod(0o755)
    return path


@pytest.fixture
def bare(tmp_path: Path) -> dict[str, str]:
    """An environment with a home and a PATH that have no Python at all."""
    tools = tmp_path / "bin"
    tools.mkdir()
    for name in SYSTEM_TOOLS:
        (tools / name).symlink_to(f"/usr/bin/{name}")
    (tmp_path / "home").mkdir()
    return {"PATH": str(tools), "HOME": str(tmp_path / "home")}


def find(environment: dict[str, str]) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [FIND_PYTHON], env=environment, capture_output=True, text=True, check=False
    )


# The interpreter that this environment was made from: a real CPython 3.13 with its headers.
REAL = Path(sys.base_prefix) / "bin" / "python3.13"


def test_pythons_are_found_wherever_they_may_be(bare: dict[str, str]) -> None:
    home, path = Path(bare["HOME"]), Path(bare["PATH"])
    # From the last place that is looked at to the first.
    executable(home / ".local/bin/uv", f'[ "$*" = "python find 3.13" ] && echo {REAL}')
    assert find(bare).stdout.strip() == str(REAL)
    pyenv = executable(home / ".pyenv/versions/3.13.7/bin/python3.13", f'exec {REAL} "$@"')
    assert find(bare).returncode == 0
    pyenv.unlink()
    (home / ".local/bin/uv").unlink()
    assert find(bare).returncode == 1
    (path / "python3.13").symlink_to(REAL)
    assert find(bare).returncode == 0
    (path / "python3.13").unlink()
    assert find(bare | {"PYTHON": str(REAL)}).stdout.strip() == str(REAL)


def test_a_shim_that_refuses_to_run_is_passed_over(bare: dict[str, str]) -> None:
    home = Path(bare["HOME"])
    executable(Path(bare["PATH"]) / "python3.13", "echo 'pyenv: not installed' >&2; exit 127")
    refused = find(bare)
    assert refused.returncode == 1
    assert "does not run" in refused.stderr
    executable(home / ".pyenv/versions/3.13.0/bin/python3.13", f'exec {REAL} "$@"')
    assert find(bare).returncode == 0


def test_another_version_is_named_in_one_line(bare: dict[str, str]) -> None:
    old = executable(Path(bare["HOME"]) / "old", "echo is cpython 3.11")
    result = find(bare | {"PYTHON": str(old)})
    assert result.returncode == 1
    assert result.stdout == ""
    (line,) = result.stderr.splitlines()
    assert line.startswith("no usable CPython 3.13")
    assert "old is cpython 3.11; install one" in line
    assert line.endswith("make PYTHON=/path/to/python3.13")


def test_a_missing_compiler_is_named_before_anything_is_fetched(
    bare: dict[str, str], tmp_path: Path
) -> None:
    checkout = tmp_path / "checkout"
    (checkout / "tools").mkdir(parents=True)
    for name in ("requirements.lock", "tools/make_environment.sh", "tools/find_python.sh"):
        (checkout / name).symlink_to(ROOT / name)
    done = subprocess.run(
        ["tools/make_environment.sh"],
        cwd=checkout,
        env=bare,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 1
    (line,) = done.stderr.splitlines()
    assert line.startswith("set-up failed: no C++ compiler")
    assert {path.name for path in checkout.iterdir()} == {"requirements.lock", "tools"}


def test_the_lock_covers_the_project_with_hashes() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    wanted = project["project"]["dependencies"] + project["dependency-groups"]["dev"]
    lock = (ROOT / "requirements.lock").read_text()
    pins = dict(re.findall(r"^([\w.-]+)==([\w.]+)", lock, re.MULTILINE))
    for requirement in map(Requirement, wanted):
        assert pins[canonicalize_name(requirement.name)] in requirement.specifier
    entries = re.split(r"^(?=\S+==)", lock, flags=re.MULTILINE)[1:]
    assert [entry.splitlines()[0] for entry in entries if "--hash=sha256:" not in entry] == []


def test_make_alone_explains_the_targets() -> None:
    environment = {key: value for key, value in os.environ.items() if not key.startswith("MAKE")}
    text = subprocess.run(
        ["make"], cwd=ROOT, env=environment, capture_output=True, text=True, check=True
    ).stdout
    for target in ("test", "demo", "bench", "extension", "window", "lint"):
        assert f"make {target} " in text
