"""A range of frames as files that Blender plays as one sequence.

    <name>.<model>.<hash>_<frame>.vdb

All frames share <hash>, the digest of their own hashes, because Blender never reads a path twice:
when one frame changes, so do all names. What was solved before is not solved again: a frame whose
own hash is found in the directory, under whatever name or number, is copied from there. So a run
that was stopped goes on where it was, and frames that are alike are solved once.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from ..core.control import Control
from ..core.errors import InputError, bad
from ..core.scene import Scene
from . import store
from .hashing import combined
from .run import Baked, Plan, plan_bake
from .vdb import read_metadata

# Share of the work that reading every frame for its hash is expected to be.
SURVEY_SHARE = 0.1


@dataclass(frozen=True)
class Frame:
    """A frame of a sequence and its bake."""

    number: int
    baked: Baked


@dataclass(frozen=True, eq=False)
class Job:
    """What the frames of a sequence have in common: see `plan_bake`."""

    model: str
    directory: Path
    name: str
    parameters: Mapping[str, object]

    def plan(self, scene: Scene, frame: int, sequence: str = "") -> Plan:
        """One frame's own plan."""
        return plan_bake(
            scene, self.model, self.directory, self.name, self.parameters,
            frame=frame, sequence=sequence,
        )  # fmt: skip


def bake_frames(
    job: Job,
    frames: Sequence[int],
    scene_at: Callable[[int], Scene],
    control: Control | None = None,
) -> Iterator[Frame]:
    """Bake the frames in order, each a file that is whole once it is yielded.

    `scene_at(frame)` is called twice a frame: first for every frame's hash, then for the work.
    Raises as `bake_file` does; what was yielded before stays.
    """
    if not frames:
        raise bad("the range of frames", "empty", "one frame or more")
    control = control or Control()
    hashes = []
    for frame in each_frame(frames, control, 0, SURVEY_SHARE, "reading"):
        hashes.append(job.plan(scene_at(frame), frame).hash)
    # With the numbers: the same frames elsewhere in time are another sequence.
    sequence = combined(f"{frame} {own}" for frame, own in zip(frames, hashes, strict=True))
    solved = _solved(job)
    for frame, own in zip(each_frame(frames, control, SURVEY_SHARE, 1, ""), hashes, strict=True):
        baked = _bake(job, frame, own, sequence, solved, control, scene_at)
        solved[baked.hash] = baked.path
        yield Frame(frame, baked)


def each_frame(
    frames: Sequence[int], control: Control, begin: float, end: float, work: str
) -> Iterator[int]:
    """The frames, each with its share of the control's progress. Raises Cancelled."""
    share = (end - begin) / len(frames)
    for index, frame in enumerate(frames):
        control.check()
        first = begin + index * share
        with control.stage(first, first + share, f"{work} frame {frame}".strip()):
            yield frame


def _bake(
    job: Job,
    frame: int,
    own: str,
    sequence: str,
    solved: Mapping[str, Path],
    control: Control,
    scene_at: Callable[[int], Scene],
) -> Baked:
    plan = job.plan(scene_at(frame), frame, sequence)
    if plan.hash != own:
        raise bad(f"frame {frame}", "another scene than when its hash was made", "the same one")
    found = plan.found()
    if found is not None:
        return found
    with store.replacing(plan.path) as temporary:
        twin = solved.get(own)
        copied = None if twin is None else replace(plan, path=twin).found()
        if copied is None:
            return plan.solve_into(temporary, control)
        shutil.copyfile(copied.path, temporary)
    return replace(copied, path=plan.path)


def _solved(job: Job) -> dict[str, Path]:
    """The model's bakes in the directory by their own hashes."""
    found: dict[str, Path] = {}
    for path in sorted(job.directory.glob(f"*.{job.model}.*.vdb")):
        try:
            found[str(read_metadata(path)["hash"])] = path
        except (InputError, KeyError, OSError):
            continue  # somebody else's file, or one that is not whole: not ours to use
    return found
