"""The native core's wheel serves every CPython from 3.12 on and every x86-64 machine."""

import platform
import re
import subprocess
import sys
import tomllib
import zipfile
from importlib.metadata import version
from pathlib import Path

import pytest
from expected_skips import skip
from packaging.requirements import Requirement
from packaging.utils import parse_wheel_filename
from project_files import ROOT, make

# Registers that plain x86-64 lacks; a function that names one must be a dispatched version: chosen
# by the loader, by in_packs, by the transforms for the size of their vectors, or, where its own
# name ends in a level, by the function beside it.
WIDE_REGISTER = re.compile(r"%[yz]mm\d")
DISPATCHED = re.compile(
    r"arch_x86_64_v[34]|pack_detail6run_v[34]I|[a-z]_v[34]E|BytesILi(?:32|64)EE"
)
FUNCTION = re.compile(r"^[0-9a-f]+ <(.+)>:$")


def needs_x86_64_linux() -> None:
    """Skips elsewhere: the levels, and objdump's names of them, are of x86-64 and Linux."""
    if platform.machine() != "x86_64" or sys.platform != "linux":
        skip("x86-64 Linux")


@pytest.fixture(scope="module")
def wheel() -> Path:
    make("native")
    (path,) = (ROOT / "wheels").glob("volillum_native-*.whl")
    return path


def wide_functions(*objects: Path) -> set[str]:
    """The functions in these object files or archives that use registers beyond plain x86-64."""
    listing = subprocess.run(
        ["objdump", "--disassemble", "--no-show-raw-insn", *objects],
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    found, function = set(), ""
    for line in listing.splitlines():
        if head := FUNCTION.match(line):
            function = head[1]
        elif WIDE_REGISTER.search(line):
            found.add(function)
    return found


def test_one_wheel_serves_all_pythons(wheel: Path) -> None:
    _, wheel_version, _, tags = parse_wheel_filename(wheel.name)
    assert {(tag.interpreter, tag.abi) for tag in tags} == {("cp312", "abi3")}
    # A local part, so that Blender replaces an older build of the same version.
    assert wheel_version.local
    with zipfile.ZipFile(wheel) as contents:
        names = {name for name in contents.namelist() if ".dist-info/" not in name}
    assert names == {"volillum_native.abi3.so", "volillum_native-stubs/__init__.pyi"}


def test_the_stub_has_types_and_docstrings(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as contents:
        stub = contents.read("volillum_native-stubs/__init__.pyi").decode()
    assert "def instruction_set() -> str:" in stub
    assert "vector instructions" in stub


@pytest.mark.usefixtures("wheel")
def test_only_dispatched_code_needs_more_than_plain_x86_64() -> None:
    needs_x86_64_linux()
    objects = sorted((ROOT / "native" / "build").glob("*/**/*.[oa]"))
    assert objects
    assert {name for name in wide_functions(*objects) if not DISPATCHED.search(name)} == set()


def test_a_dispatched_kernel_exists_once_per_level(tmp_path: Path) -> None:
    needs_x86_64_linux()
    source = tmp_path / "scale.cpp"
    source.write_text(
        '#include "volillum/cpu.h"\n'
        "VOLILLUM_DISPATCH void scale(float *x, int n) "
        "{ for (int i = 0; i < n; ++i) x[i] *= 2.0f; }\n"
    )
    compiled = tmp_path / "scale.o"
    include = ROOT / "native" / "include"
    command = ["c++", "-std=c++20", "-O3", f"-I{include}", "-c", source, "-o", compiled]
    subprocess.run(command, check=True)
    wide = wide_functions(compiled)
    assert {DISPATCHED.search(name)[0] for name in wide if DISPATCHED.search(name)} == {
        "arch_x86_64_v3",
        "arch_x86_64_v4",
    }
    assert all(DISPATCHED.search(name) for name in wide)


def test_instruction_set_is_the_best_of_this_machine() -> None:
    needs_x86_64_linux()
    import volillum_native

    level = volillum_native.instruction_set()
    flags = Path("/proc/cpuinfo").read_text().split()
    expected = "baseline"
    if {"avx2", "bmi1", "bmi2", "f16c", "fma", "movbe"} <= set(flags):
        expected = "x86-64-v3"
        if {"avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl"} <= set(flags):
            expected = "x86-64-v4"
    assert level == expected


def test_the_build_tools_are_the_locked_ones() -> None:
    # The wheel is built without isolation: what native/pyproject.toml asks for is what is there.
    native = tomllib.loads((ROOT / "native" / "pyproject.toml").read_text())
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    for text in native["build-system"]["requires"] + project["build-system"]["requires"]:
        requirement = Requirement(text)
        assert version(requirement.name) in requirement.specifier
