"""What a user does in the window, each from a fresh start of Blender."""

import math
import shutil
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

import bpy
from hand import (
    Steps,
    choose,
    into_view,
    key,
    open_next_panel,
    open_sidebar,
    picture,
    press,
    region,
    scroll,
    type_into,
    view,
    window,
)

PACKAGE = "bl_ext.user_default.volillum.volillum_addon"
SCENE = "/volillum/smoke.blend"
MODEL = "multidirectional_occlusion"


def package(name: str) -> Any:
    """A module of the installed extension."""
    return import_module(f"{PACKAGE}.{name}")


def settings() -> Any:
    """The scene's settings; never kept, because an undo replaces the scene."""
    return scene().volillum


def running() -> Any:
    """The job that runs."""
    return package("blender.modal").current()


def scene() -> bpy.types.Scene:
    """The window's scene."""
    return bpy.context.window_manager.windows[0].scene


def volumes() -> dict[str, bool]:
    """The volume objects, and whether they are shown."""
    found = [each for each in scene().objects if each.type == "VOLUME"]
    return {each.name: not each.hide_viewport for each in found}


def shown_differs() -> str:
    """What the panel says of a bake that is shown but no longer as it would be."""
    said = package("blender.staleness").shown_differs
    return str(said(scene(), package("blender.work").chosen_volume(scene())))


def simple_view() -> None:
    """What is quick to draw."""
    space = view().spaces.active
    space.overlay.show_overlays = space.show_gizmo = False
    space.shading.type = "WIREFRAME"


def open_scene(directory: str) -> Steps:
    """The scene as it was made, our tab open, bakes into a folder of the scenario's own."""
    copy = Path(f"/volillum/{directory}.blend")
    shutil.copy2(SCENE, copy)
    bpy.ops.wm.open_mainfile(filepath=str(copy))
    simple_view()
    yield 0.5
    settings().directory = f"/volillum/{directory}"
    yield from open_sidebar()


def choose_model(model: str) -> Steps:
    """From the list, with the mouse."""
    yield from choose("volillum.model", list(package("models.registry").MODELS).index(model))
    assert settings().model == model


def bake_and_wait(files: int) -> Steps:
    """Press Bake; `files` are there then."""
    yield from press("volillum.bake(")
    yield lambda: running() is None and len(baked_files()) == files


def baked_files() -> list[Path]:
    """The bakes of the scenario, temporary files too."""
    return sorted(Path(settings().directory).glob("*"))


def kept_bake() -> Path:
    """The bake that the settings name."""
    return Path(bpy.path.abspath(settings().baked.path))


def baking() -> Steps:
    """Choose, set, bake, cancel, bake again, show, and back."""
    yield from open_scene("baking")
    picture("panel_fresh")
    yield from choose_model(MODEL)
    yield from type_into(f"{MODEL}.theta", "45")
    assert math.isclose(getattr(settings(), MODEL).theta, math.radians(45), rel_tol=1e-6)
    yield from type_into(f"{MODEL}.directions", "4096")
    assert getattr(settings(), MODEL).directions == 4096
    yield from press("volillum.bake(")
    yield lambda: running() is not None and running().control.fraction > 0.02
    yield 0.3
    picture("panel_baking")
    yield from into_view()
    key("Escape")
    yield lambda: running() is None
    assert not settings().baked.path
    assert baked_files() == []
    yield from type_into(f"{MODEL}.directions", "16")
    yield from bake_and_wait(1)
    assert settings().baked.model == MODEL
    assert kept_bake() == baked_files()[0]
    yield 0.3
    picture("panel_baked")
    yield from press("volillum.show(baked=True)")
    shown = settings().baked.shown
    assert volumes() == {"smoke": False, shown.name: True}
    yield 0.5
    picture("panel_shown")
    yield from press("volillum.show(baked=False)")
    assert volumes() == {"smoke": True}


