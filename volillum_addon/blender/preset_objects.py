"""A scene preset's sun, sky and camera as Blender's."""

from __future__ import annotations

import math

import bpy
import numpy as np
from mathutils import Vector
from numpy.typing import NDArray

from .scene_presets import ScenePreset

# Clip planes this many volume sizes in front of and behind the framed distance.
CLIP = 10.0


def _toward(azimuth: float, elevation: float) -> Vector:
    """Unit vector from the volume to a place at these angles (degrees)."""
    a, e = math.radians(azimuth), math.radians(elevation)
    return Vector((math.sin(a) * math.cos(e), -math.cos(a) * math.cos(e), math.sin(e)))


def sun(preset: ScenePreset) -> bpy.types.Object:
    """The preset's sun, in no collection yet."""
    data = bpy.data.lights.new("Sun", "SUN")
    strength = max(preset.sun.irradiance) or 1.0
    data.energy = strength
    data.color = [value / strength for value in preset.sun.irradiance]
    data.angle = math.radians(preset.sun.angle)
    item = bpy.data.objects.new("Sun", data)
    toward = _toward(preset.sun.azimuth, preset.sun.elevation)
    item.rotation_euler = toward.to_track_quat("Z", "Y").to_euler()
    return item


def sky(preset: ScenePreset) -> bpy.types.World:
    """The preset's sky."""
    world = bpy.data.worlds.new("Sky")
    background = next(
        node for node in world.node_tree.nodes if node.bl_idname == "ShaderNodeBackground"
    )
    background.inputs["Color"].default_value = (*preset.sky.radiance, 1)
    background.inputs["Strength"].default_value = 1
    return world


def camera(points: NDArray[np.float64], preset: ScenePreset) -> bpy.types.Object:
    """The nearest camera on its line of sight that holds all points within the margins."""
    data = bpy.data.cameras.new("Camera")
    data.lens = preset.camera.lens
    toward = _toward(preset.camera.azimuth, preset.camera.elevation)
    rotation = toward.to_track_quat("Z", "Y")
    right, up, back = np.array(rotation.to_matrix()).T
    across, along, depth = points @ right, points @ up, points @ back
    width, height = preset.image.width, preset.image.height
    half = data.sensor_width / 2 / data.lens * (1 - 2 * preset.camera.margin)
    slope_x, slope_y = half * min(1, width / height), half * min(1, height / width)
    # A point is inside when |across - x| <= slope (z - depth). The four faces of the frustum bound
    # the eye (x, y, z); opposite faces meet at the nearest z of that direction.
    faces = [
        (slope_x, (across + slope_x * depth).max(), (-across + slope_x * depth).max()),
        (slope_y, (along + slope_y * depth).max(), (-along + slope_y * depth).max()),
    ]
    z = max((high + low) / (2 * slope) for slope, high, low in faces)
    x, y = ((high - low) / 2 for _, high, low in faces)
    item = bpy.data.objects.new("Camera", data)
    item.rotation_euler = rotation.to_euler()
    item.location = Vector(right * x + up * y + back * z)
    size = float(np.ptp(points, axis=0).max())
    data.clip_start = max(1e-4, (z - float(depth.max())) / CLIP)
    data.clip_end = (z - float(depth.min())) + CLIP * size
    return item
