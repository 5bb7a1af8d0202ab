"""Materials: the medium that is read against what Cycles renders of the original."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import pytest
from blender_scenes import assert_mean, render
from plates import (
    DENSITY,
    VOXEL,
    Material,
    coefficients,
    plate,
    predicted,
    scatter_and_absorption,
)

from volillum_addon.blender.medium_reader import MediumSettings
from volillum_addon.blender.nodes import Tree
from volillum_addon.blender.scene_reader import read_scene
from volillum_addon.core.errors import InputError


def principled(tree: Tree) -> bpy.types.Node:
    node = tree.node("ShaderNodeVolumePrincipled")
    node.inputs["Color"].default_value = (0.9, 0.6, 0.2, 1)
    node.inputs["Absorption Color"].default_value = (0.5, 0.1, 0.0, 1)
    node.inputs["Anisotropy"].default_value = 0.3
    # Cycles 5.2.3 renders a volume object as empty when nothing is linked to its density.
    node.inputs["Density Attribute"].default_value = ""
    tree.feed(node.inputs["Density"], tree.attribute("density"))
    return node


def named_attribute(tree: Tree) -> bpy.types.Node:
    """Density 0.5 density + 0 = 1 times the attribute, 2."""
    node = principled(tree)
    node.inputs["Density Attribute"].default_value = "density"
    for link in list(node.inputs["Density"].links):
        tree.tree.links.remove(link)
    node.inputs["Density"].default_value = 0.8
    return node


def glowing(tree: Tree) -> bpy.types.Node:
    """Absorption and emission alone: Cycles' 0 bounces scatter the medium's own light once."""
    node = tree.node("ShaderNodeVolumeCoefficients")
    density, tint = tree.attribute("density"), tree.attribute("tint")
    tree.feed(node.inputs["Absorption Coefficients"], tree.vector("MULTIPLY", tint, (1, 2, 1)))
    node.inputs["Scatter Coefficients"].default_value = (0, 0, 0)
    red = tree.vector("MULTIPLY", density, (0.1, 0, 0))
    emission = tree.vector("MULTIPLY_ADD", tint, (0.1, 0.1, 0.1), red)
    tree.feed(node.inputs["Emission Coefficients"], emission)
    return node


def conversions(tree: Tree) -> bpy.types.Node:
    """A colour and a vector that become numbers, a mix, components taken apart and put together."""
    node = tree.node("ShaderNodeVolumePrincipled")
    node.inputs["Density Attribute"].default_value = ""
    node.inputs["Color"].default_value = (0.7, 0.7, 0.7, 1)
    parts = tree.node("ShaderNodeSeparateXYZ")
    tree.feed(parts.inputs[0], tree.attribute("tint"))
    swapped = tree.combine(parts.outputs["Z"], parts.outputs["Y"], 0.0)
    mix = tree.node("ShaderNodeMix", data_type="RGBA", blend_type="ADD")
    sockets = {socket.identifier: socket for socket in mix.inputs}
    sockets["Factor_Float"].default_value = 0.25
    tree.feed(sockets["A_Color"], swapped)
    tree.feed(sockets["B_Color"], tree.attribute("density"))
    result = next(s for s in mix.outputs if s.identifier == "Result_Color")
    scaled = tree.node("ShaderNodeMath", operation="MULTIPLY_ADD")  # colour to number
    tree.feed(scaled.inputs[0], result)
    scaled.inputs[1].default_value = 0.5
    tree.feed(scaled.inputs[2], tree.attribute("tint"))  # vector to number
    tree.feed(node.inputs["Density"], scaled.outputs[0])
    return node


def emission_with_absorption(tree: Tree) -> bpy.types.Node:
    glow = tree.node("ShaderNodeEmission")
    glow.inputs["Color"].default_value = (1, 0.5, 0.25, 1)
    tree.feed(glow.inputs["Strength"], tree.attribute("density"))
    both = tree.node("ShaderNodeAddShader")
    absorb = tree.node("ShaderNodeVolumeAbsorption")
    absorb.inputs["Color"].default_value = (0.2, 0.9, 0.5, 1)
    tree.feed(absorb.inputs["Density"], tree.attribute("density"))
    for socket, node in zip(both.inputs, (glow, absorb), strict=True):
        tree.tree.links.new(node.outputs[0], socket)
    return both


MATERIALS = (principled, coefficients, scatter_and_absorption, conversions, glowing,
             emission_with_absorption)  # fmt: skip


@pytest.mark.parametrize("material", MATERIALS)
def test_a_material_is_read_as_cycles_renders_it(tmp_path: Path, material: Material) -> None:
    scene = plate(tmp_path, material)
    reading = read_scene(scene)
    assert_mean(render(scene, tmp_path, 256), predicted(reading), 3e-3)


def test_a_density_attribute_multiplies_the_density(tmp_path: Path) -> None:
    medium = read_scene(plate(tmp_path, named_attribute)).scene.medium
    linked = read_scene(plate(tmp_path, principled)).scene.medium
    assert np.allclose(medium.sigma_t.values, 0.8 * linked.sigma_t.values, rtol=1e-6)
    assert np.allclose(medium.sigma_s.values, 0.8 * linked.sigma_s.values, rtol=1e-6)


def test_the_constant_glow_of_a_principled_volume(tmp_path: Path) -> None:
    def material(tree: Tree) -> bpy.types.Node:
        node = principled(tree)
        node.inputs["Color"].default_value = (0, 0, 0, 1)
        node.inputs["Emission Strength"].default_value = 0.1
        node.inputs["Emission Color"].default_value = (1, 0.5, 0.1, 1)
        return node

    scene = plate(tmp_path, material)
    reading = read_scene(scene)
    assert "glow" in reading.notes[0]
    emission = 0.1 * np.array([1, 0.5, 0.1])
    assert np.allclose(reading.scene.medium.emission.values, emission, rtol=1e-6)
    # In Blender the padding glows as well: its box reaches from index -1 to 13, where the voxels
    # are 0 to 11. The line integral over it, seen from its end, of the trilinear profile.
    fine = 1000
    at = 13 - (np.arange(14 * fine) + 0.5) / fine
    profile = np.clip(np.minimum(at + 1, 12 - at), 0, 1)[:, None]
    sigma_t = reading.scene.medium.sigma_t.values[12, 12, 6].astype(np.float64)
    step = VOXEL[2] / fine
    depth = np.cumsum(profile * sigma_t * step, axis=0) - profile * sigma_t * step / 2
    wanted = (emission * np.exp(-depth) * step).sum(axis=0)
    assert_mean(render(scene, tmp_path, 64), wanted, 3e-3)


def test_without_a_material_the_settings_apply(tmp_path: Path) -> None:
    scene = plate(tmp_path, None)
    settings = MediumSettings(density_scale=3.0, albedo=(0.5, 0.6, 0.7))
    reading = read_scene(scene, density_grid="density", settings=settings)
    medium = reading.scene.medium
    assert np.allclose(medium.sigma_t.values[..., 0], 3.0 * DENSITY)
    assert np.allclose(medium.constant_albedo, (0.5, 0.6, 0.7), atol=1e-6)
    assert "no material" in reading.notes[0]


def ramp(tree: Tree) -> bpy.types.Node:
    node = tree.node("ShaderNodeVolumeScatter")
    ramped = tree.node("ShaderNodeValToRGB")
    tree.feed(ramped.inputs[0], tree.attribute("density"))
    tree.feed(node.inputs["Color"], ramped.outputs[0])
    return node


def squared(tree: Tree) -> bpy.types.Node:
    node = tree.node("ShaderNodeVolumeScatter")
    product = tree.node("ShaderNodeMath", operation="MULTIPLY")
    for socket in product.inputs[:2]:
        tree.feed(socket, tree.attribute("density"))
    tree.feed(node.inputs["Density"], product.outputs[0])
    return node


def constant(tree: Tree) -> bpy.types.Node:
    return tree.node("ShaderNodeVolumeScatter")


def blackbody(tree: Tree) -> bpy.types.Node:
    node = principled(tree)
    node.inputs["Blackbody Intensity"].default_value = 1
    return node


def rayleigh(tree: Tree) -> bpy.types.Node:
    node = scatter_and_absorption(tree)
    tree.tree.nodes["Volume Scatter"].phase = "RAYLEIGH"
    return node


def elsewhere(tree: Tree) -> bpy.types.Node:
    node = tree.node("ShaderNodeVolumeScatter")
    tree.feed(node.inputs["Density"], tree.attribute("missing"))
    return node


@pytest.mark.parametrize(
    ("material", "message"),
    [
        (ramp, r"node 'Color Ramp' .*cannot be read; supported: Attribute"),
        (squared, r"node 'Math' .*multiplies grid 'density' by grid 'density'"),
        (constant, r"'original' has constant scattering .*expected it in proportion to a grid"),
        (blackbody, r"node 'Principled Volume' .*has blackbody emission"),
        (rayleigh, r"node 'Volume Scatter' .*phase function RAYLEIGH; expected HENYEY_GREENSTEIN"),
        (elsewhere, r"grid 'missing' is not in .*plate.vdb; expected one of"),
        (lambda tree: tree.node("ShaderNodeMixShader"), r"'Mix Shader' .*supported: Principled"),
    ],
)
def test_a_material_without_a_plain_meaning_is_refused_by_name(
    tmp_path: Path, material: Material, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        read_scene(plate(tmp_path, material))
