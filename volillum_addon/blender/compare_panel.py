"""The sidebar's comparison: figures of images, and errors in the volume itself."""

from __future__ import annotations

from typing import Any

import bpy

from ..models.registry import get
from . import exhibit_state, wrap
from .sidebar import Sidebar, column, lines, progress_or_button


class VOLILLUM_PT_compare(Sidebar, bpy.types.Panel):
    """Errors and times against full scattering."""

    bl_label = "Compare"
    bl_options = {"DEFAULT_CLOSED"}  # noqa: RUF012 - Blender's own form

    def draw(self, context: bpy.types.Context) -> None:
        """What to compare, the button, and the figures of the last comparison."""
        layout = column(self.layout)
        settings = context.scene.volillum
        for name in ("compare_all", "compare_published", "width", "noise", "budget"):
            layout.prop(settings, name)
        progress_or_button(layout, "volillum.compare", "SORTTIME")
        room = wrap.room(context) - wrap.BOX
        if settings.results:
            _results(layout.box(), settings, room)
        _errors(layout, context.scene, room)


def _errors(layout: bpy.types.UILayout, scene: bpy.types.Scene, room: float) -> None:
    """The errors in the volume itself, their figures, and whether these still hold."""
    settings = scene.volillum
    layout.prop(settings, "error_limit")
    for operator, icon in (("show_error", "COLORSET_04_VEC"), ("error_row", "GRID")):
        progress_or_button(layout, f"volillum.{operator}", icon, scale=1)
    if settings.errors:
        box = layout.box()
        for line in settings.errors.split("\n"):
            lines(box, line, room)
        exhibit_state.draw(box, scene, settings.errors_of, True, room)


def _results(box: bpy.types.UILayout, settings: Any, room: float) -> None:
    for result in settings.results:
        entry = box.column(align=True)
        entry.label(text=get(result.model).label)
        if result.error < 0:
            lines(entry, result.reason or "not measured", room, "INFO")
            continue
        row = entry.row()
        row.label(text=f"{result.seconds:.2f} s", icon="TIME")
        row.label(text=error_text(result.error, result.noise), icon="DRIVER_DISTANCE")
    box.operator("wm.path_open", text="Open the report", icon="URL").filepath = settings.report


def error_text(error: float, noise: float) -> str:
    """A relative error with its noise in percent; below its noise only a bound."""
    if error <= noise:
        return f"< {100 * max(error, noise):.2g} %"
    return f"{100 * error:.3g} ± {100 * noise:.1g} %"


CLASSES = (VOLILLUM_PT_compare,)
