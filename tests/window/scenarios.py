"""What a user does in the window, each from a fresh start of Blender."""

import math
import shutil
from importlib import import_module
from pathlib import Path
from typing import Any

import bpy
from hand import Steps, choose, into_view, key, open_sidebar, picture, press, type_into, view

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
    assert settings().baked.path == str(baked_files()[0])
    yield 0.3
    picture("panel_baked")
    yield from press("volillum.show(baked=True)")
    shown = settings().baked.shown
    assert volumes() == {"smoke": False, shown.name: True}
    yield 0.5
    picture("panel_shown")
    yield from press("volillum.show(baked=False)")
    assert volumes() == {"smoke": True}
