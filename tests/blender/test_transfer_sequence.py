"""A VDB sequence through one transfer function: imported, changed, baked and played by frame."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace

import bpy
import numpy as np
import pytest
from puffs import FRAMES, empty_file, puffs
from recording_layout import RecordingLayout
from settling import settle

from volillum_addon.bake.frame_files import files, frame_file
from volillum_addon.bake.vdb import read_metadata, read_vdb
from volillum_addon.blender import (
    child,
    importing,
    live,
    live_session,
    panels,
    staleness,
    transfer,
    transfer_panel,
    work,
)
from volillum_addon.blender.scene_reader import read_scene
from volillum_addon.core.control import Control
from volillum_addon.core.medium import Medium
from volillum_addon.readers import transfer_presets
from volillum_addon.readers.formats import read_volume
from volillum_addon.readers.medium_file import medium_of


@pytest.fixture
def lit(scene: bpy.types.Scene, tmp_path: Path) -> bpy.types.Scene:
    """A lit scene whose volume is the imported sequence, by the preset `smoke`."""
    before = scene.objects["plume"]
    before.hide_render = before.hide_viewport = True
    scene.frame_start, scene.frame_end = FRAMES[0], FRAMES[-1]
    scene.frame_set(3)
    scene.volillum.model = "multidirectional_occlusion"
    scene.volillum.multidirectional_occlusion.directions = 8
    bpy.ops.volillum.import_volume(filepath=str(puffs(tmp_path / "in")), transfer="smoke")
    return scene


def material(scene: bpy.types.Scene) -> bpy.types.Material:
    found = transfer.material_of(scene)
    assert found is not None
    return found


def drawn(panel: type, scene: bpy.types.Scene) -> RecordingLayout:
    layout = RecordingLayout()
    panel.draw(SimpleNamespace(layout=layout), SimpleNamespace(scene=scene))
    return layout


def change(scene: bpy.types.Scene) -> None:
    """Another ramp, without a unit of anything."""
    transfer.ramp_node(material(scene)).color_ramp.elements[-1].color = (0.2, 0.4, 0.6, 0.8)
    material(scene).volillum.per_voxel = 0.7


def expected(scene: bpy.types.Scene, folder: Path, frame: int) -> Medium:
    """The function on the frame's own file."""
    grid, about = read_volume(folder / "in" / f"puff_{frame:04d}.vdb")
    return medium_of(grid, about, transfer.read(material(scene))).trimmed(0)


def read_at(scene: bpy.types.Scene, frame: int) -> Medium:
    scene.frame_set(frame)
    volume = work.chosen_volume(scene)
    assert volume is not None
    volume.matrix_world = np.eye(4)
    return read_scene(scene, volume).scene.medium.trimmed(0)


def assert_same(found: Medium, wanted: Medium) -> None:
    for a, b in ((found.sigma_t, wanted.sigma_t), (found.sigma_s, wanted.sigma_s)):
        wide = b.values if b.channels == a.channels else b.values[..., None].repeat(3, -1)
        # sigma_t is put together again from two float32; a ramp's places are float32.
        np.testing.assert_allclose(a.values, wide, rtol=1e-5, atol=1e-6 * b.values.max())
        np.testing.assert_allclose(a.index_to_world, b.index_to_world, atol=1e-6)


def test_every_frame_is_the_one_functions_medium(lit: bpy.types.Scene, tmp_path: Path) -> None:
    data = lit.volillum.volume.data
    assert (data.is_sequence, data.frame_start, data.frame_duration) == (True, 2, 3)
    for frame in FRAMES:
        assert_same(read_at(lit, frame), expected(lit, tmp_path, frame))
    # The preset's range is the sequence's, not a frame's: smoke goes from 0 to the bright voxels.
    whole = transfer.about(material(lit))
    grids = [read_volume(tmp_path / "in" / f"puff_{frame:04d}.vdb")[0].values for frame in FRAMES]
    assert whole.low == 0
    assert whole.high == max(float(values.max()) for values in grids)
    assert sum(whole.histogram) == pytest.approx(sum(values.size for values in grids), abs=200)
    wanted = transfer_presets.load("smoke", whole)
    np.testing.assert_allclose(transfer.read(material(lit)).values, wanted.values, rtol=1e-5)


