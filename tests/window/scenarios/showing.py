"""What stands in the volume's place: one bake or another, full scattering, a row; and rendering."""

from pathlib import Path

import bpy
import numpy as np
from eyes import difference, look, picture
from hand import click, into_view, key, point, region, view, window
from sidebar import press
from steps import Steps
from user import (
    MODEL,
    OTHER,
    bake_and_wait,
    choose_model,
    lit_view,
    open_scene,
    package,
    quick,
    running,
    scene,
    settings,
    volumes,
)

SECOND = "half_angle"
# In the window's top bar: the menu Render, and the first of its entries.
RENDER_MENU, RENDER_IMAGE = (126, 885), (160, 860)
MIDDLE = (700, 450)


def switching() -> Steps:
    """Two models in turn with A/B, then full scattering, and the bake again."""
    yield from open_scene("switching")
    quick()
    yield from choose_model(MODEL)
    yield from bake_and_wait(1)
    yield from press("volillum.show(baked=True)")
    first = yield from lit_view()
    file = settings().baked.path
    yield from choose_model(SECOND)
    yield from bake_and_wait(2)
    yield from press("volillum.show(baked=True)")
    second = yield from look()
    picture("switch_second", "view")
    assert (settings().baked.model, settings().other.model) == (SECOND, MODEL)
    assert difference(first, second) > OTHER
    yield from press("volillum.swap(")
    assert (settings().baked.model, settings().other.model) == (MODEL, SECOND)
    assert settings().baked.shown.data.filepath == settings().baked.path == file
    again = yield from look()
    picture("switch_first", "view")
    assert difference(first, again) < OTHER / 2
    bounces = scene().cycles.volume_bounces
    yield from press("volillum.scatter(")
    assert settings().stage.way == "SCATTERING"
    assert volumes() == {"smoke": True}
    assert scene().cycles.volume_bounces > 10
    yield from look()
    picture("switch_scattering", "view")
    yield from press("volillum.show(baked=True)")
    assert settings().stage.way == "BAKE"
    assert scene().cycles.volume_bounces == bounces
    back = yield from look()
    assert difference(first, back) < OTHER / 2


def side_by_side() -> Steps:
    """Every model in a row with its name."""
    yield from open_scene("side_by_side")
    quick()
    yield from lit_view()
    scene().eevee.volumetric_tile_size = "2"
    yield from press("volillum.side_by_side(")
    yield lambda: running() is None and settings().stage.way == "ROW"
    row = settings().exhibit.objects
    labels = [each.data.body for each in row if each.type == "FONT"]
    models = package("models.registry").models()
    assert [" ".join(label.split()) for label in labels] == [model.label for model in models]
    assert len([each for each in row if each.type == "VOLUME"]) == len(models)
    # The view has turned from the camera to the row.
    yield from look()
    picture("side_by_side_panel", "view")
    yield from into_view()
    key("n")
    yield lambda: region("UI").width <= 1
    assert columns((yield from look())) == len(models)
    picture("side_by_side", "view")
    key("n")
    yield lambda: region("UI").width > 1
    yield from press("volillum.clear_row(")
    assert volumes() == {"smoke": True}
    assert view().spaces.active.region_3d.view_perspective == "CAMERA"


def columns(shown: np.ndarray) -> int:
    """How many separate things stand beside each other in the middle of the view."""
    middle = shown[len(shown) // 2 - 20 : len(shown) // 2].max(axis=(0, 2))
    lit = np.flatnonzero(middle > np.median(middle) + 0.08)
    return 1 + int(np.count_nonzero(np.diff(lit) > 3))


def rendering() -> Steps:
    """F12 with a bake shown."""
    yield from open_scene("rendering")
    # Debian's Cycles renders no volumes.
    scene().render.engine = "BLENDER_EEVEE"
    scene().render.resolution_percentage = 150
    quick()
    yield from choose_model(MODEL)
    yield from bake_and_wait(1)
    yield from press("volillum.show(baked=True)")
    done = []
    bpy.app.handlers.render_complete.append(lambda *_: done.append(1))
    yield from click(*RENDER_MENU)
    yield 0.5
    yield from click(*RENDER_IMAGE)
    yield lambda: bool(done)
    yield 1.0
    picture("rendered")
    shown = settings().baked.shown
    assert opaque(rendered()) > 0.2
    yield from point(*MIDDLE)
    key("Escape")
    yield lambda: any(each.type == "VIEW_3D" for each in window().screen.areas)
    picture("rendered_after")
    assert settings().baked.shown == shown
    assert volumes() == {"smoke": False, shown.name: True}


def rendered() -> np.ndarray:
    """The picture [rows, columns, 4]."""
    file = Path(settings().directory) / "rendered.png"
    bpy.data.images["Render Result"].save_render(str(file))
    image = bpy.data.images.load(str(file))
    return np.array(image.pixels).reshape(*image.size[::-1], 4)


def opaque(image: np.ndarray) -> float:
    """The share of the picture in which there is lit smoke."""
    return float(np.mean((image[..., 3] > 0.5) & (image[..., :3].min(axis=-1) > 0.1)))
