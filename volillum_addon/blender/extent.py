"""How much room a volume takes and how dense it is, of a sequence over all its frames."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..bake.grids import EmptyGridError, grid_names, read_grid
from ..bake.sequence import each_frame
from ..core.control import Control
from ..core.errors import InputError, bad
from ..core.grid import Grid
from ..readers.frames import VolumeFiles
from .gallery_presets import column

# Voxels below this share of the largest value are haze that the camera need not frame.
HAZE = 0.002


@dataclass(frozen=True, eq=False)
class Extent:
    """What a scene is built by: the name of the density's grid, positions [n, 3] (of the file's own
    space) that hold all that is to be seen, and the largest sum of density times length along a
    line of voxels."""

    grid: str
    points: NDArray[np.float64]
    column: float

    @classmethod
    def of(cls, grid: Grid) -> Extent:
        """That of one volume, tight."""
        return cls(grid.name, _hull(grid), column(grid))

    @classmethod
    def of_frames(cls, grids: Iterable[Grid]) -> Extent:
        """That of the frames of a sequence, by the box of each. Raises InputError for none."""
        name, boxes, columns = "", [], []
        for grid in grids:
            hull = _hull(grid)
            low, high = hull.min(axis=0), hull.max(axis=0)
            boxes.append(np.array(list(product(*zip(low, high, strict=True)))))
            columns.append(column(grid))
            name = grid.name
        if not boxes:
            raise bad("every frame of the sequence", "empty", "matter in one of them at least")
        return cls(name, np.concatenate(boxes), max(columns))


def extent_of(files: VolumeFiles, name: str | None, control: Control) -> Extent:
    """That of VDB files by the grid of this name, else by `density` or the first. Raises
    InputError, Cancelled."""
    grid = name or _density_name(files.path)
    if not files.frames:
        return Extent.of(read_grid(files.path, grid))
    return Extent.of_frames(_grids(files, grid, control))


def _grids(files: VolumeFiles, name: str, control: Control) -> Iterator[Grid]:
    """The grid at every frame that is not empty."""
    for frame in each_frame(sorted(files.frames), control, 0, 1, "reading"):
        with suppress(EmptyGridError):
            grid = read_grid(files.frames[frame], name)
            if grid.values.any():
                yield grid


def _density_name(volume: Path) -> str:
    names = grid_names(volume)
    if not names:
        raise InputError(f"{volume} holds no grid; expected one of densities")
    return "density" if "density" in names else names[0]


def _hull(grid: Grid) -> NDArray[np.float64]:
    """Positions [n, 3] of the hull of what is to be seen: per line of voxels, its ends."""
    matter = grid.values if grid.channels == 1 else grid.values.max(axis=-1)
    seen = matter > HAZE * matter.max()
    columns = np.argwhere(seen.any(axis=2))
    lines = seen[columns[:, 0], columns[:, 1]]
    first, last = lines.argmax(axis=1), lines.shape[1] - 1 - lines[:, ::-1].argmax(axis=1)
    index = np.concatenate(
        [np.column_stack([columns, first]), np.column_stack([columns, last])]
    ).astype(np.float64)
    return np.asarray(grid.to_world(index))
