"""Sequences: moving lights, cameras, media and VDB sequences baked and shown in sync."""

from __future__ import annotations

import json
from pathlib import Path

import bpy
import numpy as np
import pytest
from blender_scenes import write_grids
from plumes import plume

from volillum_addon.bake.frame_files import files
from volillum_addon.bake.vdb import read_metadata, read_vdb
from volillum_addon.blender import showing, staleness, work
from volillum_addon.blender.render import render_image, set_cycles
from volillum_addon.models.registry import MODELS

MODEL = "multidirectional_occlusion"


@pytest.fixture(autouse=True)
def quick(scene: bpy.types.Scene) -> None:
    scene.volillum.model = MODEL
    for model in MODELS:
        group = getattr(scene.volillum, model)
        if "directions" in group.bl_rna.properties:
            group.directions = 8
    scene.frame_start, scene.frame_end = 2, 4
    scene.frame_set(3)


def placed(scene: bpy.types.Scene, kind: str) -> bpy.types.Object:
    return next(each for each in scene.objects if each.type == kind)


def bake(scene: bpy.types.Scene) -> list[Path]:
    """The sequence's files, in order."""
    assert bpy.ops.volillum.bake_frames() == {"FINISHED"}
    assert scene.frame_current == 3
    return list(files(Path(scene.volillum.baked.path)).values())


def turn_sun(scene: bpy.types.Scene) -> None:
    sun = placed(scene, "LIGHT")
    for frame, angle in ((2, 0.0), (4, 0.4)):
        sun.rotation_euler[0] = angle
        sun.keyframe_insert("rotation_euler", frame=frame)


def image(scene: bpy.types.Scene, folder: Path, frame: int) -> np.ndarray:
    """What is shown at a frame, under one name: Cycles' jitter depends on it."""
    scene.frame_set(frame)
    scene.volillum.baked.shown.name = "shown"
    set_cycles(scene, 4, 1)
    scene.cycles.volume_biased = True
    scene.cycles.max_bounces = scene.cycles.volume_bounces = 0
    return render_image(scene, 24, 24, folder)[..., :3].astype(np.float64)


def test_a_turning_sun(scene: bpy.types.Scene) -> None:
    turn_sun(scene)
    paths = bake(scene)
    assert [path.stem[-5:] for path in paths] == ["_0002", "_0003", "_0004"]
    hashes = {read_metadata(path)["hash"] for path in paths}
    assert len(hashes) == 3
    baked = scene.volillum.baked
    assert (baked.frames, baked.model, baked.found) == (3, MODEL, False)
    for frame in (2, 3, 4):
        scene.frame_set(frame)
        assert staleness.changes(scene, work.chosen_volume(scene)) == ()
    scene.frame_set(5)
    (change,) = staleness.changes(scene, work.chosen_volume(scene))
    assert change == "frame 5 is outside of the baked 2 to 4"
    scene.frame_set(3)
    assert bake(scene) == paths
    assert baked.found
    # Three directions are three solutions; nothing that depends on no sun is solved again.
    scene.volillum.model = "spherical_harmonics"
    coefficients = bake(scene)
    assert len({read_metadata(path)["hash"] for path in coefficients}) == 1


def test_what_is_shown_is_each_frames_bake(scene: bpy.types.Scene, tmp_path: Path) -> None:
    turn_sun(scene)
    sun = placed(scene, "LIGHT")
    for frame, energy in ((2, 1.0), (3, 5.0), (4, 2.0)):
        sun.data.energy = energy
        sun.data.keyframe_insert("energy", frame=frame)
    paths = bake(scene)
    materials = len(bpy.data.materials)
    assert bpy.ops.volillum.show() == {"FINISHED"}
    assert scene.frame_current == 3
    assert len(bpy.data.materials) == materials + 1
    played = {frame: image(scene, tmp_path, frame) for frame in (2, 3, 4)}
    shown = scene.volillum.baked.shown
    for frame, path in zip((2, 3, 4), paths, strict=True):
        scene.frame_set(frame)
        assert staleness.shown_differs(scene, work.chosen_volume(scene)) == ""
        assert shown.data.grids.load()
        assert Path(shown.data.grids.frame_filepath) == path
    # Beside each frame's own bake, shown alone.
    scene.volillum.baked.frames = 0
    for frame, path in zip((2, 3, 4), paths, strict=True):
        scene.frame_set(frame)
        showing.show(scene, path)
        alone = image(scene, tmp_path, frame)
        # The key frames are floats of the same constants: rounding alone remains.
        np.testing.assert_allclose(played[frame], alone, rtol=1e-5, atol=1e-6 * alone.max())
    means = [played[frame].mean() for frame in (2, 3, 4)]
    assert means[1] > 2 * means[2] > 2 * means[0]