def undo_and_reload() -> Steps:
    """Show, undo, redo; another model; save with Ctrl+S and open the file again."""
    yield from open_scene("undo")
    yield from choose_model(MODEL)
    yield from type_into(f"{MODEL}.directions", "8")
    yield from bake_and_wait(1)
    first = settings().baked.path
    yield from press("volillum.show(baked=True)")
    yield lambda: len(volumes()) == 2
    yield from into_view()
    key("ctrl+z")
    yield lambda: volumes() == {"smoke": True}
    # The bake is a step before: it is still there, and can be shown again.
    assert settings().baked.path == first
    assert settings().baked.shown is None
    key("ctrl+shift+z")
    yield lambda: list(volumes().values()) == [False, True]
    assert settings().baked.shown.data.filepath == first
    yield from choose_model("spherical_harmonics")
    yield from type_into("spherical_harmonics.directions", "8")
    yield from bake_and_wait(2)
    yield 0.3
    picture("panel_older_shown")
    yield from press("volillum.show(baked=True)")
    assert settings().baked.shown.data.filepath == settings().baked.path != first
    assert len(volumes()) == 2  # the first one's is gone
    next(each for each in scene().objects if each.type == "LIGHT").data.energy *= 0.5
    yield 0.5
    assert shown_differs().startswith("The lights have changed")
    picture("panel_relight")
    yield from into_view()
    key("ctrl+s")
    yield lambda: not bpy.data.is_dirty
    bpy.ops.wm.open_mainfile(filepath=bpy.data.filepath)
    simple_view()
    yield 0.5
    yield from open_sidebar()
    assert settings().model == settings().baked.model == "spherical_harmonics"
    assert settings().baked.shown.name in volumes()
    assert shown_differs().startswith("The lights have changed")
    yield from press("volillum.show(baked=True)")
    assert shown_differs() == ""
    picture("panel_reloaded")


def comparing() -> Steps:
    """Compare, cancel, compare again: its figures are in the panel, the file is as it was."""
    yield from open_scene("comparing")
    child = package("blender.child")
    command, folder = child.command, Path(child.__file__).parents[2]

    def other_blender(arguments: list[str]) -> tuple[list[str], dict[str, str]]:
        # Debian's Cycles renders no volumes; the tests' own Blender, a module, does.
        environment = command(arguments)[1] | {"PYTHONPATH": str(folder)}
        return [sys.argv[-1], "-P", "-m", "volillum_addon", *arguments], environment

    child.command = other_blender
    yield from choose_model(MODEL)
    chosen = settings()
    chosen.width, chosen.noise, chosen.budget, chosen.compare_all = 16, 100, 1, False
    getattr(chosen, MODEL).directions = 8
    yield from open_next_panel("volillum.as_radiance")
    yield from scroll(6)
    yield from press("volillum.compare(")
    yield lambda: running() is not None and running().control.fraction > 0
    yield 0.3
    picture("panel_comparing")
    yield from into_view()
    key("Escape")
    yield lambda: running() is None
    assert len(settings().results) == 0
    assert not list(Path(settings().directory).rglob("report.*"))
    yield from press("volillum.compare(")
    yield lambda: running() is None and len(settings().results) == 1
    (result,) = settings().results
    assert result.model == MODEL
    assert result.error > 0, result.reason
    assert Path(bpy.path.abspath(settings().report)).is_file()
    assert volumes() == {"smoke": True}
    yield from scroll(6)
    picture("panel_compared")


def importing() -> Steps:
    """Drop a file on the view, watch it come, take a preset, apply it, undo; then a raw file's
    dialog, and the menu's file browser."""
    bpy.data.batch_remove([each for each in bpy.data.objects if each.type == "MESH"])
    settings().directory = "/volillum/imported"
    simple_view()
    yield from into_view()
    with in_view():
        # What Blender calls when files are dropped.
        bpy.ops.wm.drop_import_file(
            "INVOKE_DEFAULT", directory="/volillum/", files=[{"name": "ball.npy"}]
        )
    yield lambda: running() is None and "ball" in volumes()
    yield from open_sidebar()
    yield 1.0
    picture("panel_transfer")
    before = bpy.data.objects["ball"].data.filepath
    presets = Path(package("resources").PRESETS) / "transfer_functions"
    with in_view():
        bpy.ops.volillum.load_transfer("EXEC_DEFAULT", True, filepath=str(presets / "ct_skin.json"))
    yield 0.5
    picture("panel_transfer_not_applied")
    yield from press("volillum.apply_transfer(")
    yield lambda: running() is None
    yield 0.5
    assert bpy.data.objects["ball"].data.filepath != before
    picture("panel_transfer_applied")
    yield from into_view()
    key("ctrl+z")
    yield lambda: bpy.data.objects["ball"].data.filepath == before
    with in_view():
        bpy.ops.volillum.import_volume("INVOKE_DEFAULT", filepath="/volillum/plain.raw")
    yield 1.0
    picture("import_raw")
    key("Escape")
    yield 0.5
    with in_view():
        bpy.ops.volillum.import_volume("INVOKE_DEFAULT")
    yield 1.5
    picture("import_browser")
    key("Escape")
    yield 0.5
    assert list(volumes()) == ["ball"]


def in_view() -> Any:
    """What a call by the mouse in the 3D view has around it."""
    return bpy.context.temp_override(window=window(), area=view(), region=region("WINDOW"))
