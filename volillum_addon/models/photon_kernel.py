"""The progressive kernel estimate (Knaus and Zwicker 2011): radii of the passes, and its lattice.

Pass i (from 1) counts photons in balls of radius r_i about the voxels' centres, with

    r_{i+1}^3 = r_i^3 (i + alpha) / (i + 1),   0 < alpha <= 1,

so that the variance of the mean of N passes falls as N^-alpha and its bias, r_i^2 / 10 times the
Laplacian of the light averaged over passes, as N^(-2 (1 - alpha) / 3). Both together fall fastest
with alpha = 4 / 7.

What is counted are the possible collisions of delta tracking, real and null: each stands for the
light along 1 / majorant of path, in the void as in matter. The lattice is widened by the first
radius, so that no ball is cut off at a border.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..core.grid import Grid
from ..core.medium import Medium

OPTIMAL_ALPHA = 4 / 7
# Possible collisions across the lattice where there is no matter.
VOID_COLLISIONS = 16.0


def radius(first: float, alpha: float, index: int) -> float:
    """r_N of the pass N = `index` + 1, in the unit of `first`: the rule's closed form."""
    number = index + 1
    log_cube = math.lgamma(number + alpha) - math.lgamma(1 + alpha) - math.lgamma(number + 1)
    return first * math.exp(log_cube / 3)


def voxel_size(lattice: Grid) -> float:
    """Side of the cube of a voxel's volume, world units."""
    return float(abs(np.linalg.det(lattice.index_to_world[:3, :3])) ** (1 / 3))


def padding(lattice: Grid, reach: float) -> tuple[int, int, int]:
    """Voxels that a ball of radius `reach` (world units) needs beyond the lattice, by axis."""
    rows = np.linalg.norm(np.linalg.inv(lattice.index_to_world[:3, :3]), axis=1)
    i, j, k = (math.ceil(reach * row) for row in rows)
    return i, j, k


def widened(grid: Grid, margin: tuple[int, int, int]) -> Grid:
    """The grid with voxels of 0 around it."""
    spatial = [(m, m) for m in margin]
    values = np.pad(grid.values, spatial + [(0, 0)] * (grid.values.ndim - 3))
    affine = grid.index_to_world.copy()
    affine[:3, 3] -= affine[:3, :3] @ np.array(margin, np.float64)
    return Grid(values, affine, grid.name)


def widened_medium(medium: Medium, margin: tuple[int, int, int]) -> Medium:
    """The medium on a lattice with void around it."""
    sigma_t, sigma_s = widened(medium.sigma_t, margin), widened(medium.sigma_s, margin)
    emission = None if medium.emission is None else widened(medium.emission, margin)
    return Medium(sigma_t, sigma_s, emission, medium.g)


def inner[Scalar: np.generic](
    values: NDArray[Scalar], shape: tuple[int, ...], margin: tuple[int, int, int]
) -> NDArray[Scalar]:
    """Values [voxels of the widened lattice, or of its first planes, ...] of the voxels of the
    lattice of `shape`, [i, j, k, ...], not copied."""
    wide = tuple(n + 2 * m for n, m in zip(shape, margin, strict=True))
    cut = tuple(slice(m, m + n) for n, m in zip(shape, margin, strict=True))
    return values.reshape(-1, *wide[1:], *values.shape[1:])[cut]


def least_majorant(lattice: Grid) -> float:
    """Possible collisions a unit of length in the void."""
    corners = lattice.corners()
    return VOID_COLLISIONS / float(np.linalg.norm(corners - corners[0], axis=1).max())