def test_apply_makes_every_frame_anew(lit: bpy.types.Scene, tmp_path: Path) -> None:
    data = lit.volillum.volume.data
    # A retimed sequence stays retimed.
    data.frame_start, data.frame_offset, before = 12, 1, data.filepath
    change(lit)
    assert "Not applied yet" in " ".join(drawn(transfer_panel.VOLILLUM_PT_transfer, lit).labels())
    assert bpy.ops.volillum.apply_transfer() == {"FINISHED"}
    assert data.filepath != before
    assert (data.is_sequence, data.frame_start, data.frame_offset) == (True, 12, 1)
    for frame in FRAMES:
        assert_same(read_at(lit, 10 + frame), expected(lit, tmp_path, frame))
    labels = " ".join(drawn(transfer_panel.VOLILLUM_PT_transfer, lit).labels())
    assert "Not applied yet" not in labels
    assert "in all 3 frames together" in labels


def test_frames_bake_and_play_in_sync(lit: bpy.types.Scene) -> None:
    change(lit)
    bpy.ops.volillum.apply_transfer()
    assert bpy.ops.volillum.bake_frames() == {"FINISHED"}
    assert lit.frame_current == 3
    bakes = files(Path(lit.volillum.baked.path))
    assert tuple(bakes) == FRAMES
    assert len({read_metadata(path)["hash"] for path in bakes.values()}) == 3
    for frame, path in bakes.items():
        lit.frame_set(frame)
        wanted = work.read(lit).scene.trimmed(2).medium
        np.testing.assert_array_equal(read_vdb(path).medium.sigma_t.values, wanted.sigma_t.values)
        assert staleness.changes(lit, work.chosen_volume(lit)) == ()
    assert bpy.ops.volillum.show() == {"FINISHED"}
    for frame, path in bakes.items():
        lit.frame_set(frame)
        shown = lit.volillum.baked.shown
        assert shown.data.grids.load()
        assert Path(shown.data.grids.frame_filepath) == path
    # Another function: what was baked is stale at every frame, and says so.
    material(lit).volillum.per_voxel = 0.2
    bpy.ops.volillum.apply_transfer()
    assert staleness.changes(lit, work.chosen_volume(lit)) == (
        "the volume's file or grid has changed",
    )


def test_the_command_line_bakes_them_and_goes_on_where_it_was(
    lit: bpy.types.Scene, tmp_path: Path
) -> None:
    copy = child.save_copy()
    line = ["bake", str(copy.file), "--scene", lit.name, "--model", "ambient_occlusion",
            "--frames", "2-4", "-o", str(tmp_path / "bakes")]  # fmt: skip
    with copy:
        first = [json.loads(each) for each in child.run(line, Control())]
        assert [each["frame"] for each in first] == list(FRAMES)
        Path(first[1]["path"]).unlink()
        again = [json.loads(each) for each in child.run(line, Control())]
    assert [each["found"] for each in again] == [True, False, True]
    assert [each["path"] for each in again] == [each["path"] for each in first]


def test_a_volume_in_the_scene_is_given_a_function(scene: bpy.types.Scene, tmp_path: Path) -> None:
    item = scene.objects["plume"]
    data = item.data
    data.materials.clear()
    scene.volillum.volume = item
    data.filepath = str(puffs(tmp_path / "in"))
    data.is_sequence, data.frame_start, data.frame_duration, data.frame_offset = True, 2, 3, 1
    place = item.matrix_world.copy()
    scene.frame_set(3)
    assert "volillum.add_transfer" in drawn(panels.VOLILLUM_PT_volume, scene).operators()
    assert bpy.ops.volillum.add_transfer() == {"FINISHED"}
    assert item.matrix_world == place
    assert (data.is_sequence, data.frame_start, data.frame_duration) == (True, 2, 3)
    assert material(scene).volillum.frames == 3
    for frame in FRAMES:
        assert_same(read_at(scene, frame), expected(scene, tmp_path, frame))
    # Now it has one, and keeps it.
    assert "volillum.add_transfer" not in drawn(panels.VOLILLUM_PT_volume, scene).operators()
    with pytest.raises(RuntimeError, match=r"has a material; expected none \(remove it first\)"):
        bpy.ops.volillum.add_transfer()


def test_a_volume_that_stands_still_is_given_one(scene: bpy.types.Scene) -> None:
    item = scene.objects["plume"]
    item.data.materials.clear()
    wanted = read_volume(bpy.path.abspath(item.data.filepath))
    assert bpy.ops.volillum.add_transfer() == {"FINISHED"}
    assert material(scene).volillum.frames == 0
    found = read_at(scene, 1)
    function = transfer.read(material(scene))
    assert_same(found, medium_of(*wanted, function).trimmed(0))


