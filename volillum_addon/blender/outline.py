"""A scene without its voxels: enough to say what a model leaves out, cheap at every redraw."""

from __future__ import annotations

import json
from typing import Any

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
    return Scene(medium, lights(scene), camera, scene.volillum.seen_only)


def closures(volume: bpy.types.Object) -> list[Closure]:
    """The coefficients of the volume's material; none where it has no material."""
    material = volume_material(volume)
    return [] if material is None else read_closures(material)


def lights(scene: bpy.types.Scene) -> tuple[Light, ...]:
    """As `read_lights`, but images are read again only when `world_state` has changed."""
    found = [read_light(placed) for placed in light_objects(scene)]
    return (*found, *(() if scene.world is None else _world_lights(scene.world)))


def world_state(world: bpy.types.World | None) -> str:
    """What a world's light comes from: nodes, links, constants, and of images what tells them apart
    without their pixels. Paint on an image that was painted on before does not show."""
    if world is None or world.node_tree is None:
        return ""
    nodes, links = world.node_tree.nodes, world.node_tree.links
    found: list[Any] = [world.cycles_visibility.scatter]
    for node in nodes:
        sockets = [_plain(each) for each in node.inputs if hasattr(each, "default_value")]
        found.append([node.name, node.mute, *sockets, *_image_state(getattr(node, "image", None))])
    for link in links:
        ends = (link.from_node.name, link.from_socket.name, link.to_node.name, link.to_socket.name)
        found.append([*ends, link.is_muted])
    return json.dumps(found)


def _plain(socket: bpy.types.NodeSocket) -> Any:
    value = socket.default_value
    return value if isinstance(value, float | int | str) else list(value)


def _image_state(image: bpy.types.Image | None) -> list[Any]:
    if image is None:
        return []
    space = image.colorspace_settings.name
    return [image.name_full, image.session_uid, image.filepath, *image.size, image.is_dirty, space]


# The lights of the one world that was read last, by its state.
_READ: dict[str, tuple[EnvironmentLight, ...]] = {}


def _world_lights(world: bpy.types.World) -> tuple[EnvironmentLight, ...]:
    state = world_state(world)
    if state not in _READ:
        _READ.clear()
        _READ[state] = read_world(world)
    return _READ[state]
