"""From grids to the native engines and back: what several models' bakes share."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..core.control import Control
from ..core.grid import Grid, Region
from ..core.native import native

# Voxels that are interleaved at a time: they stay in the second-level cache.
INTERLEAVED = 1 << 15


def sweep(
    sigma_t: Grid,
    directions: NDArray[np.float64],
    weights: NDArray[np.float64],
    near: int,
    control: Control,
    radius: float = math.inf,
    wanted: Region | None = None,
) -> NDArray[np.float32]:
    """Weighted sums of transmittance, [extinction channels, c, i, j, k], for weights [d, c]; 0
    where they are not wanted."""
    result = []
    for index, plane in enumerate(sigma_t.planes()):
        with control.stage(index / sigma_t.channels, (index + 1) / sigma_t.channels, "sweeping"):
            result.append(
                native.sweep(
                    plane,
                    sigma_t.index_to_world,
                    np.ascontiguousarray(directions),
                    np.ascontiguousarray(weights, dtype=np.float32),
                    radius=radius,
                    near_slices=near,
                    wanted=wanted,
                    control=control.native,
                )
            )
    # One colour is not copied: coefficients may be the largest thing that a bake holds.
    return result[0][None] if len(result) == 1 else np.stack(result)


def channels_of(lattice: Grid, planes: NDArray[np.float32], name: str) -> Grid:
    """Planes [1 or 3, i, j, k] as a scalar or vector grid."""
    if len(planes) == 1:
        return lattice.with_values(planes[0], name)
    return lattice.with_values(np.ascontiguousarray(np.moveaxis(planes, 0, -1)), name)


def interleaved(planes: NDArray[np.float32]) -> NDArray[np.float32]:
    """Contiguous planes [n, i, j, k] as [i, j, k, n], in the same memory and that of one plane:
    channels may be the largest thing that a bake holds."""
    flat, voxels = planes.reshape(-1), planes[0].size
    # From the last: a plane goes between the rows behind it, which are read before they are passed.
    for first in reversed(range(len(planes) - 1)):
        plane = flat[first * voxels : (first + 1) * voxels].copy()
        behind = flat[(first + 1) * voxels :].reshape(voxels, -1)
        rows = flat[first * voxels :].reshape(voxels, -1)
        for begin in range(0, voxels, INTERLEAVED):
            part = slice(begin, begin + INTERLEAVED)
            rows[part, 1:] = behind[part].copy()
            rows[part, 0] = plane[part]
    return planes.reshape(*planes.shape[1:], len(planes))


def falloff(grid: Grid, position: NDArray[np.float64]) -> NDArray[np.float32]:
    """(d0 / d)^2 at the voxels, [i, j, k]: d from `position`, d0 that of the grid's centre."""
    i, j, k = (np.arange(n, dtype=np.float64) for n in grid.shape)
    squared = np.zeros(grid.shape)
    for row in range(3):
        a, b, c, origin = grid.index_to_world[row]
        squared += (
            (a * i + (origin - position[row]))[:, None, None] + (b * j)[:, None] + c * k
        ) ** 2
    centre = float(np.sum((grid.centre - position) ** 2))
    # In the voxel that holds the place: the mean of 1 / d^2 over a ball of the voxel's volume.
    volume = abs(float(np.linalg.det(grid.index_to_world[:3, :3])))
    closest = (3 * volume / (4 * math.pi)) ** (1 / 3)
    return np.asarray(centre / np.maximum(squared, closest**2 / 3), dtype=np.float32)
