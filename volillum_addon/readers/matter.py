"""From files of any format to matter: their values as VDB files, and the media that a transfer
function makes of them. What File > Import, the command line and scripts have in common."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..bake.frame_files import frame_file
from ..core.control import Control
from ..core.transfer_function import TransferFunction
from .formats import format_of, read_volume
from .frames import VolumeFiles
from .imported import About, is_imported, write_imported
from .medium_file import write_medium
from .sequence import apply_frames, read_frames
from .source import Options
from .transfer_presets import default_name, load


@dataclass(frozen=True, eq=False)
class Imported:
    """What was written: the values and the coefficients that the function makes of them, of a
    sequence the first files; and the corners [n, 3] of the box, of a sequence of all boxes."""

    name: str
    values: Path
    medium: Path
    about: About
    corners: NDArray[np.float64]
    transfer: TransferFunction
    frames: tuple[int, ...] = ()

    @property
    def files(self) -> VolumeFiles:
        """The media."""
        media = {frame: frame_file(self.medium, frame) for frame in self.frames}
        return VolumeFiles(self.medium, media, self.name)


def as_it_is(files: VolumeFiles, level: int, transfer: str | None) -> bool:
    """Whether a volume is lit without a transfer function: none was named, and a VDB's densities
    are its own (an import's values are no densities yet). Raises InputError."""
    if transfer is not None or level or format_of(files.path).id != "vdb":
        return False
    return not is_imported(files.path)


def read_matter(
    files: VolumeFiles,
    directory: Path,
    level: int = 0,
    options: Options | None = None,
    transfer: str | None = None,
    control: Control | None = None,
) -> Imported:
    """Write the values and what a preset makes of them into `directory`; without a name the preset
    is the one for the kind of data, of a sequence one for all frames. What is stopped leaves both
    files or neither; of a sequence the frames so far, to go on from. Any thread.

    Raises InputError, StorageError, Cancelled.
    """
    watch, options = control or Control(), options or Options()
    if files.frames:
        return _read_frames(files, directory, level, options, transfer, watch)
    path, stem = files.path, files.stem
    with watch.stage(0.0, 0.5, f"reading {path.name}"):
        grid, about = read_volume(path, level, options, watch)
    digest = hashlib.sha256(repr((grid.shape, about)).encode())
    digest.update(grid.index_to_world.tobytes())
    digest.update(grid.values.tobytes())
    values = directory / f"{stem}.values.{digest.hexdigest()[:12]}.vdb"
    function = load(transfer or default_name(about), about)
    before = set(directory.glob("*.vdb"))
    # First what may be refused: a function that leaves nothing leaves no file either.
    with watch.stage(0.5, 0.8, "applying the transfer function"):
        medium = write_medium((grid, about), function, directory, stem, watch)
    try:
        with watch.stage(0.8, 1.0, f"writing {values.name}"):
            if not values.is_file():
                write_imported(grid, about, values, watch)
    except BaseException:
        if medium not in before:
            medium.unlink(missing_ok=True)
        raise
    return Imported(stem, values, medium, about, grid.corners(), function)


def _read_frames(
    files: VolumeFiles,
    directory: Path,
    level: int,
    options: Options,
    transfer: str | None,
    control: Control,
) -> Imported:
    with control.stage(0.0, 0.5, "reading"):
        values = read_frames(files.frames, directory, files.stem, level, options, control)
    function = load(transfer or default_name(values.about), values.about)
    with control.stage(0.5, 1.0, "applying the transfer function"):
        medium = apply_frames(values.files, function, directory, control)
    return Imported(
        files.stem, values.files[0], medium, values.about, values.corners, function,
        tuple(sorted(files.frames)),
    )  # fmt: skip
