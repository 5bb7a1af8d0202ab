"""Live: what is shown follows the scene, by as little work as the model needs."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace

import bpy
import numpy as np
import pytest
from recording_layout import RecordingLayout
from settling import settle

from volillum_addon.bake.vdb import read_vdb
from volillum_addon.blender import live, live_session, panels, showing, staleness, work
from volillum_addon.blender.constants import constants, same_nodes
from volillum_addon.blender.display import show_bake
from volillum_addon.core.control import Control
from volillum_addon.models.registry import get


@pytest.fixture(autouse=True)
def quick(scene: bpy.types.Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    settings = scene.volillum
    for model in ("multidirectional_occlusion", "directional_occlusion", "spherical_harmonics"):
        getattr(settings, model).directions = 8
    settings.model = "multidirectional_occlusion"
    # The plume has some 3,000 voxels.
    monkeypatch.setattr(live, "COARSE_VOXELS", 500)
    monkeypatch.setattr(live, "REST_SECONDS", 0.0)


@pytest.fixture
def followed(scene: bpy.types.Scene) -> Iterator[live.Live]:
    yield live_session.start(scene)
    live_session.stop()


@pytest.fixture
def bakes(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What is baked from now on: `coarse` or `full`."""
    done: list[str] = []
    for name, inner in (("_coarse", live._coarse), ("bake_file", live.bake_file)):

        def counted(
            *arguments: object, name: str = name, inner: Callable[..., object] = inner
        ) -> object:
            done.append("coarse" if name == "_coarse" else "full")
            return inner(*arguments)

        monkeypatch.setattr(live, name, counted)
    return done


def placed(scene: bpy.types.Scene, kind: str) -> bpy.types.Object:
    return next(each for each in scene.objects if each.type == kind)


def shown_file(scene: bpy.types.Scene) -> Path:
    return Path(bpy.path.abspath(scene.volillum.baked.shown.data.filepath))


def assert_shown_as_show_would(scene: bpy.types.Scene) -> None:
    """The shown file and every constant of its material are those of the operator's bake."""
    shown = scene.volillum.baked.shown
    bpy.ops.volillum.bake()
    assert scene.volillum.baked.found
    fresh = show_bake(Path(scene.volillum.baked.path), scene, scene.collection)
    assert shown_file(scene) == Path(bpy.path.abspath(fresh.data.filepath))
    values, wanted = (constants(each.data.materials[0]) for each in (shown, fresh))
    assert same_nodes(values, wanted)
    assert values == wanted
    showing.discard(fresh)


def test_coarse_at_once_and_then_in_full(
    scene: bpy.types.Scene, followed: live.Live, bakes: list[str]
) -> None:
    before = len(bpy.data.volumes)
    while followed._shown is None:
        followed.look()
    coarse = read_vdb(shown_file(scene))
    assert coarse.medium.sigma_t.values.size <= 1000  # blocks at the border are not full
    assert coarse.medium.sigma_t.voxel_size.min() > 0.3
    assert followed.message.startswith("coarse after")
    messages = settle(followed)
    assert bakes == ["coarse", "full"]
    assert messages[-1].startswith("in full after")
    assert len(bpy.data.volumes) == before + 1
    assert placed(scene, "VOLUME").hide_viewport
    assert scene.volillum.baked.path == str(shown_file(scene))
    assert staleness.changes(scene, work.chosen_volume(scene)) == ()
    assert_shown_as_show_would(scene)
    # Nothing changes, so nothing is done.
    settle(followed)
    assert bakes == ["coarse", "full"]


def test_brightness_and_colour_only_relight(
    scene: bpy.types.Scene, followed: live.Live, bakes: list[str]
) -> None:
    settle(followed)
    done, sun = list(bakes), placed(scene, "LIGHT")
    material = scene.volillum.baked.shown.data.materials[0]
    sun.data.energy *= 2
    sun.data.color = (1, 0.5, 0.25)
    assert settle(followed)[-1].startswith("relit in")
    assert bakes == done
    assert scene.volillum.baked.shown.data.materials[0] == material
    assert_shown_as_show_would(scene)


