"""What a user knows of the extension: where things are, what they say, and the usual steps."""

import shutil
from importlib import import_module
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from eyes import look, picture
from hand import F12, into_view, key, region, view, window
from sidebar import choose, open_sidebar, press
from steps import Steps

PACKAGE = "bl_ext.user_default.volillum.volillum_addon"
SCENE = "/volillum/smoke.blend"
# Pictures that look different differ by so much on average.
OTHER = 0.004
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


def lit_view() -> Steps:
    """The volume as EEVEE draws it, what the camera sees as large as the view is. What it looks
    like at first."""
    space = view().spaces.active
    space.shading.type = "MATERIAL"
    scene().eevee.taa_samples = 8
    yield from into_view()
    if space.region_3d.view_perspective == "CAMERA":
        key("Home")
    return (yield from look())


def open_scene(directory: str) -> Steps:
    """The scene as it was made, our tab open, bakes into a folder of the scenario's own."""
    copy = Path(f"/volillum/{directory}.blend")
    shutil.copy2(SCENE, copy)
    bpy.ops.wm.open_mainfile(filepath=str(copy))
    simple_view()
    yield 0.5
    settings().directory = f"/volillum/{directory}"
    yield from open_sidebar()


def quick() -> None:
    """The fastest settings of every model."""
    for model in package("models.registry").models():
        for name, value in (model.ladder[0] if model.ladder else {}).items():
            setattr(getattr(settings(), model.id), name, value)


def choose_model(model: str) -> Steps:
    """From the list, with the mouse."""
    yield from choose("volillum.model", list(package("models.registry").MODELS).index(model))
    assert settings().model == model


def bake_and_wait(files: int) -> Steps:
    """Press Bake; `files` are there then."""
    yield from press("volillum.bake(")
    yield lambda: running() is None and len(baked_files()) == files


def cancel(seen: str) -> Steps:
    """Escape over the view, once the job has got somewhere; `seen` is the picture of it."""
    yield lambda: running() is not None and running().control.fraction > 0.02
    yield 0.3
    picture(seen)
    yield from into_view()
    key("Escape")
    yield lambda: running() is None


def render() -> Steps:
    """Press F12; the picture is there then."""
    done = []
    bpy.app.handlers.render_complete.append(lambda *_: done.append(1))
    yield from into_view()
    key(F12)
    yield lambda: bool(done)
    yield 1.0


def rendered() -> np.ndarray:
    """The picture [rows, columns, 4]."""
    file = str(Path(bpy.app.tempdir) / "rendered.png")
    bpy.data.images["Render Result"].save_render(file)
    image = bpy.data.images.load(file)
    return np.array(image.pixels).reshape(*image.size[::-1], 4)


def baked_files() -> list[Path]:
    """The bakes of the scenario, temporary files too."""
    return sorted(Path(settings().directory).glob("*"))


def kept_bake() -> Path:
    """The bake that the settings name."""
    return Path(bpy.path.abspath(settings().baked.path))


def scan() -> str:
    """The file of a real scan, where there are third-party volumes."""
    return next(name for name in ("scan.nii.gz", "ball.npy") if Path("/volillum", name).is_file())


def in_view() -> Any:
    """What a call by the mouse in the 3D view has around it."""
    return bpy.context.temp_override(window=window(), area=view(), region=region("WINDOW"))