def test_a_sun_that_starts_on_an_axis_is_shown(scene: bpy.types.Scene, tmp_path: Path) -> None:
    # There most of its harmonics are 0: terms that the other frames have are missing.
    scene.volillum.model = "spherical_harmonics"
    for index, angle in enumerate((0.0, 0.2, 0.4)):
        sun = placed(scene, "LIGHT")
        sun.rotation_euler = (angle, 0, 0)
        sun.keyframe_insert("rotation_euler", frame=2 + index)
    paths = bake(scene)
    bpy.ops.volillum.show()
    played = {frame: image(scene, tmp_path, frame) for frame in (2, 4)}
    scene.volillum.baked.frames = 0
    for frame, path in ((2, paths[0]), (4, paths[2])):
        scene.frame_set(frame)
        showing.show(scene, path)
        alone = image(scene, tmp_path, frame)
        # Sums of more terms round otherwise.
        np.testing.assert_allclose(played[frame], alone, rtol=1e-5, atol=1e-6 * alone.max())


def test_a_changed_light_is_noticed_at_its_frame(scene: bpy.types.Scene) -> None:
    turn_sun(scene)
    bake(scene)
    bpy.ops.volillum.show()
    placed(scene, "LIGHT").data.energy *= 2
    said = staleness.shown_differs(scene, work.chosen_volume(scene))
    assert said.startswith("The lights have changed")


def test_lights_that_come_and_go_are_shown(scene: bpy.types.Scene, tmp_path: Path) -> None:
    sun = placed(scene, "LIGHT")
    copy = bpy.data.objects.new("second", sun.data.copy())
    copy.rotation_euler = (1.2, 0.3, 0)
    scene.collection.objects.link(copy)
    for frame, hidden, energy in ((2, True, 1.0), (3, False, 0.0), (4, False, 3.0)):
        copy.hide_render = hidden
        copy.keyframe_insert("hide_render", frame=frame)
        copy.data.energy = energy
        copy.data.keyframe_insert("energy", frame=frame)
    paths = bake(scene)
    bpy.ops.volillum.show()
    played = {frame: image(scene, tmp_path, frame) for frame in (2, 3, 4)}
    scene.volillum.baked.frames = 0
    for frame, path in zip((2, 3, 4), paths, strict=True):
        scene.frame_set(frame)
        showing.show(scene, path)
        alone = image(scene, tmp_path, frame)
        np.testing.assert_allclose(played[frame], alone, rtol=1e-5, atol=1e-6 * alone.max())
    assert played[4].mean() > 1.2 * played[3].mean() == pytest.approx(1.2 * played[2].mean())


def test_a_moving_camera_is_followed_by_what_sees_it(scene: bpy.types.Scene) -> None:
    camera = scene.camera
    for frame in (2, 4):
        camera.location[2] += 1
        camera.keyframe_insert("location", frame=frame)
    assert len({read_metadata(path)["hash"] for path in bake(scene)}) == 1
    scene.volillum.model = "directional_occlusion"
    assert len({read_metadata(path)["hash"] for path in bake(scene)}) == 3


def test_a_changing_medium(scene: bpy.types.Scene) -> None:
    material = placed(scene, "VOLUME").data.materials[0]
    shader = next(n for n in material.node_tree.nodes if "Density" in n.inputs)
    density = shader.inputs["Density"]
    socket = density.links[0].from_node.inputs[0] if density.is_linked else density
    constants = [
        s for n in material.node_tree.nodes for s in n.inputs
        if not s.is_linked and s.enabled and s.type == "VALUE" and n.type in ("MATH", "VECT_MATH")
    ]  # fmt: skip
    target = constants[0] if density.is_linked and constants else socket
    before = float(target.default_value)
    for frame, factor in ((2, 1.0), (4, 2.0)):
        target.default_value = before * factor
        target.keyframe_insert("default_value", frame=frame)
    paths = bake(scene)
    peaks = [float(read_vdb(path).medium.sigma_t.values.max()) for path in paths]
    assert peaks[2] == pytest.approx(2 * peaks[0], rel=1e-5)
    assert peaks[0] < peaks[1] < peaks[2]


