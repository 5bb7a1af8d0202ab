"""Where things stand that are shown about a volume: across the camera's view, beside its box."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix
from numpy.typing import NDArray

from .nodes import Tree


@dataclass(frozen=True, eq=False)
class Place:
    """A volume as it is seen: `turn` [3, 3] has the columns right, up and toward the viewer;
    `middle` [3] of its box, which is `width` across and `height` high in the view."""

    turn: NDArray[np.float64]
    middle: NDArray[np.float64]
    width: float
    height: float

    def point(self, right: float, up: float) -> NDArray[np.float64]:
        """The world position so far from the middle, in widths across and below or above it."""
        across, along = self.turn[:, 0], self.turn[:, 1]
        return self.middle + self.width * right * across + self.width * up * along


def place_of(scene: bpy.types.Scene, corners: NDArray[np.float64]) -> Place:
    """Of a box with these corners [n, 3]."""
    turn = _view(scene)
    width, height = (float(np.ptp(corners @ turn[:, axis])) for axis in (0, 1))
    return Place(turn, (corners.min(0) + corners.max(0)) / 2, width, height)


def lattice_corners(entries: Mapping[str, Any]) -> NDArray[np.float64]:
    """World positions [8, 3] of the corners of a bake's lattice, by its metadata."""
    affine = np.array(entries["index_to_world"], np.float64)
    ends = [(-0.5, size - 0.5) for size in entries["shape"]]
    index = np.array(list(itertools.product(*ends)))
    return np.asarray(index @ affine[:3, :3].T + affine[:3, 3])


def write(
    text: str, size: float, where: Sequence[float] | NDArray[np.float64], place: Place,
    align: str = "CENTER",
) -> bpy.types.Object:  # fmt: skip
    """A text in plain white, whatever the light, facing the viewer; in no collection yet."""
    data = bpy.data.curves.new(text, "FONT")
    data.body, data.size, data.align_x = text, size, align
    data.materials.append(_white())
    placed = bpy.data.objects.new(text, data)
    placed.location = where
    placed.rotation_euler = Matrix(place.turn.tolist()).to_euler()
    return placed


def _white() -> bpy.types.Material:
    material = bpy.data.materials.new("Volillum text")
    tree = Tree(material.node_tree)
    light, output = tree.node("ShaderNodeEmission"), tree.node("ShaderNodeOutputMaterial")
    tree.feed(output.inputs["Surface"], light.outputs[0])
    return material


def _view(scene: bpy.types.Scene) -> NDArray[np.float64]:
    """Without a camera, as seen from -y."""
    if scene.camera is None:
        return np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]])
    axes = np.array(scene.camera.matrix_world, np.float64)[:3, :3]
    return np.asarray(axes / np.linalg.norm(axes, axis=0))
