"""Where the volume of a scene is, how its grids lie, and which one is meant."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import pytest
from blender_scenes import assert_mean, blob, new_scene, render, write_grids
from mathutils import Euler, Matrix
from plates import DEPTH, VOXEL, coefficients, plate, predicted, scatter_and_absorption

from volillum_addon.blender.nodes import Tree
from volillum_addon.blender.scene_reader import read_scene
from volillum_addon.core.errors import InputError

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


def test_the_volume_has_to_be_clear(tmp_path: Path) -> None:
    scene = plate(tmp_path, coefficients)
    placed = scene.objects["volume"]
    placed.hide_render = True
    with pytest.raises(InputError, match="rendered volumes are none; expected one"):
        read_scene(scene)
    placed.hide_render = False
    second = placed.copy()
    scene.collection.objects.link(second)
    with pytest.raises(InputError, match=r"'volume', 'volume.001'; expected one \(choose"):
        read_scene(scene)
    assert read_scene(scene, volume_object=second).volume_object == "volume.001"
    second.data.filepath = str(tmp_path / "nowhere.vdb")
    with pytest.raises(InputError, match=r"nowhere.vdb is not there; expected the file of volume"):
        read_scene(scene, volume_object=second)
