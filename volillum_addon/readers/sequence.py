"""A sequence of VDB files seen through one transfer function, frame by frame:

    <stem>.values.<hash>_<frame>.vdb    a frame's values, as `write_imported` has them
    <stem>.<hash>_<frame>.vdb           the medium that the function makes of them

The hashes are of all frames together, because Blender plays files of one name and never reads a
path twice. A file that is there is not made again: a run that was stopped goes on where it was.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..bake import layout
from ..bake.frame_files import frame_of, name_of, numbered
from ..bake.grids import EmptyGridError, grid_name
from ..bake.sequence import each_frame
from ..bake.store import StorageError
from ..core.control import Control
from ..core.errors import InputError, bad
from ..core.grid import Grid
from ..core.transfer_function import TransferFunction
from .formats import format_of, read_volume
from .frames import Name, VolumeFiles
from .imported import (
    FORMAT,
    GRID,
    About,
    read_about,
    read_corners,
    read_imported,
    write_imported,
)
from .medium_file import ENTRY, REVISION, clear, medium_of, store
from .source import Options

# In the names of files of values, before the hash.
VALUES = ".values."
# Share of the work that hashing every file is expected to be.
SURVEY_SHARE = 0.1
# Bytes that are hashed at once.
PIECE = 1 << 20


@dataclass(frozen=True, eq=False)
class Values:
    """A sequence's values: the files in order, what is known of all frames together, and the
    corners [n, 3] of the boxes of all that are not empty."""

    files: tuple[Path, ...]
    about: About
    corners: NDArray[np.float64]


def read_frames(
    sources: Mapping[int, Path],
    directory: Path,
    stem: str,
    level: int,
    options: Options,
    control: Control | None = None,
) -> Values:
    """Every frame's values as a file in `directory`, found or written. A frame without a voxel is
    one voxel of 0.

    Raises InputError where a file cannot be read or all are empty, and then leaves nothing behind;
    StorageError, Cancelled.
    """
    watch, frames = control or Control(), sorted(sources)
    digest = hashlib.sha256(json.dumps([FORMAT, level, options.grid, options.channel]).encode())
    wanted = _grid(sources[frames[0]], options)
    for frame in each_frame(frames, watch, 0, SURVEY_SHARE, "reading"):
        if (found := _grid(sources[frame], options)) != wanted:
            raise bad(f"the grid of frame {frame}", repr(found), f"{wanted!r}, as in frame "
                      f"{frames[0]}", str(sources[frame]))  # fmt: skip
        digest.update(f"{frame} {_content(sources[frame])}\n".encode())
    name = f"{stem}{VALUES}{digest.hexdigest()[:12]}"
    files = tuple(numbered(directory, name, frame) for frame in frames)
    steps = each_frame(frames, watch, SURVEY_SHARE, 1, "importing")
    try:
        for frame, target in zip(steps, files, strict=True):
            if not target.is_file():
                write_imported(*_read(sources[frame], level, options, watch), target, watch)
        full = [file for file in files if not _is_empty(read_about(file))]
        if not full:
            raise bad(f"every frame of {stem}", "empty", "matter in one of them at least")
    except StorageError:
        raise  # with more room it goes on
    except InputError:
        # A mended frame is another sequence, with other names.
        for target in files:
            target.unlink(missing_ok=True)
        raise
    return Values(files, about_all(files), np.concatenate([read_corners(file) for file in full]))


def import_frames(
    files: VolumeFiles,
    target: Name,
    level: int = 0,
    options: Options | None = None,
    control: Control | None = None,
) -> About:
    """Turn every frame of a sequence into a VDB file of the target's name and the same number: all
    of them, or where one cannot be read none. What is known of all frames together.

    Raises InputError, StorageError; Cancelled, after which frames that were whole stay under
    another name until an import of the same files takes them up.
    """
    if target.after != ".vdb":
        raise bad("the files to write", repr(str(target)), "a name that ends in .vdb")
    targets = {frame: target.file(frame) for frame in sorted(files.frames)}
    both = {path.resolve() for path in files.frames.values()} & {
        path.resolve() for path in targets.values()}  # fmt: skip
    if both:
        raise bad("the files to write", repr(str(target)), "others than are read")
    stem = f"{target.label}.importing"
    values = read_frames(files.frames, target.folder, stem, level, options or Options(), control)
    for file, final in zip(values.files, targets.values(), strict=True):
        file.replace(final)
    return values.about


def about_all(files: Sequence[Path]) -> About:
    """What is known of the frames together: the range of all their values, and how often each is in
    any of them. Raises InputError."""
    frames = [read_about(file) for file in files]
    low, high = min(each.low for each in frames), max(each.high for each in frames)
    edges = np.linspace(low, high, max(len(each.histogram) for each in frames) + 1)
    counts = sum(each.voxels_between(edges) for each in frames)
    # Which of the frames says something: an empty one knows neither kind nor unit.
    telling = next((each for each in frames if not _is_empty(each)), frames[0])
    return replace(
        telling,
        low=low,
        high=high,
        notes=tuple(dict.fromkeys(note for each in frames for note in each.notes)),
        histogram=tuple(np.rint(counts).astype(int).tolist()),
    )


def apply_frames(
    files: Sequence[Path],
    transfer: TransferFunction,
    directory: Path,
    control: Control | None = None,
) -> Path:
    """The media that the function makes of the frames' values, found or written; the first file.
    Where it leaves nothing of a frame, the medium there is empty.

    Raises InputError where nothing is left of any frame, StorageError, Cancelled.
    """
    entry = transfer.as_json()
    del entry["summary"]
    name = name_of(files[0])
    digest = hashlib.sha256(json.dumps([REVISION, name, entry]).encode()).hexdigest()[:12]
    frames = [frame_of(file) for file in files]
    own = f"{name.rpartition(VALUES)[0]}.{digest}"
    targets = [numbered(directory, own, frame) for frame in frames]
    something = False
    steps = each_frame(frames, control or Control(), 0, 1, "applying the transfer function to")
    for _, file, target in zip(steps, files, targets, strict=True):
        if not target.is_file():
            medium = medium_of(*read_imported(file), transfer)
            empty = not medium.sigma_t.values.any()
            store(medium, target, {**transfer.as_json(), "empty": empty}, control)
        something = something or not json.loads(layout.metadata(target)[ENTRY].value)["empty"]
    if not something:
        for target in targets:
            target.unlink(missing_ok=True)
        raise clear(about_all(files))
    return targets[0]


def _grid(path: Path, options: Options) -> str:
    """The name of the grid that is read of a VDB file."""
    return grid_name(path, options.grid) if format_of(path).id == "vdb" else ""


def _read(path: Path, level: int, options: Options, control: Control) -> tuple[Grid, About]:
    try:
        return read_volume(path, level, options, control)
    except EmptyGridError:
        grid = Grid(np.zeros((1, 1, 1), np.float32), np.eye(4), GRID)
        return grid, About(path.name, "VDB", (1, 1, 1), "float32", 0.0, 0.0, level=level,
                           histogram=(1,))  # fmt: skip


def _is_empty(about: About) -> bool:
    return about.low == about.high == 0


def _content(path: Path) -> str:
    digest = hashlib.sha256()
    try:
        with path.open("rb") as file:
            while piece := file.read(PIECE):
                digest.update(piece)
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror}); expected a frame") from None
    return digest.hexdigest()
