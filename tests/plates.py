"""A plate whose image in Cycles shows every coefficient of its medium that is read wrongly.

Lit along the view, it has the radiance
    F / (4 pi) sigma_s / sigma_t (1 - exp(-2 b)) / 2 + emission / sigma_t (1 - exp(-b))
with b = sigma_t times its depth, per colour.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import bpy
import numpy as np
from blender_scenes import add_light, block, new_scene, orthographic, write_grids

from volillum_addon.blender.nodes import Tree
from volillum_addon.blender.render import add_camera
from volillum_addon.blender.scene_reader import Reading

SHAPE, VOXEL, DENSITY = (24, 24, 12), (0.1, 0.1, 1 / 32), 2.0
DEPTH = 12 / 32
Material = Callable[[Tree], bpy.types.Node]


def plate(folder: Path, material: Material | None, matrix: np.ndarray | None = None,
          space: str = "WORLD") -> bpy.types.Scene:  # fmt: skip
    """The plate with a material, lit by a sun behind the camera."""
    density = block(SHAPE, VOXEL, DENSITY, "density")
    colour = density.with_values(np.full((*SHAPE, 3), (0.5, 1.0, 1.5), np.float32), "tint")
    scene, placed = new_scene(write_grids(folder / "plate.vdb", density, colour), matrix)
    placed.data.render.space = space
    if material is not None:
        made = bpy.data.materials.new("original")
        tree = Tree(made.node_tree)
        output = tree.node("ShaderNodeOutputMaterial")
        tree.feed(output.inputs["Volume"], material(tree).outputs[0])
        placed.data.materials.append(made)
    add_light(scene, "SUN", 4.0).data.angle = 0
    add_camera(scene, orthographic(0.3), (1, 20))
    return scene


def predicted(reading: Reading, depth: float = DEPTH) -> np.ndarray:
    """The radiance of the plate's middle by the medium that was read."""
    medium = reading.scene.medium
    middle = tuple(n // 2 for n in medium.sigma_t.shape)
    sigma_t, sigma_s = (
        np.broadcast_to(grid.values[middle].astype(np.float64), (3,))
        for grid in (medium.sigma_t, medium.sigma_s)
    )
    emission = np.zeros(3) if medium.emission is None else medium.emission.values[middle]
    b = sigma_t * depth
    fluence = reading.scene.lights[0].fluence(np.zeros(3))
    g = medium.g
    phase = (1 - g**2) / (1 + g**2 + 2 * g) ** 1.5  # backward, times 4 pi
    return phase * fluence / (4 * math.pi) * sigma_s / sigma_t * (
        1 - np.exp(-2 * b)
    ) / 2 + emission / sigma_t * (1 - np.exp(-b))


def coefficients(tree: Tree) -> bpy.types.Node:
    node = tree.node("ShaderNodeVolumeCoefficients")
    density, tint = tree.attribute("density"), tree.attribute("tint")
    tree.feed(node.inputs["Scatter Coefficients"], tree.vector("MULTIPLY", tint, (1, 0.8, 0.6)))
    tree.feed(node.inputs["Absorption Coefficients"], tree.vector("SCALE", density))
    tree.tree.nodes[-1].inputs["Scale"].default_value = 0.3
    return node


def scatter_and_absorption(tree: Tree) -> bpy.types.Node:
    scatter = tree.node("ShaderNodeVolumeScatter")
    scatter.inputs["Color"].default_value = (0.9, 0.5, 0.7, 1)
    scatter.inputs["Anisotropy"].default_value = -0.2
    absorb = tree.node("ShaderNodeVolumeAbsorption")
    absorb.inputs["Color"].default_value = (0.2, 0.9, 0.5, 1)
    info = tree.node("ShaderNodeVolumeInfo").outputs["Density"]
    half = tree.node("ShaderNodeMath", operation="DIVIDE")
    tree.feed(half.inputs[0], info)
    half.inputs[1].default_value = 2
    tree.feed(scatter.inputs["Density"], half.outputs[0])
    tree.feed(absorb.inputs["Density"], info)
    both = tree.node("ShaderNodeAddShader")
    for socket, node in zip(both.inputs, (scatter, absorb), strict=True):
        tree.tree.links.new(node.outputs[0], socket)
    return both
