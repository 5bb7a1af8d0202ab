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
