"""Small helpers to write node trees as expressions."""

from __future__ import annotations

from collections.abc import Sequence

import bpy
import numpy as np

# A socket to link from, or a constant.
type Term = bpy.types.NodeSocket | float | Sequence[float]


class Tree:
    """An emptied node tree that is filled by expressions; `keep`: what it has stays."""

    def __init__(self, tree: bpy.types.NodeTree, keep: bool = False) -> None:
        if not keep:
            tree.nodes.clear()
        self.tree = tree
        self._attributes: dict[str, bpy.types.Node] = {}
        self._positive: dict[str, bpy.types.NodeSocket] = {}
        self._geometry: bpy.types.Node | None = None

    def node(self, kind: str, **properties: object) -> bpy.types.Node:
        """A new node with its properties set."""
        node = self.tree.nodes.new(kind)
        for name, value in properties.items():
            setattr(node, name, value)
        # Readable when a person opens the tree: columns in order of creation.
        count = len(self.tree.nodes) - 1
        node.location = (200 * (count // 6), -180 * (count % 6))
        return node

    def feed(self, socket: bpy.types.NodeSocket, term: Term) -> None:
        """Link `term` into the socket, or make it its constant."""
        if isinstance(term, bpy.types.NodeSocket):
            self.tree.links.new(term, socket)
        elif isinstance(socket.default_value, float):
            socket.default_value = term
        else:
            red, green, blue = np.broadcast_to(np.asarray(term, np.float64), (3,))
            socket.default_value = (red, green, blue, 1.0)[: len(socket.default_value)]

    def vector(self, operation: str, *terms: Term) -> bpy.types.NodeSocket:
        """A Vector Math node; its vector, or its value for DOT_PRODUCT."""
        node = self.node("ShaderNodeVectorMath", operation=operation)
        for socket, term in zip(node.inputs, terms, strict=False):
            self.feed(socket, term)
        return node.outputs["Value" if operation == "DOT_PRODUCT" else "Vector"]

    def math(self, operation: str, *terms: Term) -> bpy.types.NodeSocket:
        """A Math node's value."""
        node = self.node("ShaderNodeMath", operation=operation)
        for socket, term in zip(node.inputs, terms, strict=False):
            self.feed(socket, term)
        return node.outputs["Value"]

    def geometry(self, output: str) -> bpy.types.NodeSocket:
        """World `Position` of the shaded point, or `Incoming`, the unit vector toward the eye."""
        if self._geometry is None:
            self._geometry = self.node("ShaderNodeNewGeometry")
        return self._geometry.outputs[output]

    def combine(self, x: Term, y: Term, z: Term) -> bpy.types.NodeSocket:
        """The vector (x, y, z)."""
        node = self.node("ShaderNodeCombineXYZ")
        for socket, term in zip(node.inputs, (x, y, z), strict=True):
            self.feed(socket, term)
        return node.outputs[0]

    def sum(self, parts: Sequence[Term]) -> Term:
        """The sum of vectors."""
        if not parts:
            return (0, 0, 0)
        total = parts[0]
        for part in parts[1:]:
            total = self.vector("ADD", total, part)
        return total

    def attribute(self, grid: str) -> bpy.types.NodeSocket:
        """A grid of the volume as a vector; a scalar grid is three equal components."""
        if grid not in self._attributes:
            self._attributes[grid] = self.node("ShaderNodeAttribute", attribute_name=grid)
        return self._attributes[grid].outputs["Vector"]

    def component(self, name: str) -> bpy.types.NodeSocket:
        """A scalar grid, or a mesh's attribute, as a number."""
        return self.node("ShaderNodeAttribute", attribute_name=name).outputs["Fac"]

    def positive(self, grid: str) -> bpy.types.NodeSocket:
        """A grid without negative values, interpolated in full.

        Where a grid reaches a volume's coefficients through linear nodes alone, Cycles takes one
        random voxel for the trilinear interpolant: noise of some percent a sample, and a biased
        transmittance. A node that is not linear, here max(0, .), stops that.
        """
        if grid not in self._positive:
            self._positive[grid] = self.vector("MAXIMUM", self.attribute(grid), (0, 0, 0))
        return self._positive[grid]
