"""What a chain of shader nodes computes, as long as that is linear in the volume's grids."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import bpy
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.errors import InputError

# Blender's conversion of a colour to a number (linear Rec.709); a vector becomes its mean.
LUMINANCE = np.tile([0.2126, 0.7152, 0.0722], (3, 1))
MEAN = np.full((3, 3), 1 / 3)
SUPPORTED = (
    "Attribute, Volume Info, Value, RGB, Combine and Separate XYZ or Color, and Math, Vector Math "
    "or Mix nodes that multiply or add constants"
)
VOLUME_INFO = {"Density": "density", "Color": "color", "Flame": "flame",
               "Temperature": "temperature"}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Field:
    """constant [3] + the sum over grids of matrix [3, 3] @ grid value (a scalar counts thrice)."""

    constant: NDArray[np.float64]
    grids: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)

    @classmethod
    def of(cls, value: ArrayLike | float) -> Field:
        """A constant field."""
        return cls(np.broadcast_to(np.asarray(value, np.float64), (3,)).copy())

    def __add__(self, other: Field) -> Field:
        grids = dict(self.grids)
        for name, matrix in other.grids.items():
            grids[name] = grids.get(name, np.zeros((3, 3))) + matrix
        return Field(self.constant + other.constant, grids)

    def mapped(self, matrix: NDArray[np.float64]) -> Field:
        """The matrix applied to the field's values."""
        grids = {name: matrix @ old for name, old in self.grids.items()}
        return Field(matrix @ self.constant, grids)

    def times(self, other: Field, where: str) -> Field:
        """The product by component; one of the two has to be constant."""
        if not self.grids:
            return other.mapped(np.diag(self.constant))
        if not other.grids:
            return self.mapped(np.diag(other.constant))
        raise InputError(
            f"{where} multiplies {_names(self)} by {_names(other)}; expected a constant on one "
            "side (what is linear in the grids)"
        )


def _names(value: Field) -> str:
    return "grid " + " + ".join(repr(name) for name in value.grids)


def node_place(node: bpy.types.Node) -> str:
    """How a complaint names a node: its name, kind and tree."""
    return f"node {node.name!r} ({node.bl_label}) in {node.id_data.name!r}"


def unsupported(node: bpy.types.Node, supported: str) -> InputError:
    """The complaint about a node that has no plain meaning."""
    return InputError(f"{node_place(node)} cannot be read; supported: {supported}")


def link_source(socket: bpy.types.NodeSocket) -> bpy.types.NodeSocket | None:
    """The output that feeds this input, through reroutes; None when it is not linked."""
    while socket.is_linked:
        link = socket.links[0]
        if link.is_muted:
            return None
        if link.from_node.bl_idname != "NodeReroute":
            return link.from_socket
        socket = link.from_node.inputs[0]
    return None


def read_input(socket: bpy.types.NodeSocket) -> Field:
    """What arrives at an input socket."""
    source = link_source(socket)
    if source is None:
        value = socket.default_value
        return Field.of(value if isinstance(value, float | int) else tuple(value)[:3])
    result = _read_output(source)
    if socket.type == "VALUE" and source.type != "VALUE":
        return result.mapped(LUMINANCE if source.type == "RGBA" else MEAN)
    return result


def read_constant(socket: bpy.types.NodeSocket) -> NDArray[np.float64]:
    """What arrives at an input socket that must not vary in space."""
    result = read_input(socket)
    if result.grids:
        raise InputError(
            f"{socket.name} of {node_place(socket.node)} varies with {_names(result)}; "
            "expected a constant"
        )
    return result.constant


def _read_output(output: bpy.types.NodeSocket) -> Field:
    node = output.node
    if node.mute:
        raise InputError(f"{node_place(node)} is muted; expected it to be removed or switched on")
    kind = node.bl_idname
    if kind == "ShaderNodeValue":
        return Field.of(output.default_value)
    if kind == "ShaderNodeRGB":
        return Field.of(tuple(output.default_value)[:3])
    if kind == "ShaderNodeAttribute" and (
        node.attribute_type == "GEOMETRY" and output.name in ("Color", "Vector", "Factor")
    ):
        matrix = MEAN if output.name == "Factor" else np.eye(3)
        return Field(np.zeros(3), {node.attribute_name: matrix})
    if kind == "ShaderNodeVolumeInfo":
        return Field(np.zeros(3), {VOLUME_INFO[output.name]: np.eye(3)})
    by_component = kind.endswith("XYZ") or getattr(node, "mode", "") == "RGB"
    if kind in ("ShaderNodeCombineXYZ", "ShaderNodeCombineColor") and by_component:
        parts = [
            read_input(socket).mapped(np.diag(np.eye(3)[axis]))
            for axis, socket in enumerate(node.inputs)
        ]
        return parts[0] + parts[1] + parts[2]
    if kind in ("ShaderNodeSeparateXYZ", "ShaderNodeSeparateColor") and by_component:
        axis = list(node.outputs).index(output)
        return read_input(node.inputs[0]).mapped(np.tile(np.eye(3)[axis], (3, 1)))
    if kind in ("ShaderNodeMath", "ShaderNodeVectorMath"):
        return _read_math(node)
    if kind == "ShaderNodeMix":
        return _read_mix(node)
    raise unsupported(node, SUPPORTED)


def _read_math(node: bpy.types.Node) -> Field:
    where, operation = node_place(node), node.operation
    if getattr(node, "use_clamp", False):
        raise InputError(f"{where} clamps; expected Clamp off")
    terms = [read_input(socket) for socket in node.inputs if socket.enabled]
    if operation == "ADD":
        return terms[0] + terms[1]
    if operation == "SUBTRACT":
        return terms[0] + terms[1].mapped(-np.eye(3))
    if operation in ("MULTIPLY", "SCALE"):
        return terms[0].times(terms[1], where)
    if operation == "MULTIPLY_ADD":
        return terms[0].times(terms[1], where) + terms[2]
    if operation == "DIVIDE" and not terms[1].grids and np.all(terms[1].constant != 0):
        return terms[0].mapped(np.diag(1 / terms[1].constant))
    raise unsupported(node, SUPPORTED)


def _read_mix(node: bpy.types.Node) -> Field:
    where = node_place(node)
    suffix = {"FLOAT": "_Float", "VECTOR": "_Vector", "RGBA": "_Color"}.get(node.data_type)
    colour_mix = node.data_type == "RGBA"
    if suffix is None or (colour_mix and node.clamp_result):
        raise unsupported(node, SUPPORTED)
    by_component = node.data_type == "VECTOR" and node.factor_mode == "NON_UNIFORM"
    sockets = {socket.identifier: socket for socket in node.inputs}
    share = read_constant(sockets["Factor_Vector" if by_component else "Factor_Float"])
    if node.clamp_factor:
        share = np.clip(share, 0, 1)
    first, second = read_input(sockets["A" + suffix]), read_input(sockets["B" + suffix])
    blend = node.blend_type if colour_mix else "MIX"
    if blend == "MULTIPLY":
        second = first.times(second, where)
    elif blend == "ADD":
        second = first + second
    elif blend != "MIX":
        raise unsupported(node, SUPPORTED)
    return first.mapped(np.diag(1 - share)) + second.mapped(np.diag(share))
