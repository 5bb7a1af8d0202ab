"""One button from a volume to one that is lit and in view."""

from __future__ import annotations

from dataclasses import replace
from typing import override

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from . import modal, preset_objects, scene_presets, work
from .camera_reader import image_size
from .light_reader import light_objects
from .scene_reader import evaluate

PRESET = "default"
# Marks what the button has made: pressed again, it makes that anew.
MADE = "volillum_made"


class VOLILLUM_OT_light(modal.InstantOperator, bpy.types.Operator):
    """Light the volume with a soft sun and a pale sky, and frame it with a camera of its own. The
    scene's lights are hidden, its world and camera kept in the file."""

    bl_idname = "volillum.light"
    bl_label = "Sun, sky and camera"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012

    @override
    def perform(self, context: bpy.types.Context) -> str:
        """Make them, and look through the camera in the 3D view that was asked."""
        light_and_frame(context.scene)
        view = context.space_data
        if isinstance(view, bpy.types.SpaceView3D):
            view.region_3d.view_perspective = "CAMERA"
            view.shading.use_scene_lights = view.shading.use_scene_world = True
        return ""


def light_and_frame(scene: bpy.types.Scene) -> None:
    """The preset's sun, sky and camera for the scene's volume. Raises InputError."""
    volume = work.chosen_volume(scene)
    if volume is None:
        raise InputError(f"scene {scene.name!r} names no volume; expected one volume object")
    points = corners(scene, volume)
    for made in [each for each in scene.objects if MADE in each]:
        bpy.data.objects.remove(made)
    for light in light_objects(scene):
        light.hide_render = light.hide_viewport = True
    preset = scene_presets.load(PRESET)
    width, height = image_size(scene)
    preset = replace(preset, image=replace(preset.image, width=width, height=height))
    sun, camera = preset_objects.sun(preset), preset_objects.camera(points, preset)
    for item in (sun, camera):
        item[MADE] = True
        scene.collection.objects.link(item)
    scene.world = preset_objects.sky(preset)
    scene.camera = camera


def corners(scene: bpy.types.Scene, volume: bpy.types.Object) -> NDArray[np.float64]:
    """The volume's bounding box in the world, [8, 3]. Raises InputError where it is empty."""
    evaluate(scene, volume)
    volume.data.grids.load()
    box = np.array(volume.evaluated_get(bpy.context.evaluated_depsgraph_get()).bound_box)
    if not np.ptp(box, axis=0).all():
        raise InputError(f"volume {volume.name!r} shows nothing; expected a file with a grid")
    matrix = np.array(volume.matrix_world)
    return np.asarray(box @ matrix[:3, :3].T + matrix[:3, 3])


CLASSES = (VOLILLUM_OT_light,)
