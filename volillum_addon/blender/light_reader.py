"""Blender's lights and world as lights of the core, in Cycles' units."""

from __future__ import annotations

import math

import bpy
import numpy as np
from mathutils import Euler
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.lights import (
    AreaLight,
    DistantLight,
    EnvironmentLight,
    Light,
    PointLight,
    SpotLight,
)
from .fields import link_source, node_place, read_constant, unsupported

WORLD_SUPPORTED = "Background with a constant colour or an Environment Texture, and Add Shader"
# A spot whose axes are scaled unequally by more than this has an elliptic cone.
SAME_SCALE = 1e-4


def read_lights(scene: bpy.types.Scene) -> tuple[Light, ...]:
    """Every light that the scene renders its volume with: light objects first, then the world."""
    lights = [read_light(placed) for placed in light_objects(scene)]
    return (*lights, *(read_world(scene.world) if scene.world is not None else ()))


def light_objects(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """The scene's light objects that are rendered and shine on volumes."""
    return [
        placed
        for placed in rendered_objects(scene)
        if placed.type == "LIGHT"
        and placed.visible_volume_scatter
        and not (placed.data.type == "AREA" and placed.data.cycles.is_portal)
    ]


def rendered_objects(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """Objects of the first view layer that are not hidden from render, in a fixed order."""
    found: dict[str, bpy.types.Object] = {}

    def visit(layer: bpy.types.LayerCollection) -> None:
        if layer.exclude or layer.collection.hide_render:
            return
        for placed in layer.collection.objects:
            if not placed.hide_render:
                found[placed.name_full] = placed
        for child in layer.children:
            visit(child)

    root = scene.view_layers[0].layer_collection
    if root is not None:  # as in a scene that has never been looked at
        visit(root)
    return [found[name] for name in sorted(found)]


def read_light(placed: bpy.types.Object) -> Light:
    """One light object."""
    data = placed.data
    where = f"light {placed.name!r}"
    if not data.normalize:
        raise InputError(f"{where} has Normalize switched off; expected it on")
    strength = _strength(data)
    matrix = np.array(placed.matrix_world, dtype=np.float64)
    position, backward = matrix[:3, 3], matrix[:3, 2]
    if data.type == "SUN":
        return DistantLight(backward, strength, data.angle)
    if data.type == "POINT":
        return PointLight(position, strength / (4 * math.pi))
    if data.type == "SPOT":
        scale = np.linalg.norm(matrix[:3, :3], axis=0)
        if np.ptp(scale) > SAME_SCALE * scale.max():
            raise InputError(f"{where} is scaled by {np.round(scale, 4).tolist()}; expected evenly")
        intensity = strength / (4 * math.pi)
        return SpotLight(position, -backward, intensity, data.spot_size, data.spot_blend)
    if data.spread < math.pi - 1e-4:
        raise InputError(
            f"{where} has a spread of {math.degrees(data.spread):.4g} degrees; expected 180"
        )
    ellipse = data.shape in ("DISK", "ELLIPSE")
    height = data.size_y if data.shape in ("RECTANGLE", "ELLIPSE") else data.size
    size = np.linalg.norm(matrix[:3, :2], axis=0) * (data.size, height)
    return AreaLight(position, -backward, strength / math.pi, size, ellipse, matrix[:3, 0])


def _strength(data: bpy.types.Light) -> NDArray[np.float64]:
    """Energy times all of the light's colours, RGB."""
    strength: NDArray[np.float64] = np.array(data.color, dtype=np.float64)
    strength = strength * (data.energy * 2.0**data.exposure)
    if data.use_temperature:
        strength = strength * np.array(data.temperature_color, dtype=np.float64)
    if data.node_tree is None:
        return strength
    output = data.node_tree.get_output_node("CYCLES")
    source = link_source(output.inputs["Surface"]) if output is not None else None
    if source is None:
        return np.zeros(3)
    if source.node.bl_idname != "ShaderNodeEmission" or source.node.mute:
        raise unsupported(source.node, "an Emission node with constants")
    inputs = source.node.inputs
    return np.asarray(strength * read_constant(inputs["Color"]) * read_constant(inputs["Strength"]))


def read_world(world: bpy.types.World) -> tuple[EnvironmentLight, ...]:
    """The world's light on volumes; nothing for a black world."""
    output = world.node_tree.get_output_node("CYCLES") if world.node_tree else None
    source = link_source(output.inputs["Surface"]) if output is not None else None
    if source is None or not world.cycles_visibility.scatter:
        return ()
    return tuple(_backgrounds(source.node))


def _backgrounds(node: bpy.types.Node) -> list[EnvironmentLight]:
    if node.bl_idname == "ShaderNodeAddShader" and not node.mute:
        sources = [link_source(socket) for socket in node.inputs]
        return [light for s in sources if s is not None for light in _backgrounds(s.node)]
    if node.bl_idname != "ShaderNodeBackground" or node.mute:
        raise unsupported(node, WORLD_SUPPORTED)
    strength = read_constant(node.inputs["Strength"])
    source = link_source(node.inputs["Color"])
    if source is not None and source.node.bl_idname == "ShaderNodeTexEnvironment":
        if not np.any(strength):
            return []
        return [_image_light(source.node, strength)]
    colour = read_constant(node.inputs["Color"]) * strength
    return [EnvironmentLight(colour)] if np.any(colour) else []


def _image_light(node: bpy.types.Node, strength: NDArray[np.float64]) -> EnvironmentLight:
    if node.projection != "EQUIRECTANGULAR":
        raise InputError(
            f"{node_place(node)} has the projection {node.projection}; expected EQUIRECTANGULAR"
        )
    if node.image is None:
        raise InputError(f"{node_place(node)} has no image; expected one")
    return EnvironmentLight(_pixels(node.image) * strength, _rotation(node.inputs["Vector"]))


def _rotation(socket: bpy.types.NodeSocket) -> NDArray[np.float64] | None:
    """World directions to the image's, 3 x 3; None for as they are."""
    source = link_source(socket)
    if source is None:
        return None
    node = source.node
    if node.bl_idname == "ShaderNodeTexCoord" and source.name == "Generated":
        return None
    if node.bl_idname != "ShaderNodeMapping" or node.mute:
        raise unsupported(node, "a Mapping node with a rotation, or nothing")
    # Sockets that the type of mapping does not have are there, but switched off.
    inputs = {socket.identifier: socket for socket in node.inputs if socket.enabled}
    scaled = "Scale" in inputs and not np.allclose(read_constant(inputs["Scale"]), 1)
    moved = "Location" in inputs and np.any(read_constant(inputs["Location"]))
    if scaled or moved or node.vector_type == "NORMAL":
        raise InputError(f"{node_place(node)} moves or scales; expected a rotation alone")
    turn = np.array(Euler(tuple(read_constant(inputs["Rotation"])), "XYZ").to_matrix())
    if node.vector_type == "TEXTURE":
        turn = turn.T
    before = _rotation(inputs["Vector"])
    return turn if before is None else turn @ before


def _pixels(image: bpy.types.Image) -> NDArray[np.float64]:
    """Linear RGB [h, w, 3], top row first."""
    width, height = image.size
    if width == 0 or height == 0:
        raise InputError(f"image {image.name!r} has no pixels (missing file?); expected an image")
    flat = np.empty(width * height * image.channels, np.float32)
    image.pixels.foreach_get(flat)
    pixels = flat.reshape(height, width, image.channels)[::-1]
    colour = pixels[..., :3] if image.channels >= 3 else np.repeat(pixels[..., :1], 3, -1)
    colour = colour.astype(np.float64)
    # Float images are converted to the working space when they are loaded, byte images are not.
    space = image.colorspace_settings.name
    if not image.is_float and space != "Non-Color":
        if space != "sRGB":
            raise InputError(
                f"image {image.name!r} is in {space!r}; expected 'sRGB' or a float image"
            )
        colour = np.where(colour <= 0.04045, colour / 12.92, ((colour + 0.055) / 1.055) ** 2.4)
    return colour
