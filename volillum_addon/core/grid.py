"""A voxel grid: values and where they are in the world."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .errors import bad, bad_voxels

# A determinant below this share of the product of the axes' lengths is a collapsed (singular) box.
SINGULAR = 1e-9
# Voxels of a slab.
SLAB = 1 << 13

# A box of voxels: its lowest indices, and the first beyond the highest.
Region = tuple[tuple[int, int, int], tuple[int, int, int]]


@dataclass(frozen=True, eq=False)
class Grid:
    """Values on a lattice, [i, j, k] or [i, j, k, 3], float32. In memory they lie in this order, or
    plane by plane, a colour after the other (`with_planes`): so kernels take them without a copy.

    `index_to_world` is a 4 x 4 affine (columns are world vectors of the index axes, then the world
    position of voxel (0, 0, 0)); voxel centres lie at integer indices. Between voxels the field is
    the trilinear interpolant, beyond the border voxels it falls to zero over one voxel.

    Raises InputError for a wrong shape, an empty grid, NaN or infinity, or a singular transform.
    """

    values: NDArray[np.float32]
    index_to_world: NDArray[np.float64]
    name: str = "grid"

    def __post_init__(self) -> None:
        values = np.asarray(self.values, dtype=np.float32)
        if not _in_planes(values):
            values = np.ascontiguousarray(values)
        if values.ndim not in (3, 4) or (values.ndim == 4 and values.shape[3] != 3):
            raise bad(f"{self.name}'s shape", values.shape, "(i, j, k) or (i, j, k, 3)")
        if values.size == 0:
            raise bad(f"{self.name}'s shape", values.shape, "at least one voxel")
        affine = np.array(self.index_to_world, dtype=np.float64)
        if affine.shape != (4, 4) or not np.all(np.isfinite(affine)):
            raise bad(f"{self.name}'s transform", affine.tolist(), "a finite 4 x 4 matrix")
        if not np.allclose(affine[3], (0, 0, 0, 1), atol=1e-12):
            raise bad(f"{self.name}'s transform's last row", affine[3].tolist(), "0, 0, 0, 1")
        linear = affine[:3, :3]
        extent = float(np.prod(np.linalg.norm(linear, axis=0)))
        if extent == 0 or abs(np.linalg.det(linear)) < SINGULAR * extent:
            raise bad(
                f"{self.name}'s transform", np.round(linear, 6).tolist(), "an invertible matrix"
            )
        object.__setattr__(self, "values", values)
        if not all(np.isfinite(values[slab]).all() for slab in self.slabs()):
            nan = np.isnan(values)
            kind, wrong = ("NaN", nan) if nan.any() else ("infinite", np.isinf(values))
            raise bad_voxels(
                self.name, kind, wrong.reshape(*self.shape, -1).any(-1), "finite values"
            )
        object.__setattr__(self, "index_to_world", affine)

    @property
    def shape(self) -> tuple[int, int, int]:
        """Voxels along i, j, k."""
        nx, ny, nz = self.values.shape[:3]
        return nx, ny, nz

    def slabs(self) -> Iterator[slice]:
        """Ranges of i of about SLAB voxels, one after another: what is worked on in them needs no
        temporaries of the lattice's size."""
        count, j, k = self.shape
        step = max(1, SLAB // (j * k))
        return (slice(first, min(first + step, count)) for first in range(0, count, step))

    @property
    def channels(self) -> int:
        """1, or 3 for a vector grid."""
        return 1 if self.values.ndim == 3 else 3

    def planes(self) -> NDArray[np.float32]:
        """The values as [channels, i, j, k], contiguous: what the kernels take. A copy only where
        colours are interleaved in memory."""
        if self.values.ndim == 3:
            return self.values[None]
        return np.ascontiguousarray(np.moveaxis(self.values, -1, 0))

    def with_values(self, values: NDArray[np.float32], name: str | None = None) -> Grid:
        """Other values on the same lattice."""
        return Grid(values, self.index_to_world, self.name if name is None else name)

    def with_planes(self, planes: NDArray[np.float32], name: str | None = None) -> Grid:
        """Other values on the same lattice, [1 or 3, i, j, k]: not copied."""
        return self.with_values(_values_of(planes), name)

    def same_lattice(self, other: Grid) -> bool:
        """Whether both have their voxels in the same places (to 1e-6 voxels)."""
        if self.shape != other.shape:
            return False
        relative = np.linalg.solve(self.index_to_world, other.index_to_world)
        return bool(np.allclose(relative, np.eye(4), atol=1e-6))

    def to_world(self, index: NDArray[np.float64]) -> NDArray[np.float64]:
        """World positions [..., 3] of index positions [..., 3]."""
        return np.asarray(index @ self.index_to_world[:3, :3].T + self.index_to_world[:3, 3])

    def to_index(self, world: NDArray[np.float64]) -> NDArray[np.float64]:
        """Index positions [..., 3] of world positions [..., 3]."""
        inverse = np.linalg.inv(self.index_to_world[:3, :3])
        return np.asarray((world - self.index_to_world[:3, 3]) @ inverse.T)

    def corners(self) -> NDArray[np.float64]:
        """World positions [8, 3] of the corners of the support (index -1 to n)."""
        return box_corners(self.shape, self.index_to_world)

    @property
    def centre(self) -> NDArray[np.float64]:
        """World position of the middle of the grid."""
        return self.to_world((np.array(self.shape) - 1) / 2)

    @property
    def voxel_size(self) -> NDArray[np.float64]:
        """Lengths of the three index axes, world units."""
        return np.asarray(np.linalg.norm(self.index_to_world[:3, :3], axis=0))

    def crop(self, low: tuple[int, int, int], high: tuple[int, int, int]) -> Grid:
        """The box [low, high) of indices; it may reach beyond the grid, where values are 0."""
        if (low, high) == ((0, 0, 0), self.shape):
            return self
        shape = tuple(h - lo for lo, h in zip(low, high, strict=True))
        planes = np.zeros((self.channels, *shape), np.float32)
        source, target = [], []
        for lo, hi, n in zip(low, high, self.shape, strict=True):
            a, b = max(lo, 0), min(hi, n)
            source.append(slice(a, max(a, b)))
            target.append(slice(a - lo, max(a, b) - lo))
        values = _values_of(planes)
        values[tuple(target)] = self.values[tuple(source)]
        affine = self.index_to_world.copy()
        affine[:3, 3] = self.to_world(np.array(low, dtype=np.float64))
        return Grid(values, affine, self.name)


def _in_planes(values: NDArray[np.float32]) -> bool:
    return values.ndim == 4 and bool(np.moveaxis(values, -1, 0).flags.c_contiguous)


def _values_of(planes: NDArray[np.float32]) -> NDArray[np.float32]:
    """Planes [1 or 3, i, j, k] as [i, j, k] or [i, j, k, 3], not copied."""
    return planes[0] if len(planes) == 1 else np.moveaxis(planes, 0, -1)


def occupied(values: NDArray[np.float32]) -> NDArray[np.bool_]:
    """[i, j, k]: whether any channel differs from 0, of values [i, j, k] or [i, j, k, 3]."""
    if values.ndim == 3:
        return np.asarray(values != 0)
    # Channel by channel: numpy reduces short last axes thirty times more slowly.
    red, green, blue = (values[..., channel] != 0 for channel in range(3))
    return np.asarray(red | green | blue)


def triple(numbers: NDArray[np.int64]) -> tuple[int, int, int]:
    """Three numbers of an array as Python's own."""
    a, b, c = (int(number) for number in numbers)
    return a, b, c


def active_box(*grids: Grid, margin: int = 0) -> Region | None:
    """The smallest index box [low, high) that holds every non-zero voxel, grown by `margin`.

    None when all voxels are zero. The margin may reach beyond the grid.
    """
    used = np.zeros(grids[0].shape, bool)
    for grid in grids:
        used |= occupied(grid.values)
    if not used.any():
        return None
    low, high = [], []
    for axis in range(3):
        others = tuple(a for a in range(3) if a != axis)
        layers = np.flatnonzero(used.any(axis=others))
        low.append(int(layers[0]) - margin)
        high.append(int(layers[-1]) + 1 + margin)
    return (low[0], low[1], low[2]), (high[0], high[1], high[2])


def box_corners(
    shape: tuple[int, int, int], index_to_world: NDArray[np.float64]
) -> NDArray[np.float64]:
    """`Grid.corners` of a lattice without its values."""
    ends = [(-1.0, float(n)) for n in shape]
    index = np.array(np.meshgrid(*ends, indexing="ij")).reshape(3, 8).T
    return np.asarray(index @ index_to_world[:3, :3].T + index_to_world[:3, 3])
