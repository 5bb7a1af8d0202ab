"""What the panels of the sidebar share."""

from __future__ import annotations

from collections.abc import Sequence

import bpy

from . import modal, wrap

CATEGORY = "Volillum"
# The height of the buttons that start work, in rows.
BUTTON_SCALE = 1.4


class Sidebar:
    """Mix into a panel: it is in our tab of the 3D view's sidebar."""

    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = CATEGORY


def column(layout: bpy.types.UILayout) -> bpy.types.UILayout:
    """Properties with their names before them, and no dots for key frames."""
    layout.use_property_split = True
    layout.use_property_decorate = False
    return layout.column()


def progress_or_button(
    layout: bpy.types.UILayout, operator: str, icon: str, scale: float = BUTTON_SCALE
) -> None:
    """The button, or how far its job is; other jobs only block it."""
    if progress(layout, operator, scale):
        return
    row = layout.row()
    row.enabled = modal.current() is None
    row.scale_y = scale
    # From a panel's button `invoke` runs: beside the user's work.
    row.operator(operator, icon=icon)


def progress(layout: bpy.types.UILayout, operator: str, scale: float = BUTTON_SCALE) -> bool:
    """How far the operator's job is, and its Cancel; whether there is one."""
    job = modal.current()
    title = bpy.ops
    for part in operator.split("."):
        title = getattr(title, part)
    if job is None or job.label != title.get_rna_type().name:
        return False
    row = layout.row(align=True)
    row.scale_y = scale
    row.progress(factor=min(max(job.control.fraction, 0.0), 1.0), text=job.progress)
    row.operator("volillum.cancel", text="", icon="X")
    return True


def stale(layout: bpy.types.UILayout, title: str, changes: Sequence[str], room: float) -> None:
    """What to do because of the changes, and the changes; nothing where there are none."""
    if not changes:
        return
    column = layout.column(align=True)
    column.alert = True
    lines(column, title, room, "ERROR")
    for change in changes:
        lines(column, change, room)


def lines(layout: bpy.types.UILayout, text: str, room: float, icon: str = "NONE") -> None:
    """Text over as many lines as it needs; `room` in pixels, of which an icon takes its part."""
    column = layout.column(align=True)
    column.scale_y = 0.8
    below = "NONE" if icon == "NONE" else "BLANK1"
    pixels = room if icon == "NONE" else room - wrap.ICON
    for index, line in enumerate(wrap.lines(text, pixels)):
        column.label(text=line, icon=below if index else icon)
