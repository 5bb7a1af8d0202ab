"""The material of a volume that was seen through a transfer function."""

from __future__ import annotations

import bpy

from ..readers.medium_file import ABSORPTION, EMISSION, SCATTERING
from .nodes import Tree


def medium_material(name: str, glows: bool = False) -> bpy.types.Material:
    """A new material that renders the coefficients of such a file as they are."""
    material = bpy.data.materials.new(name)
    show_medium(material, glows)
    return material


def plain_material(
    name: str, grid: str, scale: float, albedo: tuple[float, float, float]
) -> bpy.types.Material:
    """A new material of extinction `scale` times the grid, per unit of length, and this albedo."""
    material = bpy.data.materials.new(name)
    tree = Tree(material.node_tree)
    node = tree.node("ShaderNodeVolumeCoefficients")
    density = tree.positive(grid)
    shares = {"Scatter": albedo, "Absorption": tuple(1 - each for each in albedo)}
    for part, share in shares.items():
        weight = tuple(scale * each for each in share)
        tree.feed(node.inputs[f"{part} Coefficients"], tree.vector("MULTIPLY", density, weight))
    tree.feed(node.inputs["Emission Coefficients"], (0, 0, 0))
    output = tree.node("ShaderNodeOutputMaterial")
    tree.feed(output.inputs["Volume"], node.outputs["Volume"])
    return material


def show_medium(material: bpy.types.Material, glows: bool = False) -> None:
    """Make the material's volume shader read the coefficients, `glows`: emission too; other nodes
    stay."""
    nodes = material.node_tree.nodes
    for node in [node for node in nodes if node.bl_idname in SHADER_NODES]:
        nodes.remove(node)
    tree = Tree(material.node_tree, keep=True)
    output = tree.node("ShaderNodeOutputMaterial")
    volume = tree.node("ShaderNodeVolumeCoefficients")
    tree.feed(volume.inputs["Scatter Coefficients"], tree.attribute(SCATTERING))
    tree.feed(volume.inputs["Absorption Coefficients"], tree.attribute(ABSORPTION))
    emission = tree.attribute(EMISSION) if glows else (0, 0, 0)
    tree.feed(volume.inputs["Emission Coefficients"], emission)
    tree.tree.links.new(volume.outputs["Volume"], output.inputs["Volume"])


SHADER_NODES = {
    "ShaderNodeOutputMaterial", "ShaderNodeVolumeCoefficients", "ShaderNodeAttribute",
    "ShaderNodeVolumePrincipled", "ShaderNodeBsdfPrincipled",
}  # fmt: skip


def phase_socket(material: bpy.types.Material) -> bpy.types.NodeSocket | None:
    """Where the phase function's g is set, while the shader is the one made here."""
    for node in material.node_tree.nodes:
        if node.bl_idname == "ShaderNodeVolumeCoefficients":
            return node.inputs["Anisotropy"]
    return None
