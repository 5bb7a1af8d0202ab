"""A scene without its voxels: enough to say what a model leaves out, cheap at every redraw."""

from __future__ import annotations

import bpy
import numpy as np

from ..core.grid import Grid
from ..core.lights import EnvironmentLight, Light
from ..core.medium import Medium
from ..core.scene import Scene
from .camera_reader import image_size, read_camera
from .light_reader import light_objects, read_light, read_world
from .medium_reader import Closure, read_closures, volume_material

_VOXEL = Grid(np.ones((1, 1, 1), np.float32), np.eye(4), "one voxel")


def outline(scene: bpy.types.Scene, volume: bpy.types.Object) -> Scene:
    """Lights, camera, anisotropy and whether there is emission, as `read_scene` has them, around a
    medium of one voxel. Raises InputError for what cannot be read or where nothing shines."""
    parts = closures(volume)
    glows = any(part.emission.grids or part.emission.constant.any() for part in parts)
    g = next((part.g for part in parts if part.sigma_s.grids), 0.0)
    camera = None
    if scene.camera is not None:
        camera = read_camera(scene.camera, *image_size(scene))
    medium = Medium(_VOXEL, _VOXEL, _VOXEL if glows else None, g)
    return Scene(medium, lights(scene), camera)


def closures(volume: bpy.types.Object) -> list[Closure]:
    """The coefficients of the volume's material; none where it has no material."""
    material = volume_material(volume)
    return [] if material is None else read_closures(material)


def lights(scene: bpy.types.Scene) -> tuple[Light, ...]:
    """As `read_lights`, but a world with an image is any environment: its pixels take time."""
    found = [read_light(placed) for placed in light_objects(scene)]
    world = scene.world
    if world is None:
        return tuple(found)
    images = world.node_tree is not None and any(
        node.bl_idname == "ShaderNodeTexEnvironment" for node in world.node_tree.nodes
    )
    if images and world.cycles_visibility.scatter:
        return (*found, EnvironmentLight(1.0))
    return (*found, *read_world(world))
