"""Baking: progress, cancelling, showing, undo, saving and opening again."""

import math

import bpy
from eyes import picture
from hand import into_view, key
from sidebar import open_sidebar, press, type_into
from steps import Steps
from user import (
    MODEL,
    bake_and_wait,
    baked_files,
    cancel,
    choose_model,
    kept_bake,
    open_scene,
    scene,
    settings,
    shown_differs,
    simple_view,
    volumes,
)


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
    yield from cancel("panel_baking")
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
