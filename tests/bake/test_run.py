"""Bakes as files: computed once, found afterwards, and checked before any work."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bake.conftest import random_values

from volillum_addon import __version__
from volillum_addon.bake import hashing, run, store, vdb
from volillum_addon.bake.openvdb_module import openvdb
from volillum_addon.core.control import Cancelled, Control
from volillum_addon.core.errors import InputError
from volillum_addon.core.grid import Grid
from volillum_addon.core.lights import DistantLight, EnvironmentLight
from volillum_addon.core.scene import Scene
from volillum_addon.models.model import Values
from volillum_addon.models.registry import MODELS

MODEL = "multidirectional_occlusion"
Count = Callable[[], int]


@pytest.fixture(autouse=True)
def visibility_0(solved: Count, monkeypatch: pytest.MonkeyPatch) -> None:
    """The plain solver's channel under the name that this model's radiance asks for."""
    inner = MODELS[MODEL].solve

    def solve(scene: Scene, values: Values, control: Control) -> dict[str, Grid]:
        return {"visibility_0": inner(scene, values, control)["visibility"]}

    monkeypatch.setitem(MODELS, MODEL, replace(MODELS[MODEL], solve=solve))


def test_same_inputs_are_found(scene: Scene, solved: Count, tmp_path: Path) -> None:
    first = run.bake_file(scene, MODEL, tmp_path, "cloud", {"theta": 0.5})
    assert not first.found
    assert first.path.name == f"cloud.{MODEL}.{first.hash}.vdb"
    assert len(first.hash) == 16
    again = run.bake_file(scene, MODEL, str(tmp_path), "cloud", {"theta": 0.5})
    assert solved() == 1
    assert again.found
    # The file's seconds are written to the microsecond.
    assert again.seconds_hand_over == pytest.approx(first.seconds_hand_over, abs=1e-6)
    assert replace(again, found=False, seconds_hand_over=0) == replace(first, seconds_hand_over=0)
    assert list(tmp_path.iterdir()) == [first.path]
    other = run.bake_file(scene, MODEL, tmp_path, "cloud", {"theta": 0.6})
    assert (other.found, solved()) == (False, 2)
    assert len(list(tmp_path.iterdir())) == 2


def test_metadata_says_what_it_is_and_took(scene: Scene, tmp_path: Path) -> None:
    baked = run.bake_file(scene, MODEL, tmp_path, "cloud", {"theta": 0.5})
    entries = vdb.read_metadata(baked.path)
    assert entries["model"] == MODEL
    assert entries["parameters"] == MODELS[MODEL].values({"theta": 0.5})
    assert entries["hash"] == baked.hash == hashing.combined(entries["inputs"])
    assert entries["version"] == __version__
    assert entries["seconds"] == baked.seconds_bake > 0
    assert entries["peak_bytes"] == baked.peak_bytes > 1e6
    assert entries["seconds_hand_over"] > 0
    assert baked.notes == tuple(entries["notes"])
    assert "environment" in baked.notes[0]


@pytest.mark.parametrize(
    "harm",
    [
        lambda path: path.write_bytes(path.read_bytes()[:-1]),
        lambda path: path.write_bytes(path.read_bytes()[: path.stat().st_size // 2]),
        lambda path: path.write_bytes(b""),
        lambda path: path.write_text("foreign"),
        lambda path: write_foreign(path),
    ],
    ids=["last byte lost", "half lost", "empty", "text", "stock VDB"],
)
def test_what_is_not_the_whole_bake_is_computed_again(
    harm: Callable[[Path], None], scene: Scene, solved: Count, tmp_path: Path
) -> None:
    baked = run.bake_file(scene, MODEL, tmp_path, "cloud")
    harm(baked.path)
    again = run.bake_file(scene, MODEL, tmp_path, "cloud")
    assert (again.found, solved()) == (False, 2)
    vdb.read_vdb(again.path)


def write_foreign(path: Path) -> None:
    grid = openvdb().FloatGrid()
    grid.copyFromArray(random_values(3, 4, 5))
    openvdb().write(str(path), [grid])


def test_another_bake_under_the_name_is_computed_again(
    scene: Scene, solved: Count, tmp_path: Path
) -> None:
    first = run.bake_file(scene, MODEL, tmp_path, "cloud")
    other = run.bake_file(scene, MODEL, tmp_path, "cloud", {"theta": 0.6})
    first.path.write_bytes(other.path.read_bytes())
    again = run.bake_file(scene, MODEL, tmp_path, "cloud")
    assert (again.found, solved()) == (False, 3)
    assert vdb.read_metadata(again.path)["hash"] == first.hash


def test_a_found_bake_under_new_light_is_relit(scene: Scene, solved: Count, tmp_path: Path) -> None:
    baked = run.bake_file(scene, MODEL, tmp_path, "cloud")
    sun = scene.lights[0]
    assert isinstance(sun, DistantLight)
    brighter = replace(
        scene,
        lights=(replace(sun, irradiance=np.asarray(sun.irradiance) * 4), scene.lights[1]),
        medium=replace(scene.medium, g=0.25),
    )
    again = run.bake_file(brighter, MODEL, tmp_path, "cloud")
    assert again.found
    assert any("g = 0.25" in note for note in again.notes)
    dim = run.baked_volume(scene, baked.path)
    bright = run.baked_volume(brighter, again.path)
    # Powers of two multiply floats exactly.
    np.testing.assert_array_equal(bright.in_scattered().values, 4 * dim.in_scattered().values)
    assert dim.in_scattered().values.max() > 0
    assert bright.medium.g == 0.25


def test_frames_of_a_sequence_share_a_name(scene: Scene, solved: Count, tmp_path: Path) -> None:
    shared = hashing.combined(["a", "b"])
    paths = [
        run.bake_file(scene, MODEL, tmp_path, "cloud", {"theta": 0.5 + frame / 1e5},
                      frame=frame, sequence=shared).path
        for frame in (7, 8, 12345)
    ]  # fmt: skip
    stem = f"cloud.{MODEL}.{shared}"
    assert [p.name for p in paths] == [f"{stem}_{n}.vdb" for n in ("0007", "0008", "12345")]
    assert len({vdb.read_metadata(path)["hash"] for path in paths}) == 3
    # A frame whose own inputs changed under the shared name is not taken for it.
    changed = run.bake_file(scene, MODEL, tmp_path, "cloud", frame=7, sequence=shared)
    assert not changed.found
    with pytest.raises(InputError, match="the frame is -1; expected 0 or more"):
        run.bake_file(scene, MODEL, tmp_path, "cloud", frame=-1)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"parameters": {"theta": 9.0}}, "theta is 9; expected 0.01.* radians"),
        ({"parameters": {"colour": 9.0}}, "parameter is 'colour'; expected one of theta"),
        ({"model": "raytracing"}, "model is 'raytracing'; expected one of half_angle"),
        ({"name": "a/b"}, "name is 'a/b'; expected a file name without folders"),
        ({"name": ""}, "name is ''; expected a file name"),
        ({"lights": (EnvironmentLight(1.0),)}, "knows only lights of the kinds distant"),
        ({"model": "directional_occlusion", "camera": None}, "camera is missing; expected"),
    ],
)
def test_everything_is_checked_before_the_work(
    change: dict[str, object], message: str, scene: Scene, solved: Count, tmp_path: Path
) -> None:
    given = dict(change)
    changed = replace(scene, **{k: given.pop(k) for k in ("lights", "camera") if k in given})
    arguments = {"model": MODEL, "directory": tmp_path / "new", "name": "cloud", **given}
    with pytest.raises(InputError, match=message) as caught:
        run.bake_file(changed, **arguments)  # type: ignore[arg-type]
    assert "\n" not in str(caught.value)
    assert solved() == 0
    assert list(tmp_path.iterdir()) == []


def test_unwritable_directory_is_noticed_before_the_work(
    scene: Scene, solved: Count, tmp_path: Path
) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(store.StorageError, match=r"file cannot be written \(.*\); expected a dir"):
        run.bake_file(scene, MODEL, tmp_path / "file", "cloud")
    assert solved() == 0


def test_cancelling_leaves_nothing(scene: Scene, tmp_path: Path) -> None:
    control = Control()
    control.cancel()
    with pytest.raises(Cancelled):
        run.bake_file(scene, MODEL, tmp_path, "cloud", control=control)
    assert list(tmp_path.iterdir()) == []


def test_progress_ends_at_the_end(scene: Scene, tmp_path: Path) -> None:
    control, seen = Control(), []
    inner = MODELS[MODEL].solve

    def solve(given: Scene, values: Values, inside: Control) -> dict[str, Grid]:
        inside.report(0.5)
        seen.append((inside.fraction, inside.message))
        return inner(given, values, inside)

    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(MODELS, MODEL, replace(MODELS[MODEL], solve=solve))
        run.bake_file(scene, MODEL, tmp_path, "cloud", control=control)
    assert seen == [(0.5 * run.SOLVE_SHARE, MODELS[MODEL].label)]


def test_finding_a_bake_reads_no_voxels(
    scene: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is known by the file's table: what is found is found at once, however large it is."""
    run.bake_file(scene, MODEL, tmp_path, "cloud")
    for read in ("read", "readAll"):
        monkeypatch.setattr(openvdb(), read, None)
    assert run.bake_file(scene, MODEL, tmp_path, "cloud").found
