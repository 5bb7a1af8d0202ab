"""Builds dist/volillum-<version>-<platform>.zip with Blender's own builder, and validates it.

The extension is staged in build/extension: the package, the presets and the wheels of what it needs
at run time and Blender lacks. What that is follows from pyproject.toml: the dependencies, and
theirs in turn, without bpy and what bpy depends on, which Blender has inside. Compiled wheels are
brought for each Python that Blender is built with; Blender unpacks those of its own.
"""

import hashlib
import importlib.metadata
import importlib.util
import re
import shutil
import subprocess
import sys
import sysconfig
import tomllib
from pathlib import Path

from packaging.markers import default_environment
from packaging.requirements import Requirement
from packaging.tags import Tag, compatible_tags, cpython_tags
from packaging.utils import canonicalize_name, parse_wheel_filename

ROOT = Path(__file__).resolve().parents[1]
STAGE = ROOT / "build" / "extension"
DIST = ROOT / "dist"
WHEELS = ROOT / "wheels"
# Blender's own builds have the first, Debian's the second.
PYTHONS = ((3, 13), (3, 14))
# Published for the first Python alone. Only reports could use it, and nothing loads it unasked.
FIRST_PYTHON_ONLY = {"flip-evaluator"}
# Compiled too, but its one pure wheel serves every Python and weighs a tenth of two of those.
PURE = {"fonttools"}
# Copied whole; the manifest and the wheels are added.
CONTENTS = ("__init__.py", "LICENSE", "presets", "volillum_addon")
# Python's name of a platform (of a wheel built here) -> Blender's.
PLATFORMS = {
    "linux-x86_64": "linux-x64",
    "linux-aarch64": "linux-arm64",
    "win-amd64": "windows-x64",
    "win-arm64": "windows-arm64",
}


def platform() -> str:
    """This machine's platform as Blender names it."""
    name = sysconfig.get_platform()
    if name.startswith("macosx-"):
        return "macos-arm64" if name.endswith("arm64") else "macos-x64"
    if name not in PLATFORMS:
        raise ValueError(f"platform is {name}; expected one of {', '.join(PLATFORMS)}, or macOS")
    return PLATFORMS[name]


def closure(requirements: list[str]) -> set[str]:
    """The names of installed distributions that the requirements need, themselves included."""
    environment = default_environment() | {"extra": ""}
    found: set[str] = set()
    waiting = [Requirement(text) for text in requirements]
    while waiting:
        requirement = waiting.pop()
        name = canonicalize_name(requirement.name)
        if name in found or (requirement.marker and not requirement.marker.evaluate(environment)):
            continue
        found.add(name)
        waiting += [Requirement(text) for text in importlib.metadata.requires(name) or []]
    return found


