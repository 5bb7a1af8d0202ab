"""Plant each fault of `faults.py` in a copy of the project and check that the named tests notice.

Run by `make mutations`; takes a few minutes. Exit status 1 when a fault goes unnoticed, or when the
tests fail without it.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from faults import FAULTS, Fault

ROOT = Path(__file__).resolve().parents[2]


def copy_project(target: Path) -> None:
    """The files git knows or would add, as they are in the working tree."""
    listing = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT, check=True, capture_output=True, text=True,
    ).stdout  # fmt: skip
    for name in filter(None, listing.split("\0")):
        if (ROOT / name).is_file():
            (target / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, target / name)


def build_native(project: Path, build: Path) -> None:
    """Build the native core of `project` into `build` (incremental)."""
    cmake_dir = subprocess.run(
        [sys.executable, "-m", "nanobind", "--cmake_dir"],
        check=True, capture_output=True, text=True,
    ).stdout.strip()  # fmt: skip
    tools = Path(sys.executable).parent
    subprocess.run(
        [tools / "cmake", "-S", project / "native", "-B", build, "-G", "Ninja",
         f"-DCMAKE_MAKE_PROGRAM={tools / 'ninja'}", "-DCMAKE_BUILD_TYPE=Release",
         f"-DPython_EXECUTABLE={sys.executable}", f"-Dnanobind_DIR={cmake_dir}"],
        check=True, stdout=subprocess.DEVNULL,
    )  # fmt: skip
    subprocess.run([tools / "cmake", "--build", build], check=True, stdout=subprocess.DEVNULL)


def passes(project: Path, build: Path, tests: tuple[str, ...]) -> bool:
    """Whether all of `tests` pass in `project` with the native core in `build`."""
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(build), str(project)])}
    outcome = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", *tests],
        cwd=project, env=environment, capture_output=True, text=True, check=False,
    )  # fmt: skip
    if outcome.returncode not in (0, 1):
        raise RuntimeError(f"pytest could not run {tests}:\n{outcome.stdout}{outcome.stderr}")
    return outcome.returncode == 0


def noticed(fault: Fault, project: Path, build: Path) -> bool:
    """Plant the fault, run its tests, take it out again."""
    place = project / fault.file
    sound = place.read_text()
    place.write_text(sound.replace(fault.sound, fault.faulty))
    native = fault.file.startswith("native/")
    try:
        if native:
            build_native(project, build)
        return all(not passes(project, build, (test,)) for test in fault.noticed_by)
    finally:
        place.write_text(sound)
        if native:
            build_native(project, build)


def main() -> int:
    """Plant all faults, or those whose name contains an argument."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("only", nargs="*", help="parts of the names of faults to plant")
    only = parser.parse_args().only
    chosen = [f for f in FAULTS if not only or any(part in f.name for part in only)]
    with tempfile.TemporaryDirectory() as folder:
        project, build = Path(folder) / "project", Path(folder) / "native"
        copy_project(project)
        build_native(project, build)
        tests = tuple(dict.fromkeys(test for fault in chosen for test in fault.noticed_by))
        if not passes(project, build, tests):
            print("the tests fail without any fault", file=sys.stderr)
            return 1
        missed = []
        for fault in chosen:
            seen = noticed(fault, project, build)
            print(f"{'noticed' if seen else 'MISSED '}  {fault.name}", flush=True)
            if not seen:
                missed.append(fault)
    print(f"{len(chosen) - len(missed)} of {len(chosen)} planted faults noticed")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
