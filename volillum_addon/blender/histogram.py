"""The histogram of a volume's values behind its transfer function, as a picture for the panel."""

from __future__ import annotations

import json
from typing import Any

import bpy
import bpy.utils.previews
import numpy as np
from numpy.typing import NDArray

from ..core.transfer_function import TransferFunction
from ..readers.imported import About

# Pixels across and up; icons are square.
WIDTH, HEIGHT = 256, 256
LINE = (1.0, 1.0, 1.0)
# Bars in the colour of the ramp; where the ramp is clear, in this grey.
CLEAR = 0.32
BACKGROUND = (0.0, 0.0, 0.0, 0.25)
# The opacity's line, pixels.
THICK = 2.0

_previews: Any = None
_drawn: str = ""


def picture(
    about: About, transfer: TransferFunction, low: float, high: float, logarithmic: bool
) -> NDArray[np.float32]:
    """RGBA [row from below, column, 4] of the values from `low` to `high`: how often each is, in
    the colour it has, and the line of its opacity."""
    edges = np.linspace(low, high, WIDTH + 1)
    middles = (edges[1:] + edges[:-1]) / 2
    counts = about.voxels_between(edges)
    heights = np.log1p(counts) if logarithmic else counts
    heights = heights / (heights.max() or 1.0) * HEIGHT
    density = np.interp(middles, transfer.values, transfer.density)  # type: ignore[arg-type]
    albedo = transfer.albedos(middles.astype(np.float32))
    share = np.sqrt(density)[:, None]
    colours = CLEAR * (1 - share) + albedo * share
    rows = np.arange(HEIGHT)[:, None] + 0.5
    image = np.empty((HEIGHT, WIDTH, 4), np.float32)
    image[:] = BACKGROUND
    below = rows < heights
    image[..., :3] = np.where(below[..., None], colours, image[..., :3])
    image[..., 3] = np.where(below, 1.0, image[..., 3])
    level = density * (HEIGHT - 1)
    # A steep line covers all rows from one column's level to the next one's.
    following = np.append(level[1:], level[-1])
    line = (rows >= np.minimum(level, following) - THICK) & (
        rows <= np.maximum(level, following) + THICK
    )
    image[line] = (*LINE, 1.0)
    return image


def icon(
    about: About, transfer: TransferFunction, low: float, high: float, logarithmic: bool
) -> int:
    """The picture as an icon for a layout, drawn anew only when something has changed."""
    global _previews, _drawn
    if _previews is None:
        _previews = bpy.utils.previews.new()
    state = json.dumps([about.source, about.histogram, transfer.as_json(), low, high, logarithmic])
    if "histogram" not in _previews:
        _previews.new("histogram")
        _drawn = ""
    shown = _previews["histogram"]
    if state != _drawn:
        image = picture(about, transfer, low, high, logarithmic)
        shown.image_size = (WIDTH, HEIGHT)
        shown.image_pixels_float.foreach_set(image.ravel())
        _drawn = state
    return int(shown.icon_id)


def forget() -> None:
    """Give the picture back."""
    global _previews, _drawn
    if _previews is not None:
        bpy.utils.previews.remove(_previews)
    _previews, _drawn = None, ""
