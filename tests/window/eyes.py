"""What the display shows: pictures to keep, and pixels to judge."""

from __future__ import annotations

import bpy
import numpy as np
from hand import display, region, view, window
from steps import Steps

PICTURES = "/volillum"
# So often a view is drawn until it is as it stays: EEVEE adds up several pictures.
DRAWINGS = 8
# A view that rests differs by less between two looks, of which there are so many; one that shows
# something has this contrast.
STILL, CONTRAST = 2e-4, 0.3
LOOKS, LOOK_SECONDS = 60, 0.5


def picture(name: str, part: str = "window") -> None:
    """Keep what is shown now: of the `window`, the 3D `view` or its `sidebar`."""
    bpy.ops.wm.redraw_timer(type="DRAW_WIN_SWAP", iterations=1)
    display("import", "-window", "root", *_crop(part), f"{PICTURES}/{name}.png")


def pixels() -> np.ndarray:
    """The 3D view as it is shown [rows from the top, columns, 3], 0 to 1."""
    bpy.ops.wm.redraw_timer(type="DRAW_WIN_SWAP", iterations=DRAWINGS)
    shown = display("import", "-window", "root", *_crop("scene"), "-depth", 8, "rgb:-")
    whole = region("WINDOW")
    return np.frombuffer(shown, np.uint8).reshape(whole.height, whole.width, 3) / 255


def look() -> Steps:
    """Wait until the 3D view rests, with something in it: its shaders are compiled beside. The
    pixels."""
    before = pixels()
    for _ in range(LOOKS):
        yield LOOK_SECONDS
        now = pixels()
        if np.ptp(now) > CONTRAST and difference(before, now) < STILL:
            return now
        before = now
    raise AssertionError("the 3D view shows nothing, or never rests")


def difference(one: np.ndarray, other: np.ndarray) -> float:
    """The mean difference of two pictures' pixels."""
    return float(np.abs(one - other).mean())


def _crop(part: str) -> tuple[str, ...]:
    if part == "window":
        return ()
    box = {"view": view, "scene": lambda: region("WINDOW"), "sidebar": lambda: region("UI")}[part]()
    top = window().height - box.y - box.height
    return ("-crop", f"{box.width}x{box.height}+{box.x}+{top}", "+repage")
