"""Materials and transforms: the medium that is read against what Cycles renders of the original.

A plate that is lit along the view has the radiance
    F / (4 pi) sigma_s / sigma_t (1 - exp(-2 b)) / 2 + emission / sigma_t (1 - exp(-b))
with b = sigma_t times its depth, per colour: it shows every coefficient that is read wrongly.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import bpy
import numpy as np
import pytest
from blender_scenes import (
    add_light,
    assert_mean,
    blob,
    block,
    new_scene,
    orthographic,
    render,
    write_grids,
)
from mathutils import Euler, Matrix

from volillum_addon.blender.medium_reader import MediumSettings
from volillum_addon.blender.nodes import Tree
from volillum_addon.blender.render import add_camera
from volillum_addon.blender.scene_reader import Reading, read_scene
from volillum_addon.core.errors import InputError

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


# Unequal scales, a mirror and a shear; WORLD space, and OBJECT space with its own rule.
SCALES = {"even": (3.0, 3.0, 3.0), "uneven": (2.0, 3.0, 0.5), "mirrored": (-2.0, 3.0, 1.5),
          "sheared": (2.0, 1.5, 0.8)}  # fmt: skip


@pytest.mark.parametrize("space", ["WORLD", "OBJECT"])
@pytest.mark.parametrize("name", SCALES)
def test_a_transformed_volume_has_the_density_that_cycles_gives_it(
    tmp_path: Path, name: str, space: str
) -> None:
    scene = plate(tmp_path, scatter_and_absorption, np.diag([*SCALES[name], 1.0]), space)
    placed = scene.objects["volume"]
    if name == "sheared":  # a turned child of an unevenly scaled parent
        parent = bpy.data.objects.new("parent", None)
        scene.collection.objects.link(parent)
        parent.scale = SCALES[name]
        placed.parent = parent
        placed.scale = (1, 1, 1)
        placed.rotation_euler = (0, 0, 0.5)
    reading = read_scene(scene)
    matrix = np.array(placed.matrix_world)
    gram = matrix[:3, :3].T @ matrix[:3, :3]
    assert (abs(gram[0, 1]) > 0.1) == (name == "sheared")
    assert np.allclose(reading.scene.medium.sigma_t.index_to_world[:3, :3],
                       matrix[:3, :3] @ np.diag(VOXEL), atol=1e-6)  # fmt: skip
    depth = DEPTH * SCALES[name][2]
    assert_mean(render(scene, tmp_path, 256), predicted(reading, depth), 3e-3)


def test_a_rotated_and_moved_volume_is_where_blender_has_it(tmp_path: Path) -> None:
    turn = Matrix.Translation((1, 2, 3)) @ Euler((0.3, 0.4, 0.5)).to_matrix().to_4x4()
    scene = plate(tmp_path, coefficients, np.array(turn))
    reading = read_scene(scene)
    grid = reading.scene.medium.sigma_t
    assert np.allclose(grid.centre, (1, 2, 3), atol=1e-5)
    expected = np.array(turn) @ np.diag([*VOXEL, 1.0])
    assert np.allclose(grid.index_to_world[:3, :3], expected[:3, :3], atol=1e-6)
    assert (reading.stem, reading.volume_object) == ("plate", "volume")
    assert (reading.width, reading.height) == (1920, 1080)


def test_without_a_material_the_settings_apply(tmp_path: Path) -> None:
    scene = plate(tmp_path, None)
    settings = MediumSettings(density_scale=3.0, albedo=(0.5, 0.6, 0.7))
    reading = read_scene(scene, density_grid="density", settings=settings)
    medium = reading.scene.medium
    assert np.allclose(medium.sigma_t.values[..., 0], 3.0 * DENSITY)
    assert np.allclose(medium.constant_albedo, (0.5, 0.6, 0.7), atol=1e-6)
    assert "no material" in reading.notes[0]


def test_grids_with_different_boxes_are_laid_on_one_lattice(tmp_path: Path) -> None:
    density = blob(16, 2.0, 1.0, "density")
    flame = blob(16, 2.0, 0.5, "flame").crop((4, 3, 2), (14, 12, 13))
    scene, placed = new_scene(write_grids(tmp_path / "two.vdb", density, flame))
    made = bpy.data.materials.new("original")
    tree = Tree(made.node_tree)
    node = tree.node("ShaderNodeVolumeCoefficients")
    tree.feed(node.inputs["Scatter Coefficients"], tree.attribute("density"))
    node.inputs["Absorption Coefficients"].default_value = (0, 0, 0)
    tree.feed(node.inputs["Emission Coefficients"], tree.attribute("flame"))
    output = tree.node("ShaderNodeOutputMaterial")
    tree.feed(output.inputs["Volume"], node.outputs[0])
    placed.data.materials.append(made)
    medium = read_scene(scene).scene.medium
    assert medium.emission is not None
    index = density.to_index(medium.emission.to_world(np.array([[5.0, 6.0, 7.0]])))[0]
    at = tuple(np.round(index).astype(int))
    assert np.isclose(medium.emission.values[5, 6, 7], density.values[at] * 0.5, rtol=1e-5)
    assert medium.emission.values.sum() == pytest.approx(flame.values.sum(), rel=1e-5)


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


def test_the_volume_has_to_be_clear(tmp_path: Path) -> None:
    scene = plate(tmp_path, coefficients)
    placed = scene.objects["volume"]
    placed.hide_render = True
    with pytest.raises(InputError, match="rendered volumes are none; expected one"):
        read_scene(scene)
    placed.hide_render = False
    second = placed.copy()
    scene.collection.objects.link(second)
    with pytest.raises(InputError, match=r"'volume', 'volume.001'; expected one, or name it"):
        read_scene(scene)
    assert read_scene(scene, volume_object=second).volume_object == "volume.001"
    second.data.filepath = str(tmp_path / "nowhere.vdb")
    with pytest.raises(InputError, match=r"file is missing: .*nowhere.vdb"):
        read_scene(scene, volume_object=second)