@pytest.mark.parametrize("model", ["spherical_harmonics", "ambient_occlusion"])
def test_moved_lights_need_no_bake_where_the_equation_needs_none(
    scene: bpy.types.Scene, followed: live.Live, bakes: list[str], model: str
) -> None:
    scene.volillum.model = model
    settle(followed)
    done = list(bakes)
    placed(scene, "LIGHT").rotation_euler = (0.4, 0.3, 0.2)
    assert settle(followed)[-1].startswith("relit in")
    assert bakes == done
    assert_shown_as_show_would(scene)
    # A light on an axis has fewer terms: another material, and still no bake.
    placed(scene, "LIGHT").rotation_euler = (0, 0, 0)
    settle(followed)
    assert bakes == done
    assert_shown_as_show_would(scene)


def test_a_turned_sun_bakes_again_and_leaves_one_file(
    scene: bpy.types.Scene, followed: live.Live, bakes: list[str]
) -> None:
    settle(followed)
    for angle in (0.3, 0.5):
        placed(scene, "LIGHT").rotation_euler[0] += angle
        settle(followed)
    assert bakes == ["coarse", "full"] * 3
    assert_shown_as_show_would(scene)
    assert list(Path(scene.volillum.directory).iterdir()) == [shown_file(scene)]


def test_the_other_bake_stays_the_one_before_live(
    scene: bpy.types.Scene, followed: live.Live
) -> None:
    scene.volillum.model = "spherical_harmonics"
    assert bpy.ops.volillum.bake() == {"FINISHED"}
    before = scene.volillum.baked.path
    scene.volillum.model = "multidirectional_occlusion"
    settle(followed)
    for angle in (0.3, 0.5):
        placed(scene, "LIGHT").rotation_euler[0] += angle
        settle(followed)
    assert scene.volillum.other.path == before
    assert bpy.ops.volillum.swap() == {"FINISHED"}
    assert str(shown_file(scene)) == before


def test_the_camera_moves_only_what_sees_it(
    scene: bpy.types.Scene, followed: live.Live, bakes: list[str]
) -> None:
    settle(followed)
    scene.camera.location[2] += 1
    settle(followed)
    assert bakes == ["coarse", "full"]
    scene.volillum.model = "directional_occlusion"
    settle(followed)
    scene.camera.location[2] += 1
    settle(followed)
    assert bakes == ["coarse", "full"] * 3
    assert_shown_as_show_would(scene)