def bundled() -> set[str]:
    """What the extension brings with it, the native core aside."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    return closure(project["dependencies"]) - closure(["bpy"])


def locked() -> dict[str, str]:
    """The entry of each distribution in requirements.lock, with its hashes."""
    text = (ROOT / "requirements.lock").read_text()
    entries = re.findall(r"^\S+==(?:.|\n(?=\s))*", text, re.MULTILINE)
    return {canonicalize_name(entry.split("==")[0]): entry for entry in entries}


def tags(names: set[str], python: tuple[int, int]) -> dict[str, set[Tag]]:
    """Which wheels of each distribution that Python runs here."""
    pure = set(compatible_tags(python, platforms=["any"]))
    everything = pure | set(cpython_tags(python)) | set(compatible_tags(python))
    return {name: pure if name in PURE else everything for name in names}


def local(names: set[str], python: tuple[int, int]) -> dict[str, Path]:
    """The wheels of the distributions for that Python which are in wheels/, as they are locked."""
    lock, wanted = locked(), tags(names, python)
    found = {}
    for path in WHEELS.glob("*.whl"):
        name, _, _, kinds = parse_wheel_filename(path.name)
        if name in names and kinds & wanted[name]:
            digest = hashlib.sha256(path.read_bytes()).hexdigest()
            if f"sha256:{digest}" in lock[name]:
                found[str(name)] = path
    return found


def fetch(names: set[str], python: tuple[int, int]) -> list[Path]:
    """The wheels for that Python and this platform in wheels/, at the locked versions."""
    WHEELS.mkdir(exist_ok=True)
    for pure in (True, False):
        missing = {name for name in names - set(local(names, python)) if (name in PURE) == pure}
        if missing:
            download(sorted(missing), python, pure)
    wheels = local(names, python)
    if missing := sorted(names - set(wheels)):
        raise FileNotFoundError(f"wheels/ lacks {', '.join(missing)} although it was fetched")
    return list(wheels.values())


def download(names: list[str], python: tuple[int, int], pure: bool) -> None:
    """Fetches into wheels/; `pure` refuses what is compiled."""
    requirements = ROOT / "build" / "bundle.txt"
    requirements.parent.mkdir(exist_ok=True)
    lock = locked()
    requirements.write_text("\n".join(lock[name] for name in names))
    kind = ("--implementation", "py", "--abi", "none", "--platform", "any") if pure else ()
    run("-m", "pip", "download", "--disable-pip-version-check", "--quiet", "--no-deps",
        "--only-binary", ":all:", "--require-hashes", "--dest", str(WHEELS),
        "--python-version", ".".join(map(str, python)), *kind,
        "--requirement", str(requirements))  # fmt: skip


def native_wheel() -> Path:
    """The native core's wheel, which `make native` built."""
    wheels = list(WHEELS.glob("volillum_native-*.whl"))
    if len(wheels) != 1:
        raise FileNotFoundError(f"wheels/ has {len(wheels)} wheels of the native core; expected 1")
    return wheels[0]


def stage(wheels: list[Path]) -> None:
    """Lays out the extension's files in build/extension."""
    shutil.rmtree(STAGE, ignore_errors=True)
    STAGE.mkdir(parents=True)
    for name in CONTENTS:
        source = ROOT / name
        if source.is_dir():
            shutil.copytree(source, STAGE / name, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy2(source, STAGE / name)
    (STAGE / "wheels").mkdir()
    for wheel in wheels:
        shutil.copy2(wheel, STAGE / "wheels")
    lines = "".join(f'    "./wheels/{wheel.name}",\n' for wheel in wheels)
    added = f'platforms = ["{platform()}"]\nwheels = [\n{lines}]\n\n'
    # Before the first table: keys after it would belong to it.
    keys, bracket, tables = (ROOT / "blender_manifest.toml").read_text().partition("[permissions]")
    (STAGE / "blender_manifest.toml").write_text(keys + added + bracket + tables)


def builder() -> Path:
    """Blender's own builder; it lies in the bpy package and runs alone."""
    package = importlib.util.find_spec("bpy")
    if package is None or package.submodule_search_locations is None:
        raise ModuleNotFoundError("the module bpy is not installed; expected it in .venv")
    root = Path(package.submodule_search_locations[0])
    (path,) = root.glob("*/scripts/addons_core/bl_pkg/cli/blender_ext.py")
    return path


def run(*arguments: str) -> None:
    """Runs Python; a failure shows what it said."""
    subprocess.run([sys.executable, *arguments], check=True, cwd=ROOT)


def main() -> None:
    """Stages, builds, validates."""
    names = bundled()
    first, *others = PYTHONS
    wheels = {native_wheel(), *fetch(names, first)}
    for python in others:
        wheels.update(fetch(names - FIRST_PYTHON_ONLY, python))
    stage(sorted(wheels))
    shutil.rmtree(DIST, ignore_errors=True)
    DIST.mkdir()
    blender = str(builder())
    run(blender, "build", "--source-dir", str(STAGE), "--output-dir", str(DIST),
        "--split-platforms")  # fmt: skip
    (archive,) = DIST.glob("*.zip")
    run(blender, "validate", str(archive))
    print(f"{archive.relative_to(ROOT)}: {archive.stat().st_size / 1e6:.1f} MB")


if __name__ == "__main__":
    main()
