"""A Blender camera as the core's Camera."""

from __future__ import annotations

import math

import bpy
import numpy as np

from ..core.camera import Camera
from ..core.errors import InputError


def image_size(scene: bpy.types.Scene) -> tuple[int, int]:
    """Width and height in pixels that the scene renders."""
    render = scene.render
    share = render.resolution_percentage / 100
    return max(1, int(render.resolution_x * share)), max(1, int(render.resolution_y * share))


def read_camera(placed: bpy.types.Object, width: int, height: int) -> Camera:
    """The camera for images of this shape (pixels are square).

    Raises InputError for panoramic and custom cameras.
    """
    data = placed.data
    if data.type not in ("PERSP", "ORTHO"):
        raise InputError(f"camera {placed.name!r} is of type {data.type}; expected PERSP or ORTHO")
    matrix = np.array(placed.matrix_world.normalized(), dtype=np.float64)
    position, forward, up = matrix[:3, 3], -matrix[:3, 2], matrix[:3, 1]
    # The side that the sensor, the orthographic scale and the shifts are measured on, in pixels.
    by_width = data.sensor_fit == "HORIZONTAL" or (data.sensor_fit == "AUTO" and width >= height)
    side = width if by_width else height
    sensor = data.sensor_height if data.sensor_fit == "VERTICAL" else data.sensor_width
    shift = (data.shift_x * side / height, data.shift_y * side / height)
    if data.type == "ORTHO":
        return Camera(
            position, position + forward, up, orthographic=True,
            height=data.ortho_scale * height / side, shift=shift, aspect=width / height,
        )  # fmt: skip
    fov = 2 * math.atan(sensor / (2 * data.lens) * height / side)
    return Camera(position, position + forward, up, fov=fov, shift=shift, aspect=width / height)