def test_a_full_bake_is_cancelled_by_a_change_and_the_last_result_stays(
    scene: bpy.types.Scene, followed: live.Live, monkeypatch: pytest.MonkeyPatch
) -> None:
    settle(followed)
    inner, waiting = live.bake_file, []

    def slow(*arguments: object) -> object:
        control = arguments[-1]
        assert isinstance(control, Control)
        waiting.append(control)
        while not control.native.cancelled and len(waiting) == 1:
            time.sleep(0.002)
        control.check()
        return inner(*arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(live, "bake_file", slow)
    group = scene.volillum.multidirectional_occlusion
    group.theta = math.radians(50)
    while not waiting:
        followed.look()
        time.sleep(0.002)
    # The user's changes do not wait for the full bake.
    shown = shown_file(scene)
    group.theta = math.radians(60)
    followed.look()
    assert shown_file(scene) == shown
    settle(followed)
    assert waiting[0].native.cancelled
    assert read_vdb(shown_file(scene)).parameters["theta"] == pytest.approx(math.radians(60))
    assert_shown_as_show_would(scene)


def test_what_cannot_be_served_is_said_and_the_last_result_stays(
    scene: bpy.types.Scene, followed: live.Live
) -> None:
    settle(followed)
    shown, sun = shown_file(scene), placed(scene, "LIGHT")
    sun.hide_render = True
    followed.look()
    assert "knows only lights of the kinds" in followed.message
    assert shown_file(scene) == shown
    sun.hide_render = False
    assert settle(followed)
    assert_shown_as_show_would(scene)


def test_what_an_undo_takes_away_is_shown_again(
    scene: bpy.types.Scene, followed: live.Live, bakes: list[str]
) -> None:
    settle(followed)
    path = shown_file(scene)
    showing.discard(scene.volillum.baked.shown)
    assert scene.volillum.baked.shown is None
    followed.look()
    assert shown_file(scene) == path
    assert bakes == ["coarse", "full"]


def test_stopping_leaves_a_full_bake_and_no_coarse_one(scene: bpy.types.Scene) -> None:
    live_session.start(scene)
    followed = live_session.current()
    assert followed is not None
    while followed._shown is None:
        followed.look()
    folder = Path(followed._folder.name)
    assert list(folder.iterdir())
    assert bpy.ops.volillum.live() == {"FINISHED"}
    assert live_session.current() is None
    assert not folder.exists()
    assert scene.volillum.baked.shown is None
    assert not placed(scene, "VOLUME").hide_viewport
    assert bpy.ops.volillum.live() == {"FINISHED"}
    followed = live_session.current()
    assert followed is not None
    settle(followed)
    path = shown_file(scene)
    assert bpy.ops.volillum.show(baked=False) == {"FINISHED"}
    assert live_session.current() is None
    assert path.is_file()


def test_it_ends_with_the_scene(scene: bpy.types.Scene) -> None:
    other = bpy.data.scenes.new("other")
    live_session.start(other)
    bpy.data.scenes.remove(other)
    assert live_session._look() is None
    assert live_session.current() is None
    assert scene.volillum  # which it had nothing to do with


def test_the_panel_says_what_it_does(scene: bpy.types.Scene, followed: live.Live) -> None:
    settle(followed)
    layout = RecordingLayout()
    panels.VOLILLUM_PT_bake.draw(SimpleNamespace(layout=layout), SimpleNamespace(scene=scene))
    assert "volillum.live" in layout.operators()
    assert " ".join(layout.labels()).count("in full after") == 1


def test_a_coarse_bake_has_the_same_optical_depth(scene: bpy.types.Scene) -> None:
    from volillum_addon.core.coarse import coarsened

    whole = work.read(scene).scene
    coarse = coarsened(whole, 500)
    total = [
        float(np.sum(each.medium.sigma_t.values, dtype=np.float64))
        * abs(np.linalg.det(each.medium.sigma_t.index_to_world[:3, :3]))
        for each in (whole, coarse)
    ]
    assert total[1] == pytest.approx(total[0], rel=1e-5)


def test_a_composition_is_followed(
    scene: bpy.types.Scene, followed: live.Live, bakes: list[str]
) -> None:
    pair = "sun=multidirectional_occlusion,sky=spherical_harmonics"
    scene.volillum.composition = pair
    settle(followed)
    assert scene.volillum.baked.model == pair
    assert read_vdb(shown_file(scene)).model == pair
    assert_shown_as_show_would(scene)
    done = list(bakes)
    background = next(n for n in scene.world.node_tree.nodes if "Strength" in n.inputs)
    background.inputs["Strength"].default_value *= 2
    assert settle(followed)[-1].startswith("relit in")
    assert bakes == done
    placed(scene, "LIGHT").rotation_euler[0] += 0.3
    settle(followed)
    assert bakes == [*done, "coarse", "full"]
    assert_shown_as_show_would(scene)


def test_photons_of_a_first_look_end_by_time(
    scene: bpy.types.Scene, followed: live.Live, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene.volillum.model = "photon_mapping"
    scene.volillum.photon_mapping.passes = 2
    while followed._shown is None:
        followed.look()
    coarse = read_vdb(shown_file(scene)).parameters
    assert coarse == {**coarse, **get("photon_mapping").first_look}
    assert math.isfinite(float(coarse["seconds"]))
    settle(followed)
    assert math.isinf(float(read_vdb(shown_file(scene)).parameters["seconds"]))
    assert_shown_as_show_would(scene)


def test_a_volume_that_moves_is_followed_though_it_is_hidden(
    scene: bpy.types.Scene, followed: live.Live, bakes: list[str]
) -> None:
    settle(followed)
    volume = placed(scene, "VOLUME")
    assert volume.hide_viewport
    before = read_vdb(shown_file(scene)).medium.sigma_t.index_to_world
    volume.location[1] += 0.5
    settle(followed)
    after = read_vdb(shown_file(scene)).medium.sigma_t.index_to_world
    np.testing.assert_allclose(after[:3, 3] - before[:3, 3], (0, 0.5, 0), atol=1e-5)
    assert bakes == ["coarse", "full"] * 2
    assert_shown_as_show_would(scene)
