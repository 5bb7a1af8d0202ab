"""From the zip to a first picture, by a user who has nothing of ours yet."""

import bpy
import numpy as np
from eyes import picture
from hand import click, drag_file, into_view, key, middle
from sidebar import open_sidebar, press, scroll
from steps import Steps
from user import render, rendered, running, scan, scene, settings, volumes

ADDON = "bl_ext.user_default.volillum"
ZIP = "/volillum/volillum.zip"
# From where the zip is dropped to the button in the dialog that opens there.
OK = (0, -91)


def installing() -> Steps:
    """Drop the zip on Blender's first scene, a file on the view, light it, bake, show, render."""
    assert not installed()
    assert "volillum" not in dir(bpy.ops)
    yield from drag_file(ZIP, *middle())
    yield 1.0
    picture("install")
    x, y = middle()
    yield from click(x + OK[0], y + OK[1])
    yield installed
    yield from open_sidebar()
    picture("installed")
    yield from into_view()
    key("Delete")  # the cube
    yield from drag_file(f"/volillum/{scan()}", *middle())
    yield lambda: running() is None and len(volumes()) == 1
    yield 1.0
    picture("first_opened")
    yield from press("volillum.light(")
    yield 1.0
    picture("first_lit")
    yield from scroll(20)
    yield from press("volillum.bake(")
    yield lambda: running() is None and bool(settings().baked.path)
    yield from press("volillum.show(baked=True)")
    picture("first_baked")
    # Without a graphics card the picture would take minutes.
    scene().render.resolution_percentage = 50
    scene().eevee.taa_render_samples = 8
    yield from render()
    picture("first_rendered")
    colours = rendered()[..., :3]
    assert np.mean(np.ptp(colours - colours[0, 0], axis=-1) > 0.02) > 0.05


def installed() -> bool:
    """Whether the extension is there and enabled."""
    return ADDON in bpy.context.preferences.addons
