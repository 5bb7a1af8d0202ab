"""Text of more than one line: Blender's labels do not wrap, and cut off what does not fit."""

from __future__ import annotations

import blf
import bpy

# The widget font of Blender's own themes, at a resolution scale of 1, in pixels.
FONT, POINTS = 0, 11
# Of a sidebar's width, this much is no text: its tabs, a panel's margins, a label's padding.
FRAME, BOX, ICON = 62, 16, 26
# A sidebar's width before the user changes it; and what a text gets at least.
DEFAULT_WIDTH, NARROWEST = 292, 60


def room(context: bpy.types.Context) -> float:
    """Pixels for a label's text in the region that is drawn, at a resolution scale of 1."""
    region = getattr(context, "region", None)
    # Without a window there is no scale, nor a region.
    scale = bpy.context.preferences.system.ui_scale or 1
    width = region.width / scale if region is not None else DEFAULT_WIDTH
    return max(width - FRAME, NARROWEST)


def lines(text: str, pixels: float) -> list[str]:
    """The text in lines that are no wider, broken at spaces; a longer word has its own line."""
    blf.size(FONT, POINTS)
    found: list[str] = []
    for word in text.split():
        longer = f"{found[-1]} {word}" if found else word
        if found and blf.dimensions(FONT, longer)[0] <= pixels:
            found[-1] = longer
        else:
            found.append(word)
    return found
