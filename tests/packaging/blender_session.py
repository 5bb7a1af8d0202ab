"""Blender sessions of their own, with BLENDER_USER_RESOURCES set to a scratch folder.

`python blender_session.py install ARCHIVE` installs and enables, `python blender_session.py use
RESULT.json` uses, disables and removes what an earlier session installed. RESULT says where the
modules came from and what was left behind. Two sessions, because only from the second one on do an
extension's wheels precede the other packages of this Python.
"""

import importlib
import json
import os
import sys
from pathlib import Path
from types import ModuleType

import bpy  # makes Blender's own modules importable, hence first

# isort: split
import addon_utils

REPOSITORY = "user_default"
IDENTIFIER = "volillum"
ROOT_MODULE = f"bl_ext.{REPOSITORY}.{IDENTIFIER}"
EXTENSIONS = Path(os.environ["BLENDER_USER_RESOURCES"]) / "extensions"


def install(archive: str) -> None:
    """Installs and enables as a drop of the archive onto Blender's window does."""
    bpy.ops.extensions.package_install_files(
        filepath=archive, repo=REPOSITORY, enable_on_install=True
    )
    loaded_by_default, loaded = addon_utils.check(ROOT_MODULE)
    assert loaded, (loaded_by_default, loaded)


def use(package: ModuleType) -> None:
    """Does with the installed extension what its user would."""
    assert importlib.import_module("volillum_native").instruction_set()
    cli = importlib.import_module(f"{package.__name__}.blender.cli")
    assert cli.main(["--version"]) == 0
    resources = importlib.import_module(f"{package.__name__}.resources")
    (volume,) = resources.PRESETS.glob("volumes/smoke.vdb")
    places = importlib.import_module(f"{package.__name__}.blender.places")
    # Beside a file that is saved nowhere yet: the extension's own folder, as the rules want.
    unsaved = Path(places.output_directory("//volillum"))
    assert unsaved.is_relative_to(EXTENSIONS / ".user"), unsaved
    bake(cli, volume)


def bake(cli: ModuleType, volume: Path) -> None:
    """Bakes through the operator, in a scene that the command made, and shows the bake."""
    file = Path("smoke.blend").absolute()
    assert cli.main(["scene", str(volume), "--preset", "smoke", "-o", str(file)]) == 0
    bpy.ops.wm.open_mainfile(filepath=str(file))
    settings = bpy.context.scene.volillum
    getattr(settings, settings.model).directions = 8
    assert bpy.ops.volillum.bake() == {"FINISHED"}
    (baked,) = (file.parent / "volillum").iterdir()
    assert Path(bpy.path.abspath(settings.baked.path)) == baked
    assert bpy.ops.volillum.show() == {"FINISHED"}
    shown = settings.baked.shown.data
    assert shown.grids.load(), shown.grids.error_message
    assert "density" in [grid.name for grid in shown.grids]


def disable_and_remove() -> None:
    """Disables first, as the interface does, so that `unregister` runs."""
    addon_utils.disable(ROOT_MODULE, default_set=True)
    assert addon_utils.check(ROOT_MODULE) == (False, False)
    names = [repository.module for repository in bpy.context.preferences.extensions.repos]
    bpy.ops.extensions.package_uninstall(repo_index=names.index(REPOSITORY), pkg_id=IDENTIFIER)


def left_over() -> list[str]:
    """The files that remain of the extension or of its wheels, without Blender's own records.

    Blender forgets the byte code of a wheel's top-level module (OpenEXR's Imath), which Python, not
    the extension, wrote.
    """
    records = (EXTENSIONS / ".cache", EXTENSIONS / REPOSITORY / ".blender_ext")
    return [
        path.relative_to(EXTENSIONS).as_posix()
        for path in EXTENSIONS.rglob("*")
        if path.is_file()
        and not (path.suffix == ".pyc" and path.parents[1].name == "site-packages")
        and not any(path.is_relative_to(record) for record in records)
    ]


def use_and_remove(result: str) -> None:
    """The second session. The module bpy does not load preferences: it enables by itself."""
    addon_utils.enable(ROOT_MODULE, default_set=True)
    names = ("volillum_native", "OpenEXR", "matplotlib", "flip_evaluator")
    modules = {name: str(importlib.import_module(name).__file__) for name in names}
    package = importlib.import_module(f"{ROOT_MODULE}.volillum_addon")
    modules["volillum_addon"] = str(package.__file__)
    use(package)
    disable_and_remove()
    Path(result).write_text(json.dumps({"modules": modules, "left_over": left_over()}))


{"install": install, "use": use_and_remove}[sys.argv[1]](sys.argv[2])
