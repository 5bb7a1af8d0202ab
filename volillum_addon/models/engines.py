"""From grids to the native engines and back: what several models' bakes share."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..core.control import Control
from ..core.grid import Grid, Region
from ..core.native import native


def sweep(
    sigma_t: Grid,
    directions: NDArray[np.float64],
    weights: NDArray[np.float64],
    near: int,
    control: Control,
    radius: float = math.inf,
    wanted: Region | None = None,
    out: NDArray[np.float32] | None = None,
) -> NDArray[np.float32]:
    """Weighted sums of transmittance, [extinction channels, c, i, j, k], for weights [d, c]; 0
    where they are not wanted, or what `out` holds there, [c, extinction channels, i, j, k]."""
    weights = np.ascontiguousarray(weights, dtype=np.float32)
    if out is None:
        # All extinctions of one sum together, which becomes a grid.
        make = np.empty if wanted is None else np.zeros
        out = make((weights.shape[1], sigma_t.channels, *sigma_t.shape), np.float32)
    for index, plane in enumerate(sigma_t.planes()):
        with control.stage(index / sigma_t.channels, (index + 1) / sigma_t.channels, "sweeping"):
            native.sweep(
                plane,
                sigma_t.index_to_world,
                np.ascontiguousarray(directions),
                weights,
                radius=radius,
                near_slices=near,
                wanted=wanted,
                control=control.native,
                out=out[:, index],
            )
    return out.swapaxes(0, 1)


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
