"""Between Grids and the grids of a VDB file.

OpenVDB's Python module copies raw memory: what is handed over must be C-contiguous, finite float32
(a Grid's promise). Its matrices are for row vectors: ours are transposed on the way.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError, bad
from ..core.grid import Grid
from . import layout
from .openvdb_module import openvdb

# Value types that become float32 grids, and whether they are vectors.
READABLE = {"float": False, "half": False, "double": False, "vec3s": True}
# A dense box above this (8 GB a channel) is a mistake, such as two far apart specks in one grid.
MOST_VOXELS = 2**31
# Steps in index space at which a transform is probed: large, so that a far origin costs no digits,
# and a power of two, so that dividing by it is exact.
PROBE = 2.0**20
# Numbers in half precision: the largest, and the smallest with all digits.
HALF_LARGEST, HALF_SMALLEST = 65504.0, 2.0**-14


class EmptyGridError(InputError):
    """A grid without active voxels."""


def grid_names(path: Path | str) -> tuple[str, ...]:
    """Names of all grids in the file, in its order. Raises InputError if it is not a VDB file."""
    where = Path(path)
    layout.check_whole(where)
    grids = _call(where, lambda: openvdb().readAllGridMetadata(str(where)))
    return tuple(grid.name for grid in grids)


def grid_name(path: Path | str, name: str | None = None) -> str:
    """The name that `read_grid` reads; InputError for a missing grid or a file that is no VDB."""
    names = grid_names(path)
    have = ", ".join(map(repr, names)) or "none"
    if name is None:
        if len(names) == 1:
            return names[0]
        name = "density"
    if name not in names:
        raise bad(f"grid {name!r}", "missing", f"one of the file's grids: {have}", str(path))
    return name


def read_grid(path: Path | str, name: str | None = None) -> Grid:
    """A float, half, double or Vec3S grid of a VDB file, dense over the box of its active voxels.

    Without a name: the only grid, or the one called `density`. Raises InputError for a file that
    is not a whole VDB file, a missing or empty grid, other value types, level sets, a background
    other than 0, NaN or infinity, a singular transform.
    """
    where = Path(path)
    chosen = grid_name(where, name)
    grid = _call(where, lambda: openvdb().read(str(where), chosen))
    label = f"grid {chosen!r} of {where}"
    check_readable(grid, label)
    if grid.activeVoxelCount() == 0:
        raise EmptyGridError(f"{label} is empty; expected at least one active voxel")
    low, high = grid.evalActiveVoxelBoundingBox()
    shape = tuple(b - a + 1 for a, b in zip(low, high, strict=True))
    if np.prod(shape, dtype=np.float64) > MOST_VOXELS:
        raise bad(label, f"{' x '.join(map(str, shape))} voxels", f"at most {MOST_VOXELS}")
    index_to_world = transform_of(grid, label)
    index_to_world[:3, 3] += index_to_world[:3, :3] @ np.array(low, np.float64)
    try:
        return Grid(values_of(grid, low, shape), index_to_world, chosen or "grid")
    except InputError as error:
        raise InputError(f"{error} (in {where})") from None


def check_readable(grid: Any, label: str) -> None:
    """Raise an InputError that says why a grid cannot serve as a medium."""
    kind = grid.valueTypeName
    if kind not in READABLE:
        wanted = "a float or Vec3S grid"
        if kind.startswith("vec3"):
            wanted = "a Vec3S grid (convert it: Blender itself stops at others)"
        raise bad(f"{label}'s type", kind, wanted)
    if str(grid.gridClass).endswith("level set"):
        raise bad(label, "a level set (distances to a surface)", "a density (fog volume)")
    if np.any(np.asarray(grid.background) != 0):
        raise bad(f"{label}'s background", grid.background, "0: a medium ends somewhere")
    if not grid.transform.isLinear:
        raise bad(f"{label}'s transform", "a frustum", "a linear one")


def values_of(grid: Any, low: tuple[int, int, int], shape: tuple[int, ...]) -> NDArray[np.float32]:
    """Dense values of the box of `shape` voxels that begins at index `low`."""
    channels = (3,) if READABLE[grid.valueTypeName] else ()
    values = np.zeros((*shape, *channels), np.float32)
    grid.copyToArray(values, ijk=low)
    return values


def transform_of(grid: Any, label: str) -> NDArray[np.float64]:
    """The grid's 4 x 4 index_to_world (column vectors)."""
    to_world = grid.transform.indexToWorld
    origin = np.array(to_world((0.0, 0.0, 0.0)))
    matrix = np.eye(4)
    matrix[:3, 3] = origin
    for axis in range(3):
        probe = [0.0, 0.0, 0.0]
        probe[axis] = PROBE
        matrix[:3, axis] = (np.array(to_world(tuple(probe))) - origin) / PROBE
    if not np.all(np.isfinite(matrix)):
        raise bad(f"{label}'s transform", matrix.tolist(), "finite numbers")
    return matrix


def to_vdb(grid: Grid, name: str, half: bool = False) -> Any:
    """An OpenVDB grid of this name; zeros are inactive.

    Raises InputError when half precision is wanted and the values do not fit it.
    """
    if half:
        _check_half(grid, name)
    kind = openvdb().Vec3SGrid if grid.channels == 3 else openvdb().FloatGrid
    result = kind()
    result.name = name
    result.copyFromArray(np.ascontiguousarray(grid.values))
    result.transform = openvdb().createLinearTransform(grid.index_to_world.T.tolist())
    result.saveFloatAsHalf = half
    return result


def _check_half(grid: Grid, name: str) -> None:
    largest = float(np.abs(grid.values).max())
    if largest > HALF_LARGEST or 0 < largest < HALF_SMALLEST:
        raise bad(
            f"{name}'s largest value",
            f"{largest:g}",
            f"{HALF_SMALLEST:g} to {HALF_LARGEST:g} for half precision (or full floats)",
        )


def _call[Result](path: Path, read: Callable[[], Result]) -> Result:
    """Call into OpenVDB and word what it raises."""
    try:
        return read()
    except (OSError, RuntimeError, LookupError, TypeError, ValueError, MemoryError) as error:
        line = " ".join(str(error).split()) or type(error).__name__
        raise InputError(f"{path} cannot be read ({line}); expected a whole VDB file") from None
