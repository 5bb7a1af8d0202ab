"""A scene over a range of frames, baked as a sequence."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

import bpy

from ..bake.sequence import Frame, Job, bake_frames
from ..core.control import Control
from ..core.errors import InputError
from ..core.scene import Scene
from . import work
from .frames import kept_frame


def bake(
    scene: bpy.types.Scene,
    model: str,
    values: Mapping[str, object],
    frames: Sequence[int],
    directory: Path,
    control: Control,
) -> Iterator[Frame]:
    """Bake the frames in order. Moves the scene through them, so main thread only; the frame that
    was current is current again at the end. Raises InputError and Cancelled."""
    with kept_frame(scene):
        name = work.read(scene).stem
        job = Job(model, directory, name, values)
        yield from bake_frames(job, frames, _scene_at(scene), control)


def described(frame: Frame) -> dict[str, object]:
    """A frame as JSON values: what the command line prints and the scene's settings keep."""
    baked = frame.baked
    return {
        "frame": frame.number,
        "path": str(baked.path),
        "model": baked.model,
        "hash": baked.hash,
        "found": baked.found,
        "seconds_bake": baked.seconds_bake,
        "seconds_hand_over": baked.seconds_hand_over,
        "notes": list(baked.notes),
    }


def _scene_at(scene: bpy.types.Scene) -> Callable[[int], Scene]:
    def read(frame: int) -> Scene:
        scene.frame_set(frame)
        try:
            return work.read(scene).scene
        except InputError as error:
            raise InputError(f"frame {frame}: {error}") from error

    return read
