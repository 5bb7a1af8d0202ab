"""The core's camera against Blender's own view frame."""

from __future__ import annotations

import bpy
import numpy as np
import pytest
from mathutils import Euler, Matrix

from volillum_addon.blender.camera_reader import image_size, read_camera
from volillum_addon.core.errors import InputError

# Blender's frame is float32.
TOLERANCE = 2e-6


@pytest.fixture
def scene() -> bpy.types.Scene:
    """An empty scene with a turned, moved and scaled camera."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    made = bpy.context.scene
    data = bpy.data.cameras.new("camera")
    made.camera = bpy.data.objects.new("camera", data)
    made.collection.objects.link(made.camera)
    turn = Euler((1.1, -0.3, 0.7)).to_matrix().to_4x4()
    made.camera.matrix_world = Matrix.Translation((1, -2, 3)) @ turn @ Matrix.Scale(2.5, 4)
    made.view_layers[0].update()
    return made


@pytest.mark.parametrize("kind", ["PERSP", "ORTHO"])
@pytest.mark.parametrize("fit", ["AUTO", "HORIZONTAL", "VERTICAL"])
@pytest.mark.parametrize("size", [(320, 180), (90, 400), (64, 64)])
def test_the_rays_of_the_corners_are_those_of_the_view_frame(
    scene: bpy.types.Scene, kind: str, fit: str, size: tuple[int, int]
) -> None:
    data = scene.camera.data
    data.type, data.sensor_fit = kind, fit
    data.lens, data.sensor_width, data.sensor_height = 35, 36, 20
    data.ortho_scale = 3.5
    data.shift_x, data.shift_y = 0.13, -0.21
    width, height = size
    scene.render.resolution_x, scene.render.resolution_y = width * 2, height * 2
    scene.render.resolution_percentage = 50
    assert image_size(scene) == size

    rays = read_camera(scene.camera, width, height).rays(width, height)
    matrix = np.array(scene.camera.matrix_world.normalized())
    right_up, right_down, left_down, left_up = (
        np.array(corner) for corner in data.view_frame(scene=scene)
    )
    # Of an orthographic frame the depth is arbitrary.
    for corner, (u, v) in (
        (left_up, (0, 0)),
        (right_up, (width, 0)),
        (left_down, (0, height)),
        (right_down, (width, height)),
    ):
        world = matrix[:3, :3] @ corner + matrix[:3, 3]
        origin = rays[0] + u * rays[1] + v * rays[2]
        direction = rays[3] + u * rays[4] + v * rays[5]
        away = world - origin
        along = direction / np.linalg.norm(direction)
        assert away @ along > 0
        assert np.linalg.norm(away - (away @ along) * along) < TOLERANCE * (
            np.linalg.norm(away) + np.linalg.norm(matrix[:3, 3])
        )


def test_a_panoramic_camera_is_refused_by_name(scene: bpy.types.Scene) -> None:
    scene.camera.data.type = "PANO"
    with pytest.raises(InputError, match="'camera' is of type PANO; expected PERSP or ORTHO"):
        read_camera(scene.camera, 64, 64)
