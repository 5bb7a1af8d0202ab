"""Only what is seen: from the panel's switch to the picture, and what makes it stale."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import bpy
import numpy as np
import pytest
from command_line import session
from settling import settle

from volillum_addon.bake.vdb import read_metadata, read_vdb
from volillum_addon.blender import live, live_session, staleness, work
from volillum_addon.blender.render import render_image, set_cycles

MODEL = "multidirectional_occlusion"


@pytest.fixture
def close(quick_models: bpy.types.Scene) -> bpy.types.Scene:
    """The scene through a long lens: a part of the volume fills the view."""
    quick_models.camera.data.lens *= 10
    quick_models.volillum.seen_only = True
    return quick_models


def changes(scene: bpy.types.Scene) -> tuple[str, ...]:
    scene.view_layers[0].update()
    return staleness.changes(scene, work.chosen_volume(scene))


def lit_voxels(path: str) -> int:
    return int(np.count_nonzero(read_vdb(path).channels["visibility_0"].values))


def picture(scene: bpy.types.Scene, folder: Path) -> np.ndarray:
    """What Show shows, under one name: Cycles' jitter depends on it."""
    bpy.ops.volillum.show(baked=True)
    scene.volillum.baked.shown.name = "shown"
    set_cycles(scene, 4, 1)
    scene.cycles.volume_biased = True
    scene.cycles.max_bounces = scene.cycles.volume_bounces = 0
    return render_image(scene, 24, 24, folder)[..., :3].astype(np.float64)


def test_the_picture_is_the_same_from_less(close: bpy.types.Scene, tmp_path: Path) -> None:
    found, voxels = {}, {}
    close.render.resolution_x = close.render.resolution_y = 24
    for only in (False, True):
        close.volillum.seen_only = only
        bpy.ops.volillum.bake()
        voxels[only] = lit_voxels(close.volillum.baked.path)
        found[only] = picture(close, tmp_path)
    assert voxels[True] < 0.7 * voxels[False]
    assert found[False].mean() > 0
    assert np.allclose(found[True], found[False], rtol=1e-5, atol=1e-5 * found[False].mean())


def test_what_makes_it_stale(close: bpy.types.Scene) -> None:
    bpy.ops.volillum.bake()
    assert changes(close) == ()
    close.camera.data.lens *= 1.1
    assert changes(close) == ("the view has changed",)
    bpy.ops.volillum.bake()
    close.render.resolution_x *= 2
    assert changes(close) == ("the view has changed",)
    bpy.ops.volillum.bake()
    close.volillum.seen_only = False
    assert changes(close) == ("only what the camera saw was baked",)
    bpy.ops.volillum.bake()
    assert changes(close) == ()
    close.volillum.seen_only = True
    assert changes(close) == ("all was baked",)


def test_a_camera_that_looks_away_is_refused(close: bpy.types.Scene) -> None:
    close.camera.rotation_euler[0] += np.pi
    with pytest.raises(RuntimeError, match="the camera sees of the volume is nothing"):
        bpy.ops.volillum.bake()


def test_each_frame_has_its_own_view(close: bpy.types.Scene) -> None:
    close.frame_start, close.frame_end = 1, 2
    for frame, lens in ((1, close.camera.data.lens), (2, close.camera.data.lens / 2)):
        close.camera.data.lens = lens
        close.camera.data.keyframe_insert("lens", frame=frame)
    close.frame_set(1)
    assert bpy.ops.volillum.bake_frames() == {"FINISHED"}
    first = Path(close.volillum.baked.path)
    second = first.with_name(first.name.replace("_0001", "_0002"))
    assert lit_voxels(str(first)) < lit_voxels(str(second))
    for frame in (1, 2):
        close.frame_set(frame)
        assert changes(close) == ()


@pytest.fixture
def followed(close: bpy.types.Scene, monkeypatch: pytest.MonkeyPatch) -> Iterator[live.Live]:
    monkeypatch.setattr(live, "COARSE_VOXELS", 500)
    monkeypatch.setattr(live, "REST_SECONDS", 0.0)
    yield live_session.start(close)
    live_session.stop()


def test_live_follows_the_view(close: bpy.types.Scene, followed: live.Live) -> None:
    paths = []
    for _ in range(2):
        settle(followed)
        paths.append(close.volillum.baked.path)
        assert "view" in read_metadata(paths[-1])["inputs"]
        close.camera.data.lens *= 1.2
    assert paths[0] != paths[1]


def test_the_command_line_asks_for_it(close: bpy.types.Scene, tmp_path: Path) -> None:
    close.volillum.seen_only = False
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "close.blend"), copy=True)
    asked = ["bake", "close.blend", "--scene", close.name, "--model", MODEL, "-o", "bakes"]
    asked += ["--set", "directions=8"]
    for result, seen_only in zip(
        session(tmp_path, asked, [*asked, "--seen-only"]), (False, True), strict=True
    ):
        assert result.status == 0, result.err
        inputs = read_metadata(tmp_path / result.out.strip())["inputs"]
        assert ("view" in inputs) == seen_only
