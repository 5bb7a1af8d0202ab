"""3D views that look through the camera turn to a row that is wider than the camera sees, and back.

A view is left alone where the user has another one, before or since: what was set is noted in the
row's collection.
"""

from __future__ import annotations

from collections.abc import Iterator

import bpy
import numpy as np
from mathutils import Matrix, Vector

from .placing import Place

# A view of focal length f shows this / f of its distance, along the longer side of its region.
SENSOR = 72.0
# Free space about what is framed.
MARGIN = 1.05
NOTE = "volillum_view"


def frame(
    scene: bpy.types.Scene, row: bpy.types.Collection, place: Place, width: float, below: float
) -> None:
    """Show what is `width` wide about the place's middle and reaches `below` under its box, both in
    widths of the place, in parallel projection as seen from the camera."""
    high = place.height / place.width
    middle = place.point(0, -below / 2)
    extent = MARGIN * place.width * np.array([width, high + below])
    notes = []
    for space, region in _views(scene):
        view = space.region_3d
        if view.view_perspective != "CAMERA":
            continue
        pixels = np.array([region.width, region.height])
        distance = float((extent / pixels).max() * pixels.max() * space.lens / SENSOR)
        view.view_perspective = "ORTHO"
        view.view_rotation = Matrix(place.turn.tolist()).to_quaternion()
        view.view_location = Vector(middle)
        view.view_distance = distance
        # Parallel views are clipped at half of it, before and behind.
        space.clip_end = max(space.clip_end, 8 * distance)
        notes += _where(view)
    row[NOTE] = notes


def unframe(scene: bpy.types.Scene, row: bpy.types.Collection) -> None:
    """The views that still show what `frame` set look through the camera again."""
    noted = np.reshape(np.array(row.get(NOTE, ()), np.float64), (-1, 4))
    for space, _ in _views(scene):
        view = space.region_3d
        if view.view_perspective == "ORTHO" and any(np.array_equal(_where(view), n) for n in noted):
            view.view_perspective = "CAMERA"


def _where(view: bpy.types.RegionView3D) -> list[float]:
    return [*view.view_location, view.view_distance]


def _views(
    scene: bpy.types.Scene,
) -> Iterator[tuple[bpy.types.SpaceView3D, bpy.types.Region]]:
    """The 3D views of the windows that show the scene; there are none of those in background."""
    for window in bpy.context.window_manager.windows:
        if window.scene != scene:
            continue
        for area in window.screen.areas:
            regions = [each for each in area.regions if each.type == "WINDOW"]
            if area.type == "VIEW_3D" and regions[0].width > 1:
                yield area.spaces.active, regions[0]
