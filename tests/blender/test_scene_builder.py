"""Demonstration scenes: framed, lit from where the preset says, and saved to work elsewhere."""

import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import get_args

import bpy
import numpy as np
import pytest
from bpy_extras.object_utils import world_to_camera_view
from mathutils import Vector
from plumes import plume_scene, write_plume

from volillum_addon.bake.grids import read_grid
from volillum_addon.blender import extent, scene_builder, scene_presets
from volillum_addon.blender.render import render_image, set_cycles
from volillum_addon.core.errors import InputError
from volillum_addon.readers.frames import VolumeFiles

pytestmark = pytest.mark.usefixtures("no_file_left_open")


@pytest.fixture
def scene(tmp_path: Path) -> Iterator[bpy.types.Scene]:
    with plume_scene(tmp_path / "plume.vdb") as made:
        yield made


def test_the_presets_there_are() -> None:
    assert scene_presets.names() == ("default", "smoke")
    for name in scene_presets.names():
        assert scene_presets.load(name).summary


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"up": "w"}, "up is 'w'; expected one of x, y, z"),
        ({"sun": {"azimuth": 0, "elevation": 0, "angle": 0, "irradiance": [-1, 0, 0]}}, "at least"),
        ({"camera": {"azimuth": 0}}, "missing"),
        ({"medium": {"optical_depth": 1, "albedo": [2, 0, 0]}}, "expected 0 to 1"),
        ({"extra": 1}, "extra"),
    ],
)
def test_a_wrong_preset_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, change: dict[str, object], complaint: str
) -> None:
    raw = json.loads((scene_presets.FOLDER / "default.json").read_text())
    (tmp_path / "wrong.json").write_text(json.dumps(raw | change))
    monkeypatch.setattr(scene_presets, "FOLDER", tmp_path)
    with pytest.raises(InputError, match=complaint):
        scene_presets.load("wrong")


def test_the_camera_frames_all_matter_within_the_margins(
    scene: bpy.types.Scene, tmp_path: Path
) -> None:
    grid = read_grid(tmp_path / "plume.vdb")
    margin = scene_presets.load("default").camera.margin
    matter = np.argwhere(grid.values > extent.HAZE * grid.values.max())
    places = [
        world_to_camera_view(scene, scene.camera, Vector(point))
        for point in grid.to_world(matter.astype(float))
    ]
    image = np.array([[place.x, place.y] for place in places])
    # In the units of Blender's view, 0 to 1; float32 matrices round to 1e-6.
    assert image.min() >= margin - 1e-4
    assert image.max() <= 1 - margin + 1e-4
    # And as near as that allows: two opposite sides touch their margins.
    tight = np.isclose(image.min(axis=0), margin, atol=1e-3) & np.isclose(
        image.max(axis=0), 1 - margin, atol=1e-3
    )
    assert tight.any()


def test_the_densest_line_has_the_presets_optical_depth(
    scene: bpy.types.Scene, tmp_path: Path
) -> None:
    grid = read_grid(tmp_path / "plume.vdb")
    material = next(each for each in scene.objects if each.type == "VOLUME").data.materials[0]
    shader = next(n for n in material.node_tree.nodes if "Density" in n.inputs)
    depths = [
        grid.values.sum(axis=axis, dtype=np.float64).max() * grid.voxel_size[axis]
        for axis in range(3)
    ]
    depth = max(depths) * shader.inputs["Density"].default_value
    assert depth == pytest.approx(scene_presets.load("default").medium.optical_depth, rel=1e-6)


def test_the_picture_is_lit_from_the_suns_side(scene: bpy.types.Scene, tmp_path: Path) -> None:
    set_cycles(scene, 16, 0)
    scene.cycles.max_bounces = scene.cycles.volume_bounces = 8
    image = render_image(scene, 32, 32, tmp_path)
    brightness, alpha = image[..., :3].mean(axis=-1), image[..., 3]
    solid = alpha > 0.9
    # The plume covers a good part of the picture but not its border.
    assert 0.2 < solid.mean() < 0.9
    assert alpha[[0, -1]].mean() < 0.02
    assert alpha[:, [0, -1]].mean() < 0.02
    # Neither black nor blown out: the view transform has its mid grey at 0.18 and white near 1.
    assert 0.1 < brightness[solid].mean() < 1.0
    # The sun stands to the left: the outer thirds of the solid part differ clearly.
    columns = np.nonzero(solid)[1]
    left, right = np.quantile(columns, [1 / 3, 2 / 3])
    position = np.arange(32)[None] + np.zeros((32, 1))
    bright, dark = solid & (position <= left), solid & (position >= right)
    assert brightness[bright].mean() > 1.3 * brightness[dark].mean()


def test_up_turns_the_files_axis_upward() -> None:
    for name in get_args(scene_presets.Axis):
        axis = Vector([0, 0, 0])
        axis["xyz".index(name[-1])] = -1 if name.startswith("-") else 1
        turned = scene_builder._upright(name) @ axis
        assert tuple(turned) == pytest.approx((0, 0, 1), abs=1e-6)
        assert scene_builder._upright(name).to_3x3().determinant() == pytest.approx(1)


def test_a_saved_scene_moves_together_with_its_volume(tmp_path: Path) -> None:
    here, there = tmp_path / "here", tmp_path / "there"
    here.mkdir()
    write_plume(here / "plume.vdb")
    preset = scene_presets.load("default")
    scene_builder.save_scene(VolumeFiles(here / "plume.vdb"), preset, here / "deep" / "plume.blend")
    assert sorted(path.name for path in here.rglob("*")) == ["deep", "plume.blend", "plume.vdb"]
    shutil.move(here, there)
    with bpy.data.libraries.load(str(there / "deep" / "plume.blend")) as (found, _):
        assert found.scenes == ["plume"]
        assert sorted(found.objects) == ["Camera", "Sun", "plume"]
    bpy.ops.wm.open_mainfile(filepath=str(there / "deep" / "plume.blend"))
    data = bpy.data.volumes["plume"]
    assert data.grids.load(), data.grids.error_message
    assert bpy.context.scene.camera.name == "Camera"
    assert bpy.context.scene.world.name == "Sky"


def test_a_saved_scene_opens_on_what_its_camera_sees(tmp_path: Path) -> None:
    write_plume(tmp_path / "plume.vdb")
    preset = scene_presets.load("default")
    scene_builder.save_scene(VolumeFiles(tmp_path / "plume.vdb"), preset, tmp_path / "plume.blend")
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "plume.blend"))
    areas = [area for screen in bpy.data.screens for area in screen.areas]
    spaces = [area.spaces.active for area in areas if area.type == "VIEW_3D"]
    assert spaces
    for space in spaces:
        assert space.region_3d.view_perspective == "CAMERA"
        assert space.shading.type == "MATERIAL"
        assert space.shading.use_scene_lights
        assert space.shading.use_scene_world


def test_a_folder_that_cannot_be_written_is_an_error(tmp_path: Path) -> None:
    files = VolumeFiles(write_plume(tmp_path / "plume.vdb"))
    (tmp_path / "file").write_text("")
    preset = scene_presets.load("default")
    with pytest.raises(OSError, match="file"):
        scene_builder.save_scene(files, preset, tmp_path / "file" / "x.blend")