def test_one_file_of_a_sequence_can_be_taken_alone(scene: bpy.types.Scene, tmp_path: Path) -> None:
    first = puffs(tmp_path / "in")
    for arguments in ({}, {"transfer": "smoke"}):
        bpy.ops.volillum.import_volume(filepath=str(first), sequence=False, **arguments)
        assert not scene.volillum.volume.data.is_sequence
    assert material(scene).volillum.frames == 0
    assert transfer.about(material(scene)).high == read_volume(first)[0].values.max()


def test_a_fitted_sequence_fits_at_every_frame(lit: bpy.types.Scene, tmp_path: Path) -> None:
    item = lit.volillum.volume
    matrix = np.array(item.matrix_world)
    corners = np.concatenate(
        [read_volume(tmp_path / "in" / f"puff_{f:04d}.vdb")[0].corners() for f in FRAMES]
    )
    placed = corners @ matrix[:3, :3].T + matrix[:3, 3]
    assert np.ptp(placed, axis=0).max() == pytest.approx(importing.FITTED, rel=1e-5)
    np.testing.assert_allclose(placed.min(axis=0) + placed.max(axis=0), 0, atol=1e-5)


def test_an_empty_frame_plays_and_is_named_where_it_cannot_be_baked(
    scene: bpy.types.Scene, tmp_path: Path
) -> None:
    first = puffs(tmp_path / "in")
    empty_file(frame_file(first, 1))
    scene.objects["plume"].hide_render = scene.objects["plume"].hide_viewport = True
    bpy.ops.volillum.import_volume(filepath=str(first), transfer="smoke")
    data = scene.volillum.volume.data
    assert (data.frame_start, data.frame_duration) == (1, 4)
    assert len(files(Path(bpy.path.abspath(data.filepath)))) == 4
    assert transfer.about(material(scene)).high > 1
    scene.frame_start, scene.frame_end = 1, 2
    with pytest.raises(RuntimeError, match=r"frame 1: .*or a range without this frame"):
        bpy.ops.volillum.bake_frames()
    scene.frame_start = 2
    assert bpy.ops.volillum.bake_frames() == {"FINISHED"}


def test_what_is_missing_or_wrong_is_said(lit: bpy.types.Scene, tmp_path: Path) -> None:
    data = lit.volillum.volume.data
    before = data.filepath
    for stop in transfer.ramp_node(material(lit)).color_ramp.elements:
        stop.color[3] = 0
    there = set((tmp_path / "out").iterdir())
    with pytest.raises(RuntimeError, match=r"makes all of puff_0002\.vdb clear"):
        bpy.ops.volillum.apply_transfer()
    assert data.filepath == before
    assert set((tmp_path / "out").iterdir()) == there
    change(lit)
    frame_file(transfer.source_of(material(lit)), 3).unlink()
    with pytest.raises(RuntimeError, match=r"_0003\.vdb; expected every imported frame \(import"):
        bpy.ops.volillum.apply_transfer()


def test_values_that_moved_with_their_sequence_are_found(
    lit: bpy.types.Scene, tmp_path: Path
) -> None:
    (tmp_path / "out").rename(tmp_path / "moved")
    data = lit.volillum.volume.data
    data.filepath = str(tmp_path / "moved" / Path(data.filepath).name)
    change(lit)
    assert bpy.ops.volillum.apply_transfer() == {"FINISHED"}
    assert_same(read_at(lit, 4), expected(lit, tmp_path, 4))


def test_a_bake_of_one_frame_is_stale_at_another(lit: bpy.types.Scene) -> None:
    volume = work.chosen_volume(lit)
    bpy.ops.volillum.bake()
    assert staleness.changes(lit, volume) == ()
    lit.frame_set(4)
    assert staleness.changes(lit, volume) == ("the frame of the volume's sequence has changed",)
    lit.frame_set(3)
    assert staleness.changes(lit, volume) == ()


def test_live_follows_the_frame(lit: bpy.types.Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live, "REST_SECONDS", 0.0)
    followed = live_session.start(lit)
    try:
        for frame in (3, 4, 2):
            lit.frame_set(frame)
            settle(followed)
            shown = Path(bpy.path.abspath(lit.volillum.baked.shown.data.filepath))
            wanted = work.read(lit).scene.trimmed(2).medium.sigma_t.values
            np.testing.assert_array_equal(read_vdb(shown).medium.sigma_t.values, wanted)
    finally:
        live_session.stop()
