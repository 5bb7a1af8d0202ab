"""The button that lights a volume and brings it into view."""

from __future__ import annotations

import bpy
import numpy as np
import pytest
from bpy_extras.object_utils import world_to_camera_view
from mathutils import Vector

from volillum_addon.blender import light_operator, work
from volillum_addon.blender.light_reader import light_objects, read_lights


def volume(scene: bpy.types.Scene) -> bpy.types.Object:
    found = work.chosen_volume(scene)
    assert found is not None
    return found


def made(scene: bpy.types.Scene) -> list[str]:
    return sorted(each.type for each in scene.objects if light_operator.MADE in each)


@pytest.mark.parametrize("turned", [False, True], ids=["as it is", "turned and moved"])
def test_all_of_the_volume_is_in_view_and_fills_it(scene: bpy.types.Scene, turned: bool) -> None:
    if turned:
        volume(scene).rotation_euler = (0.5, 0.4, 0.3)
        volume(scene).location = (30, -20, 5)
        volume(scene).scale = (3, 3, 3)
    scene.render.resolution_x, scene.render.resolution_y = 640, 360
    assert bpy.ops.volillum.light() == {"FINISHED"}
    scene.view_layers[0].update()
    seen = np.array(
        [
            world_to_camera_view(scene, scene.camera, Vector(corner))
            for corner in light_operator.corners(scene, volume(scene))
        ]
    )
    assert seen[:, :2].min() >= 0.05
    assert seen[:, :2].max() <= 0.95
    assert np.ptp(seen[:, :2], axis=0).max() > 0.85
    assert np.all(seen[:, 2] > scene.camera.data.clip_start)
    assert np.all(seen[:, 2] < scene.camera.data.clip_end)


def test_the_sun_and_the_sky_are_all_that_shines(scene: bpy.types.Scene) -> None:
    before = [each.name for each in light_objects(scene)]
    camera, world = scene.camera, scene.world
    bpy.ops.volillum.light()
    scene.view_layers[0].update()
    assert sorted(light.kind for light in read_lights(scene)) == ["distant", "environment"]
    assert all(bpy.data.objects[name].hide_render for name in before)
    assert camera.name in scene.objects  # nothing of the user's is gone
    assert world.name in bpy.data.worlds
    scene.volillum.model = "ambient_occlusion"
    assert bpy.ops.volillum.bake() == {"FINISHED"}


def test_pressed_again_it_makes_them_anew(scene: bpy.types.Scene) -> None:
    bpy.ops.volillum.light()
    count = len(scene.objects)
    volume(scene).location = (100, 0, 0)
    bpy.ops.volillum.light()
    assert len(scene.objects) == count
    assert made(scene) == ["CAMERA", "LIGHT"]
    assert scene.camera.location[0] > 50


def test_without_a_volume_it_says_so(scene: bpy.types.Scene) -> None:
    bpy.data.objects.remove(volume(scene))
    with pytest.raises(RuntimeError, match="names no volume"):
        bpy.ops.volillum.light()
    assert made(scene) == []
