"""What stands in the volume's place: one bake or another, full scattering; and rendering."""

import numpy as np
from eyes import difference, look, picture
from hand import key, point, window
from sidebar import press
from steps import Steps
from user import (
    MODEL,
    OTHER,
    bake_and_wait,
    choose_model,
    lit_view,
    open_scene,
    quick,
    render,
    rendered,
    scene,
    settings,
    volumes,
)

SECOND = "half_angle"
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
    yield from render()
    picture("rendered")
    shown = settings().baked.shown
    assert opaque(rendered()) > 0.2
    yield from point(*MIDDLE)
    key("Escape")
    yield lambda: any(each.type == "VIEW_3D" for each in window().screen.areas)
    picture("rendered_after")
    assert settings().baked.shown == shown
    assert volumes() == {"smoke": False, shown.name: True}


def opaque(image: np.ndarray) -> float:
    """The share of the picture in which there is lit smoke."""
    return float(np.mean((image[..., 3] > 0.5) & (image[..., :3].min(axis=-1) > 0.1)))
