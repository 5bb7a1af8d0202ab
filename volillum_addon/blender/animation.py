"""A scene over a range of frames, baked as a sequence."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import bpy

from ..bake.grids import EmptyGridError
from ..bake.sequence import Frame, Job, bake_frames
from ..core.control import Control
from ..core.errors import InputError
from . import work
from .frames import kept_frame
from .scene_reader import Reading


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
    # In a file that has just been opened, a volume follows no frame before its first evaluation.
    scene.view_layers[0].update()
    with kept_frame(scene):
        name = _read(scene, frames[0]).stem if frames else ""
        job = Job(model, directory, name, values)
        yield from bake_frames(job, frames, lambda frame: _read(scene, frame).scene, control)


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


def _read(scene: bpy.types.Scene, frame: int) -> Reading:
    """The scene at the frame. Raises InputError, which names it."""
    scene.frame_set(frame)
    try:
        return work.read_to_bake(scene)
    except EmptyGridError as error:
        raise InputError(f"frame {frame}: {error}, or a range without this frame") from error
    except InputError as error:
        raise InputError(f"frame {frame}: {error}") from error