def test_a_vdb_sequence(scene: bpy.types.Scene, tmp_path: Path) -> None:
    grid = plume()
    for frame in (2, 3, 4):
        write_grids(tmp_path / f"puff_{frame:04d}.vdb", grid.with_values(grid.values * frame))
    data = placed(scene, "VOLUME").data
    data.filepath = str(tmp_path / "puff_0002.vdb")
    data.is_sequence, data.frame_start, data.frame_duration, data.frame_offset = True, 2, 3, 1
    paths = bake(scene)
    assert [path.name.split(".")[0] for path in paths] == ["puff"] * 3
    peaks = [float(read_vdb(path).medium.sigma_t.values.max()) for path in paths]
    np.testing.assert_allclose(np.array(peaks) / peaks[0], [1, 1.5, 2], rtol=1e-5)
    bpy.ops.volillum.show()
    assert scene.volillum.baked.shown.data.is_sequence
    # A frame without a file is named.
    scene.frame_end = 5
    with pytest.raises(
        RuntimeError, match=r"frame 5: the sequence of volume .* has no file at frame 5"
    ):
        bpy.ops.volillum.bake_frames()
    assert scene.frame_current == 3


def test_a_log_line_says_all_of_a_frame(scene: bpy.types.Scene) -> None:
    from volillum_addon.blender import animation
    from volillum_addon.core.control import Control

    directory = Path(scene.volillum.directory)
    (frame,) = animation.bake(scene, MODEL, {"directions": 8}, [7], directory, Control())
    said = json.loads(json.dumps(animation.described(frame)))
    assert said["frame"] == 7
    assert Path(said["path"]).is_file()
    assert said["hash"] == read_metadata(said["path"])["hash"]
    assert said["seconds_bake"] > 0
    assert not said["found"]


def test_a_composition_plays_in_sync(scene: bpy.types.Scene, tmp_path: Path) -> None:
    """The sun turns, so that each frame has its own bake; the sky gains."""
    scene.volillum.composition = "sun=multidirectional_occlusion,sky=spherical_harmonics"
    scene.volillum.spherical_harmonics.directions = 8
    turn_sun(scene)
    background = next(n for n in scene.world.node_tree.nodes if "Strength" in n.inputs)
    for frame, strength in ((2, 0.5), (4, 2.0)):
        background.inputs["Strength"].default_value = strength
        background.inputs["Strength"].keyframe_insert("default_value", frame=frame)
    paths = bake(scene)
    assert scene.volillum.baked.model == scene.volillum.composition
    bpy.ops.volillum.show()
    played = {frame: image(scene, tmp_path, frame) for frame in (2, 4)}
    scene.volillum.baked.frames = 0
    for frame, path in ((2, paths[0]), (4, paths[2])):
        scene.frame_set(frame)
        showing.show(scene, path)
        alone = image(scene, tmp_path, frame)
        np.testing.assert_allclose(played[frame], alone, rtol=1e-5, atol=1e-6 * alone.max())


def test_a_volume_that_moves_is_followed_while_its_bake_is_shown(scene: bpy.types.Scene) -> None:
    """It is hidden then, as are a light and a camera that the user does not care to see."""
    volume, sun = placed(scene, "VOLUME"), placed(scene, "LIGHT")
    turn_sun(scene)
    for frame in (2, 4):
        volume.location[0] = frame
        volume.keyframe_insert("location", frame=frame)
    assert bpy.ops.volillum.bake() == {"FINISHED"}
    assert bpy.ops.volillum.show() == {"FINISHED"}
    sun.hide_viewport = scene.camera.hide_viewport = True
    assert volume.hide_viewport
    paths = bake(scene)
    origins = [read_vdb(path).medium.sigma_t.index_to_world[0, 3] for path in paths]
    np.testing.assert_allclose(np.diff(origins), 1, rtol=1e-5)
    assert len({read_metadata(path)["inputs"]["light direction"] for path in paths}) == 3
    assert volume.hide_viewport
    assert sun.hide_viewport
    assert scene.camera.hide_viewport


def test_a_hidden_volume_that_was_moved_makes_its_bake_stale(scene: bpy.types.Scene) -> None:
    volume = placed(scene, "VOLUME")
    holder = bpy.data.objects.new("holder", None)
    scene.collection.objects.link(holder)
    volume.parent = holder
    scene.view_layers[0].update()
    bpy.ops.volillum.bake()
    bpy.ops.volillum.show()
    assert staleness.changes(scene, volume) == ()
    for moved in (volume, holder):
        before = moved.location.copy()
        moved.location[1] += 0.5
        scene.view_layers[0].update()
        assert staleness.changes(scene, volume) == ("the volume's place has changed",)
        bpy.ops.volillum.bake()
        assert staleness.changes(scene, volume) == ()
        moved.location = before
        scene.view_layers[0].update()
        assert staleness.changes(scene, volume) == ("the volume's place has changed",)
        bpy.ops.volillum.bake()
