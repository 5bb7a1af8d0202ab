"""Lights of the core as Blender lights: the inverse of light_reader."""

from __future__ import annotations

import math

import bpy
import numpy as np
from mathutils import Matrix, Vector
from numpy.typing import NDArray

from ..core.lights import (
    AreaLight,
    DistantLight,
    EnvironmentLight,
    Light,
    PointLight,
    SpotLight,
)
from .nodes import Tree
from .sandbox import add_object

# An area light without a size gets this side, as a share of the distance to the medium's centre,
# for which the finite size changes the fluence by less than 1e-6.
AREA_SIDE = 1e-3


def add_lights(
    scene: bpy.types.Scene, lights: tuple[Light, ...], centre: NDArray[np.float64]
) -> None:
    """Add the lights to the scene, several environments as one world. `centre` is the medium's."""
    environments = []
    for light in lights:
        if isinstance(light, EnvironmentLight):
            environments.append(light)
        else:
            _add_light(scene, light, centre)
    scene.world = build_world(tuple(environments))


def _add_light(scene: bpy.types.Scene, light: Light, centre: NDArray[np.float64]) -> None:
    if isinstance(light, DistantLight):
        data = bpy.data.lights.new("sun", "SUN")
        data.angle = light.angle
        placed = _placed(data, scene, np.zeros(3), -np.asarray(light.direction))
        _set_strength(data, np.asarray(light.irradiance))
    elif isinstance(light, PointLight):
        data = bpy.data.lights.new("point", "POINT")
        data.shadow_soft_size = 0
        placed = _placed(data, scene, np.asarray(light.position), np.array([0.0, 0.0, -1.0]))
        _set_strength(data, np.asarray(light.intensity) * 4 * math.pi)
    elif isinstance(light, SpotLight):
        data = bpy.data.lights.new("spot", "SPOT")
        data.shadow_soft_size = 0
        data.spot_size, data.spot_blend = light.angle, light.blend
        placed = _placed(data, scene, np.asarray(light.position), np.asarray(light.direction))
        _set_strength(data, np.asarray(light.intensity) * 4 * math.pi)
    elif isinstance(light, AreaLight):
        data = bpy.data.lights.new("area", "AREA")
        distance = float(np.linalg.norm(np.asarray(light.position) - centre))
        data.shape = "ELLIPSE" if light.ellipse else "RECTANGLE"
        data.size, data.size_y = np.maximum(np.asarray(light.size), AREA_SIDE * distance)
        placed = add_object(scene, data, data.name)
        backward = -np.asarray(light.direction)
        across = np.asarray(light.across)
        turn = np.stack([across, np.cross(backward, across), backward], axis=1)
        place = Matrix(turn).to_4x4()
        place.translation = Vector(np.asarray(light.position))
        placed.matrix_world = place
        _set_strength(data, np.asarray(light.intensity) * math.pi)
    else:
        raise TypeError(f"light is a {type(light).__name__}; expected a light of the core")
    placed.visible_camera = False


def _placed(
    data: bpy.types.Light,
    scene: bpy.types.Scene,
    position: NDArray[np.float64],
    shines: NDArray[np.float64],
) -> bpy.types.Object:
    placed = add_object(scene, data, data.name)
    turn = Vector(shines).to_track_quat("-Z", "Y").to_matrix().to_4x4()
    placed.matrix_world = Matrix.Translation(Vector(position)) @ turn
    return placed


def _set_strength(data: bpy.types.Light, strength: NDArray[np.float64]) -> None:
    largest = float(strength.max())
    data.energy = largest
    data.color = strength / largest if largest > 0 else (1, 1, 1)


def build_world(environments: tuple[EnvironmentLight, ...]) -> bpy.types.World:
    """A world of the environments' sum; black when there is none."""
    world = bpy.data.worlds.new("volillum")
    tree = Tree(world.node_tree)
    output = tree.node("ShaderNodeOutputWorld")
    total = None
    for light in environments:
        background = tree.node("ShaderNodeBackground")
        background.inputs["Strength"].default_value = 1
        tree.feed(background.inputs["Color"], _radiance(tree, light))
        if total is None:
            total = background.outputs[0]
        else:
            add = tree.node("ShaderNodeAddShader")
            tree.tree.links.new(total, add.inputs[0])
            tree.tree.links.new(background.outputs[0], add.inputs[1])
            total = add.outputs[0]
    if total is not None:
        tree.tree.links.new(total, output.inputs["Surface"])
    return world


def _radiance(
    tree: Tree, light: EnvironmentLight
) -> bpy.types.NodeSocket | tuple[float, float, float]:
    radiance = np.asarray(light.radiance)
    if not light.is_image:
        red, green, blue = radiance
        return float(red), float(green), float(blue)
    height, width = radiance.shape[:2]
    image = bpy.data.images.new("volillum sky", width, height, float_buffer=True)
    # The working space itself: the pixels are radiance in it, to be left alone.
    image.colorspace_settings.name = "Non-Color"
    pixels = np.ones((height, width, 4), np.float32)
    pixels[..., :3] = radiance[::-1]  # Blender's first row is the lowest
    image.pixels.foreach_set(pixels.ravel())
    image.update()
    texture = tree.node("ShaderNodeTexEnvironment")
    texture.image = image
    turn = Matrix(np.eye(3) if light.rotation is None else np.asarray(light.rotation))
    mapping = tree.node("ShaderNodeMapping", vector_type="VECTOR")
    mapping.inputs["Rotation"].default_value = turn.to_euler("XYZ")
    where = tree.node("ShaderNodeTexCoord").outputs["Generated"]
    tree.feed(mapping.inputs["Vector"], where)
    tree.feed(texture.inputs["Vector"], mapping.outputs["Vector"])
    return texture.outputs["Color"]
