"""The constants of a material's nodes: what differs between the displays of one bake under other
lights, or of the frames of a sequence."""

from __future__ import annotations

from collections.abc import Mapping

import bpy

# Per node: what it does, and per socket of it the constant there (None: none, or a link).
type Constants = list[tuple[str, list[tuple[float, ...] | None]]]


def constants(material: bpy.types.Material) -> Constants:
    """All of the material's constants, node by node."""
    return [
        (_kind(node), [_constant(socket) for socket in node.inputs])
        for node in material.node_tree.nodes
    ]


def same_nodes(first: Constants, second: Constants) -> bool:
    """Whether the two materials differ by their constants alone."""
    return _shape(first) == _shape(second)


def assign(material: bpy.types.Material, values: Constants) -> None:
    """Give the material the constants of another one with the same nodes."""
    for node, (_, inputs) in zip(material.node_tree.nodes, values, strict=True):
        for socket, value in zip(node.inputs, inputs, strict=True):
            if value is not None and value != _constant(socket):
                _set(socket, value)


def key_frames(material: bpy.types.Material, values: Mapping[int, Constants]) -> None:
    """Key frames for the constants that are not the same at every frame; all have the same
    nodes."""
    frames = sorted(values)
    for index, node in enumerate(material.node_tree.nodes):
        for place, socket in enumerate(node.inputs):
            by_frame = {frame: values[frame][index][1][place] for frame in frames}
            if len(set(by_frame.values())) == 1:
                continue
            for frame, value in by_frame.items():
                assert value is not None  # links are the same at every frame
                _set(socket, value)
                socket.keyframe_insert("default_value", frame=frame)


def _kind(node: bpy.types.Node) -> str:
    return " ".join(
        str(getattr(node, name, "")) for name in ("bl_idname", "operation", "attribute_name")
    )


def _constant(socket: bpy.types.NodeSocket) -> tuple[float, ...] | None:
    if socket.is_linked or not hasattr(socket, "default_value"):
        return None
    value = socket.default_value
    return (value,) if isinstance(value, float) else tuple(value)


def _set(socket: bpy.types.NodeSocket, value: tuple[float, ...]) -> None:
    socket.default_value = value[0] if len(value) == 1 else value


def _shape(values: Constants) -> list[tuple[str, list[bool]]]:
    return [(kind, [value is None for value in inputs]) for kind, inputs in values]
