"""3D views turn from the camera to a row, and back."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import numpy as np
import pytest
from mathutils import Vector

from volillum_addon.bake.vdb import read_metadata
from volillum_addon.blender import framing, showing, side_by_side, work
from volillum_addon.blender.placing import lattice_corners
from volillum_addon.core.control import Control

# A region's pixels.
WIDTH, HEIGHT = 800, 600


@pytest.fixture
def view(scene: bpy.types.Scene, monkeypatch: pytest.MonkeyPatch) -> bpy.types.SpaceView3D:
    """The one view of the scene, through its camera; the module draws none of its own."""
    found = (space for screen in bpy.data.screens for area in screen.areas for space in area.spaces)
    view = next(space for space in found if space.type == "VIEW_3D")
    view.region_3d.view_perspective = "CAMERA"

    def views(of: bpy.types.Scene) -> Iterator[tuple[Any, Any]]:
        assert of == scene
        yield view, SimpleNamespace(width=WIDTH, height=HEIGHT)

    monkeypatch.setattr(framing, "_views", views)
    return view


def arrange(scene: bpy.types.Scene) -> None:
    scene.volillum.multidirectional_occlusion.directions = 8
    scene.volillum.spherical_harmonics.directions = 8
    models = ("multidirectional_occlusion", "spherical_harmonics", "ambient_occlusion")
    chosen = work.chosen_models(scene, models)
    bakes = work.bake_all(work.read(scene), chosen, Path(scene.volillum.directory), Control())
    side_by_side.arrange(scene, bakes.done)
    bpy.context.view_layer.update()


def on_screen(view: bpy.types.SpaceView3D, item: bpy.types.Object) -> np.ndarray:
    """The corners of what it shows [8, 2] in the region, -1 to 1."""
    if item.type == "VOLUME":  # its own box is along the world's axes, the lattice is turned
        lattice = lattice_corners(read_metadata(Path(bpy.path.abspath(item.data.filepath))))
        corners = lattice + np.array(item.location)
    else:
        corners = np.array([item.matrix_world @ Vector(corner) for corner in item.bound_box])
    turn = np.array(view.region_3d.view_rotation.to_matrix())
    along = (corners - np.array(view.region_3d.view_location)) @ turn[:, :2]
    seen = view.region_3d.view_distance * framing.SENSOR / view.lens
    return along / (seen * np.array([WIDTH, HEIGHT]) / max(WIDTH, HEIGHT) / 2)


def test_a_row_is_seen_as_a_whole_and_the_camera_again(
    scene: bpy.types.Scene, view: bpy.types.SpaceView3D
) -> None:
    arrange(scene)
    assert view.region_3d.view_perspective == "ORTHO"
    row = list(scene.volillum.exhibit.objects)
    seen = np.concatenate([on_screen(view, each) for each in row])
    assert len(row) == 6
    assert np.abs(seen).max() <= 1
    # And not smaller than it need be: the row is wider than the region.
    assert np.ptp(seen[:, 0]) > 1.7
    showing.hide(scene)
    assert view.region_3d.view_perspective == "CAMERA"


def test_what_the_user_looks_at_stays(scene: bpy.types.Scene, view: bpy.types.SpaceView3D) -> None:
    arrange(scene)
    view.region_3d.view_distance *= 2
    showing.hide(scene)
    assert view.region_3d.view_perspective == "ORTHO"
    view.region_3d.view_perspective = "PERSP"
    distance = view.region_3d.view_distance
    arrange(scene)
    assert view.region_3d.view_perspective == "PERSP"
    assert view.region_3d.view_distance == distance
