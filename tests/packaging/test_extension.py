"""The extension: exactly what it should hold, installed, used and removed in a scratch Blender."""

import json
import os
import re
import subprocess
import sys
import tomllib
import zipfile
from importlib.metadata import requires
from pathlib import Path

import pytest
from packaging.tags import compatible_tags, cpython_tags
from packaging.utils import parse_wheel_filename
from project_files import ROOT, make, tracked_files

import volillum_addon

# The archive grows with what it bundles; beyond this the plots should do without matplotlib.
LARGEST_BYTES = 60e6


@pytest.fixture(scope="module")
def archive() -> Path:
    make("extension")
    (path,) = (ROOT / "dist").glob("*.zip")
    return path


@pytest.fixture(scope="module")
def manifest(archive: Path) -> dict[str, object]:
    with zipfile.ZipFile(archive) as contents:
        return tomllib.loads(contents.read("blender_manifest.toml").decode())


def files(archive: Path) -> set[str]:
    with zipfile.ZipFile(archive) as contents:
        return {name for name in contents.namelist() if not name.endswith("/")}


def wheels(archive: Path) -> set[str]:
    return {name for name in files(archive) if name.startswith("wheels/")}


def test_the_archive_holds_the_tracked_files_and_the_wheels(archive: Path) -> None:
    expected = {
        str(path)
        for path in tracked_files()
        if path.parts[0] in ("volillum_addon", "presets")
        or str(path) in ("__init__.py", "LICENSE", "blender_manifest.toml")
    }
    assert files(archive) - wheels(archive) == expected


def test_the_wheels_are_what_blender_lacks(archive: Path) -> None:
    # Written out on purpose: a new dependency of a dependency is to be looked at.
    assert {re.split(r"[/-]", name)[1] for name in wheels(archive)} == {
        "volillum_native",
        "OpenEXR".lower(),
        "flip_evaluator",
        "matplotlib",
        *("contourpy", "cycler", "fonttools", "kiwisolver", "packaging", "pillow", "pyparsing"),
        *("python_dateutil", "tzdata"),
        *("nibabel", "pydicom", "pynrrd", "tifffile"),
    }


def test_every_blenders_python_finds_its_wheels(archive: Path) -> None:
    # Blender's own builds have 3.13, Debian's 3.14; both unpack only the wheels of their own.
    named = {python: set[str]() for python in ((3, 13), (3, 14))}
    for wheel in wheels(archive):
        name, _, _, kinds = parse_wheel_filename(wheel.removeprefix("wheels/"))
        for python, found in named.items():
            if kinds & {*cpython_tags(python), *compatible_tags(python)}:
                assert name not in found, f"two wheels of {name} for {python}"
                found.add(name)
    assert named[3, 13] - named[3, 14] == {"flip-evaluator"}
    assert not named[3, 14] - named[3, 13]


def test_the_manifest_lists_every_wheel(archive: Path, manifest: dict[str, object]) -> None:
    listed = manifest["wheels"]
    assert isinstance(listed, list)
    assert {str(name).removeprefix("./") for name in listed} == wheels(archive)


def test_the_archive_obeys_the_extension_sites_rules(
    archive: Path, manifest: dict[str, object]
) -> None:
    assert manifest["license"] == ["SPDX:GPL-3.0-or-later"]
    assert "blender" not in str(manifest["name"]).lower()
    assert archive.stat().st_size < LARGEST_BYTES


def test_the_versions_agree() -> None:
    def read(name: str) -> dict[str, dict[str, object]]:
        return tomllib.loads((ROOT / name).read_text())

    version = read("blender_manifest.toml")["version"]
    native = read("native/pyproject.toml")["tool"]["scikit-build"]
    assert isinstance(native, dict)
    assert version == read("pyproject.toml")["project"]["version"]
    assert version == native["metadata"]["version"]["base"]
    assert version == volillum_addon.__version__


def test_blender_brings_what_is_not_bundled() -> None:
    # The bundle leaves out all that bpy depends on, because Blender has it inside: so numpy, which
    # everything here needs, must be among it.
    assert any(text.startswith("numpy") for text in requires("bpy") or [])


def test_install_enable_use_disable_remove(archive: Path, tmp_path: Path) -> None:
    script = Path(__file__).with_name("blender_session.py")
    # No PYTHONPATH: it would win over what the extension brings.
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    environment["BLENDER_USER_RESOURCES"] = str(tmp_path / "user")
    for arguments in (["install", archive], ["use", tmp_path / "result.json"]):
        done = subprocess.run(
            [sys.executable, script, *arguments],
            cwd=tmp_path,
            env=environment,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stdout + done.stderr
    result = json.loads((tmp_path / "result.json").read_text())
    installed = str(tmp_path / "user" / "extensions")
    assert {name: path for name, path in result["modules"].items() if installed not in path} == {}
    assert result["left_over"] == []
