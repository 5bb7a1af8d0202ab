"""Frames as one sequence: names that play, nothing solved twice, resumed where it stopped."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bake.conftest import blob

from volillum_addon.bake.sequence import Frame, Job, bake_frames
from volillum_addon.bake.vdb import read_metadata
from volillum_addon.core.control import Cancelled, Control
from volillum_addon.core.errors import InputError
from volillum_addon.core.lights import DistantLight
from volillum_addon.core.scene import Scene
from volillum_addon.models.registry import MODELS

MODEL = "multidirectional_occlusion"
Count = Callable[[], int]


@pytest.fixture(autouse=True)
def plain_radiance(solved: Count, monkeypatch: pytest.MonkeyPatch) -> None:
    """The radiance of the plain solver's channels: none, which every file can hold."""
    monkeypatch.setitem(MODELS, MODEL, replace(MODELS[MODEL], radiance=lambda *_: ()))


def turning(scene: Scene, period: int | None = None) -> Callable[[int], Scene]:
    """The scene with a sun that turns from frame to frame, round in `period` frames."""

    def at(frame: int) -> Scene:
        angle = 0.1 * (frame if period is None else frame % period)
        sun = DistantLight((np.sin(angle), 0, np.cos(angle)), 3.0)
        return replace(scene, lights=(sun,))

    return at


def baked(job: Job, frames: range, at: Callable[[int], Scene]) -> list[Frame]:
    return list(bake_frames(job, frames, at))


def stem(frames: list[Frame]) -> str:
    """What all names have in common, the number apart."""
    (common,) = {frame.baked.path.name.rpartition("_")[0] for frame in frames}
    return common


@pytest.fixture
def job(tmp_path: Path) -> Job:
    return Job(MODEL, tmp_path, "cloud", {"theta": 0.5})


def test_frames_share_a_hash_and_keep_their_own(scene: Scene, job: Job, solved: Count) -> None:
    found = baked(job, range(3, 6), turning(scene))
    assert [frame.number for frame in found] == [3, 4, 5]
    names = [frame.baked.path.name for frame in found]
    assert stem(found).startswith(f"cloud.{MODEL}.")
    assert [name.rpartition("_")[2] for name in names] == ["0003.vdb", "0004.vdb", "0005.vdb"]
    own = {read_metadata(frame.baked.path)["hash"] for frame in found}
    assert len(own) == 3 == solved()
    assert sorted(path.name for path in job.directory.iterdir()) == names
    # All is found again.
    again = baked(job, range(3, 6), turning(scene))
    assert solved() == 3
    assert all(frame.baked.found for frame in again)
    assert [frame.baked.path for frame in again] == [frame.baked.path for frame in found]


def test_one_changed_frame_renames_all_and_solves_one(
    scene: Scene, job: Job, solved: Count
) -> None:
    before = baked(job, range(3), turning(scene))
    changed = turning(replace(scene, medium=type(scene.medium).from_density(blob(), 3.0, 0.9)))
    after = baked(job, range(3), lambda f: (changed if f == 1 else turning(scene))(f))
    assert solved() == 4
    assert [frame.baked.found for frame in after] == [True, False, True]
    assert {f.baked.path for f in before}.isdisjoint(f.baked.path for f in after)
    assert before[0].baked.path.read_bytes() == after[0].baked.path.read_bytes()


def test_frames_that_are_alike_are_solved_once(scene: Scene, job: Job, solved: Count) -> None:
    found = baked(job, range(6), turning(scene, period=2))
    assert solved() == 2
    assert [frame.baked.found for frame in found] == [False, False, True, True, True, True]
    assert len({frame.baked.path for frame in found}) == 6
    # The same frames at another time are another sequence, and still nothing new.
    later = baked(job, range(6, 12), turning(scene, period=2))
    assert solved() == 2
    assert stem(later) != stem(found)


def test_a_stopped_run_goes_on_where_it_was(scene: Scene, job: Job, solved: Count) -> None:
    control = Control()
    frames = bake_frames(job, range(5), turning(scene), control)
    done = [next(frames), next(frames)]
    control.cancel()
    with pytest.raises(Cancelled):
        next(frames)
    assert sorted(job.directory.iterdir()) == [frame.baked.path for frame in done]
    assert len(baked(job, range(5), turning(scene))) == 5
    assert solved() == 5


def test_a_damaged_frame_is_baked_again(scene: Scene, job: Job, solved: Count) -> None:
    found = baked(job, range(2), turning(scene))
    path = found[1].baked.path
    whole = path.stat().st_size
    path.write_bytes(path.read_bytes()[: whole // 2])
    again = baked(job, range(2), turning(scene))
    assert [frame.baked.found for frame in again] == [True, False]
    assert solved() == 3
    assert abs(path.stat().st_size - whole) < 100  # the seconds in it have other digits


def test_progress_never_goes_back(scene: Scene, job: Job) -> None:
    control, seen = Control(), []

    def at(frame: int) -> Scene:
        seen.append((control.fraction, control.message))
        return turning(scene)(frame)

    list(bake_frames(job, range(4), at, control))
    fractions = [fraction for fraction, _ in seen]
    assert fractions == sorted(fractions)
    assert [message for _, message in seen[:4]] == [f"reading frame {n}" for n in range(4)]
    assert [message for _, message in seen[4:]] == [f"frame {n}" for n in range(4)]


def test_no_frames_are_refused(scene: Scene, job: Job) -> None:
    with pytest.raises(InputError, match="range of frames is empty; expected one frame or more"):
        baked(job, range(0), turning(scene))
    with pytest.raises(InputError, match="the frame is -1; expected 0 or more"):
        baked(job, range(-1, 2), turning(scene))
