"""An imported volume as a VDB file: the values as the grid `density`, and what the source said of
them as metadata `volillum_volume` (JSON), so that nothing but its bytes is lost.

OpenVDB keeps no voxels of value 0 at the border of a volume: the shape in the metadata says how
far it goes.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..bake import layout
from ..bake.grids import MOST_VOXELS, check_readable, to_vdb, transform_of, values_of
from ..bake.openvdb_module import openvdb
from ..bake.store import complain, replacing
from ..core.control import Control
from ..core.errors import InputError, bad
from ..core.grid import Grid, box_corners
from .source import library

ENTRY = "volillum_volume"
GRID = "density"
FORMAT = 1
# Intervals of the histogram at most.
BINS = 256


@dataclass(frozen=True)
class About:
    """What is known of an imported volume: see `Source`. `low` and `high` are the least and the
    greatest value of the grid, `stored` the type of the file's numbers, `level` the level of detail
    that was read, `histogram` the numbers of voxels in equal intervals from `low` to `high`."""

    source: str
    format: str
    shape: tuple[int, int, int]
    stored: str
    low: float
    high: float
    kind: str = ""
    unit: str = ""
    length_unit: str = ""
    space: str = ""
    level: int = 0
    notes: tuple[str, ...] = ()
    histogram: tuple[int, ...] = ()

    @property
    def background(self) -> float:
        """The value of what there is most of, where that is in the lower half: a scanner's air, a
        microscope's dark; else the least value."""
        if not self.histogram:
            return self.low
        most = int(np.argmax(self.histogram))
        if 2 * most >= len(self.histogram):
            return self.low
        return self.low + (self.high - self.low) * most / len(self.histogram)

    def voxels_between(self, edges: NDArray[np.float64]) -> NDArray[np.float64]:
        """Voxels between neighbouring values, as if each interval of the histogram were evenly
        full."""
        if self.high <= self.low:
            inside = (edges[:-1] <= self.low) & (self.low <= edges[1:])
            return np.where(inside, float(sum(self.histogram)), 0.0)
        places = np.linspace(self.low, self.high, len(self.histogram) + 1)
        until = np.concatenate([[0.0], np.cumsum(self.histogram)])
        return np.diff(np.interp(edges, places, until))

    def quantile(self, share: float) -> float:
        """The value below which this share of the voxels above `low`'s own interval lies."""
        counts = np.array(self.histogram[1:], np.float64)
        if not counts.sum():
            return self.high
        width = (self.high - self.low) / len(self.histogram)
        interval = int(np.searchsorted(np.cumsum(counts), share * counts.sum()))
        return self.low + width * (interval + 2)


def write_imported(grid: Grid, about: About, target: Path, control: Control | None = None) -> None:
    """Write the volume, whole or not at all. Raises StorageError, Cancelled."""
    entry = {"version": FORMAT, "index_to_world": grid.index_to_world.tolist(), **asdict(about)}
    with replacing(target) as temporary:
        try:
            openvdb().write(str(temporary), [to_vdb(grid, GRID)],
                            metadata={ENTRY: json.dumps(entry)})  # fmt: skip
            layout.check_whole(temporary)
        except (OSError, RuntimeError, InputError) as error:
            raise complain(target.parent, temporary) from error
        if control is not None:
            control.check()


def is_imported(path: Path) -> bool:
    """Whether `write_imported` wrote this VDB file."""
    return ENTRY in layout.metadata(path)


def read_about(path: Path) -> About:
    """What an imported file says of itself. Raises InputError for any other file."""
    return _about(_entry(path), path)


def read_corners(path: Path) -> NDArray[np.float64]:
    """`Grid.corners` of an imported file, without its voxels. Raises InputError."""
    entry = _entry(path)
    return box_corners(_about(entry, path).shape, np.array(entry["index_to_world"], np.float64))


def read_imported(path: Path) -> tuple[Grid, About]:
    """What `write_imported` wrote, bit for bit. Raises InputError for any other file."""
    entry = _entry(path)
    about = _about(entry, path)
    layout.check_whole(path)
    with library(path, "a whole VDB file"):
        stored = openvdb().read(str(path), GRID)
        check_readable(stored, f"grid {GRID!r} of {path}")
        matrix = np.array(entry["index_to_world"], np.float64)
        difference = np.linalg.solve(matrix, transform_of(stored, GRID)) - np.eye(4)
        if np.abs(difference).max() > 1e-6:  # voxels
            raise bad("its transform", "another", "its metadata's", str(path))
        return Grid(values_of(stored, (0, 0, 0), about.shape), matrix, GRID), about


def _entry(path: Path) -> Mapping[str, Any]:
    found = layout.metadata(path)
    if ENTRY not in found:
        raise bad(str(path), "not an imported volume", "a VDB file of `volillum import`")
    try:
        entry: Mapping[str, Any] = json.loads(found[ENTRY].value)
        version = entry["version"]
    except (ValueError, KeyError, TypeError):
        raise bad(f"{path}'s metadata", "not readable", "an entry of volillum's") from None
    if version != FORMAT:
        raise bad(f"{path}'s version", version, f"{FORMAT}: an import of this version")
    return entry


def _about(entry: Mapping[str, Any], path: Path) -> About:
    try:
        values = {each.name: entry[each.name] for each in fields(About)}
        shape = tuple(int(n) for n in values["shape"])
        tuples = {name: tuple(values[name]) for name in ("notes", "histogram")}
        about = About(**{**values, "shape": shape, **tuples})
        # Every voxel has been counted: a damaged shape must not claim more of them.
        if len(shape) == 3 and sum(about.histogram) == math.prod(shape) <= MOST_VOXELS:
            return about
    except (KeyError, TypeError, ValueError):
        pass
    raise bad(f"{path}'s metadata", "damaged", "an import of this version")
