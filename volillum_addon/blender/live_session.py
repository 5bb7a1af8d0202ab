"""Live in the interface: one scene at a time, looked at by a timer, switched by an operator."""

from __future__ import annotations

import bpy

from ..core.errors import InputError
from . import modal
from .live import Live

# Twenty looks a second: what a look finds is answered before the hand has moved on.
LOOK_SECONDS = 0.05

_live: Live | None = None


def current() -> Live | None:
    """What follows a scene now."""
    return _live


def start(scene: bpy.types.Scene) -> Live:
    """Follow the scene; whatever was followed before is not any more."""
    global _live
    stop()
    _live = Live(scene)
    bpy.app.timers.register(_look, first_interval=LOOK_SECONDS)
    return _live


def stop() -> None:
    """Follow nothing."""
    global _live
    if _live is None:
        return
    live, _live = _live, None
    if bpy.app.timers.is_registered(_look):
        bpy.app.timers.unregister(_look)
    live.stop()


def _look() -> float | None:
    live = _live
    if live is None:
        return None
    if bpy.app.is_job_running("RENDER"):  # what is rendered must not change
        return LOOK_SECONDS
    before, well = live.message, False
    try:
        live.look()
        well = True
    except InputError:
        pass  # the scene is gone
    finally:
        if not well:
            stop()
    if live.message != before:
        modal.redraw_sidebars(bpy.context)
    return LOOK_SECONDS if well else None


def _stop_before_loading(*_: object) -> None:
    stop()


# Handlers are forgotten with the file that they were added in, but for those that say otherwise.
_before_loading = bpy.app.handlers.persistent(_stop_before_loading)


class VOLILLUM_OT_live(bpy.types.Operator):
    """Keep what is shown in step with the scene: coarse at once, in full when it rests."""

    bl_idname = "volillum.live"
    bl_label = "Live"
    bl_options = {"REGISTER"}  # noqa: RUF012 - Blender's own form

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Switch it on, or off again."""
        live = current()
        if live is not None and live.follows(context.scene):
            stop()
        else:
            start(context.scene)
        return {"FINISHED"}


CLASSES = (VOLILLUM_OT_live,)


def register() -> None:
    """End it before another file is opened."""
    bpy.app.handlers.load_pre.append(_before_loading)


def unregister() -> None:
    """End it now."""
    stop()
    bpy.app.handlers.load_pre.remove(_before_loading)
