"""Showing a sequence of bakes in sync with the scene."""

from __future__ import annotations

from pathlib import Path

import bpy

from ..bake.vdb import read_vdb
from ..core.errors import InputError
from ..models.illuminate import relight
from .display import display_material, grid_limit
from .frames import files, kept_frame
from .light_reader import read_lights
from .sandbox import load_volume


def show_frames(
    first: Path, scene: bpy.types.Scene, collection: bpy.types.Collection
) -> bpy.types.Object:
    """A volume object that plays the sequence, under the lights as they are at each frame.

    What differs between the frames' materials (lights that move or change, an albedo) are their
    constants: these get key frames. Raises InputError where the frames need unlike materials.
    """
    paths = files(first)
    material, constants = None, {}
    with kept_frame(scene):
        for frame, path in paths.items():
            scene.frame_set(frame)
            volume = relight(read_vdb(path), read_lights(scene))
            made = display_material(first.stem, volume, grid_limit(scene))
            constants[frame] = _constants(made)
            if material is None:
                material = made
            else:
                bpy.data.materials.remove(made)
    assert material is not None  # a sequence has a frame
    try:
        _key(material, constants)
        data = load_volume(first)
    except InputError:
        bpy.data.materials.remove(material)
        raise
    start = min(paths)
    # Blender plays the file `frame - frame_start + 1 + frame_offset`: here the frame's own.
    data.is_sequence, data.frame_start, data.frame_duration = True, start, len(paths)
    data.frame_offset = start - 1
    data.materials.append(material)
    shown = bpy.data.objects.new(first.stem, data)
    collection.objects.link(shown)
    return shown


# A node's kind and, per socket of it, the constant there (None: none, or a link).
type Constants = list[tuple[str, list[tuple[float, ...] | None]]]


def _constants(material: bpy.types.Material) -> Constants:
    return [
        (node.bl_idname, [_constant(socket) for socket in node.inputs])
        for node in material.node_tree.nodes
    ]


def _constant(socket: bpy.types.NodeSocket) -> tuple[float, ...] | None:
    if socket.is_linked or not hasattr(socket, "default_value"):
        return None
    value = socket.default_value
    return (value,) if isinstance(value, float) else tuple(value)


def _key(material: bpy.types.Material, constants: dict[int, Constants]) -> None:
    """Key frames for the constants of the material that are not the same at every frame."""
    frames = sorted(constants)
    for frame in frames[1:]:
        if _shape(constants[frame]) != _shape(constants[frames[0]]):
            raise InputError(
                f"frame {frame} needs another material than frame {frames[0]} (a light or a term "
                "comes or goes); expected the same lights at every frame, dimmed to 0 when they "
                "are off"
            )
    for index, node in enumerate(material.node_tree.nodes):
        for place, socket in enumerate(node.inputs):
            values = {frame: constants[frame][index][1][place] for frame in frames}
            if len(set(values.values())) == 1:
                continue
            for frame, value in values.items():
                assert value is not None  # links are the same at every frame
                socket.default_value = value[0] if len(value) == 1 else value
                socket.keyframe_insert("default_value", frame=frame)


def _shape(constants: Constants) -> list[tuple[str, list[bool]]]:
    return [(kind, [value is None for value in values]) for kind, values in constants]
