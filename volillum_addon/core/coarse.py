"""The same scene on a coarser grid, for quick estimates."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from .grid import Grid
from .scene import Scene


def coarsened(scene: Scene, voxels: int) -> Scene:
    """The scene with at most about `voxels` voxels in its box of matter: means over blocks of equal
    numbers of voxels along all axes, so that optical depths stay. Fewer already: as it is.

    Raises InputError for an empty medium.
    """
    trimmed = scene.trimmed(0)
    medium = trimmed.medium
    factor = math.ceil(round((math.prod(medium.sigma_t.shape) / voxels) ** (1 / 3), 6))
    if factor <= 1:
        return trimmed
    emission = medium.emission
    return replace(
        trimmed,
        medium=replace(
            medium,
            sigma_t=block_means(medium.sigma_t, factor),
            sigma_s=block_means(medium.sigma_s, factor),
            emission=None if emission is None else block_means(emission, factor),
        ),
    )


def refined(scene: Scene) -> Scene:
    """The same scene on a grid of half the spacing: the medium is the trilinear interpolant of its
    voxels, and so it is that of the voxels in between."""
    medium = scene.trimmed(1).medium
    emission = medium.emission
    return replace(
        scene,
        medium=replace(
            medium,
            sigma_t=_between(medium.sigma_t),
            sigma_s=_between(medium.sigma_s),
            emission=None if emission is None else _between(emission),
        ),
    )


def _between(grid: Grid) -> Grid:
    values = grid.values
    for axis in range(3):
        first = np.moveaxis(values, axis, 0)
        wide = np.empty((2 * len(first) - 1, *first.shape[1:]), np.float32)
        wide[::2] = first
        wide[1::2] = (first[:-1] + first[1:]) / 2
        values = np.moveaxis(wide, 0, axis)
    affine = grid.index_to_world.copy()
    affine[:3, :3] /= 2
    return Grid(values, affine, grid.name)


def block_means(grid: Grid, factor: int) -> Grid:
    """Means over blocks of factor^3 voxels; beyond the grid's end the values are 0."""
    counts = [math.ceil(n / factor) for n in grid.shape]
    whole = grid.crop((0, 0, 0), (counts[0] * factor, counts[1] * factor, counts[2] * factor))
    blocks = whole.values.reshape(
        counts[0], factor, counts[1], factor, counts[2], factor, *whole.values.shape[3:]
    )
    affine = grid.index_to_world.copy()
    affine[:3, :3] *= factor
    affine[:3, 3] = grid.to_world(np.full(3, (factor - 1) / 2))
    return Grid(blocks.mean(axis=(1, 3, 5), dtype=np.float64), affine, grid.name)
