"""The error to expect of a bake: from images on two coarse grids to the real one."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .coarse_run import DRAWS, Level, Run
from .metrics import Image, best_exposure, figure

# How far the continuation in h may take an error from what the finer grid has.
FURTHEST = 2.0
# The power of h with which the error of a model falls that neglects nothing: between 1/2, of hard
# edges that a voxel averages, and 1. From the finer coarse grid to the real one it was 0.63, 0.77
# and 0.88 (engine, head and cloud of the gallery). Two coarse grids do not tell it: averaging
# leaves structure of a voxel's size on both.
SOLVED_POWER = 0.75


@dataclass(frozen=True)
class Expected:
    """An error: `systematic`, the same in every bake, with the standard error of that figure; and
    what chance adds in one bake."""

    systematic: float
    noise: float
    chance: float

    @property
    def error(self) -> float:
        """Both together."""
        return math.hypot(self.systematic, self.chance)

    def with_more_work(self, before: Expected, work: float) -> Expected:
        """Of a rung above, of `work` times the work: chance falls with its root, and the rest as it
        did from `before`, but no faster."""
        fallen = self.systematic / before.systematic if before.systematic > 0 else 1.0
        root = 1 / math.sqrt(max(work, 1.0))
        gain = min(1.0, max(fallen, root))
        return Expected(self.systematic * gain, self.noise * gain, self.chance * root)


def expected(grid: Level, runs: tuple[Run, ...], exposed: bool) -> Expected:
    """The error of the runs' sum on a coarse grid; `exposed`: after the best exposure."""
    chance = any(run.draws > 1 for run in runs)
    mean = np.sum([run.variance / run.draws for run in runs], axis=0)
    image = Image(
        np.sum([run.image for run in runs], axis=0), mean, DRAWS - 1 if chance else math.inf
    )
    one = Image(image.value, np.sum([run.variance for run in runs], axis=0))
    if exposed:
        factor = best_exposure(image, grid.full, grid.mask).factor
        image, one = image.scaled(factor), one.scaled(factor)
    found = figure(image, grid.full, grid.mask)
    full, seen = grid.full.inside(grid.mask), image.inside(grid.mask)
    scale = float(np.sum(full.value**2) - np.sum(full.variance))
    spread = math.sqrt(float(np.sum(one.inside(grid.mask).variance)) / scale)
    if not found.is_bound:
        return Expected(found.relative_rmse, found.noise, spread)
    # What is most likely, and two standard errors above it the bound.
    square = float(np.sum((seen.value - full.value) ** 2 - seen.variance - full.variance)) / scale
    likely = math.sqrt(max(square, 0.0))
    return Expected(likely, (found.relative_rmse - likely) / 2, spread)


class Continuation:
    """From the coarse grids to the real one; a rung that was baked on one grid alone changes as the
    rung before did.

    The systematic part is linear in the spacing h: what the model neglects stays, and the grid's
    part falls. Where the model solves the `whole` equation nothing stays. Chance grows on finer
    grids, where as many photons are shared out among more voxels: the variance of a voxel's mean
    goes as h^-2 (h^2 of them cross it, each for a length h, over a volume h^3), that of a ray
    through many as h^-1. So the RMS has a power of h between 0 and -1, which the two grids tell.
    """

    def __init__(self, voxels: int, whole: bool = False) -> None:
        self._spacing, self._whole = voxels ** (-1 / 3), whole
        self._trend, self._power = 1.0, 1.0

    def __call__(self, counts: list[int], found: list[Expected]) -> Expected:
        """What to expect on the real grid, from coarse ones of so many voxels."""
        spacings, last = [count ** (-1 / 3) for count in counts], found[-1]
        finer = max(spacings[-1] / self._spacing, 1.0)
        error, noise = continued(found, spacings, self._spacing)
        if self._whole:
            fallen = finer**-SOLVED_POWER
            error, noise = last.systematic * fallen, last.noise * fallen
        if len(found) > 1:
            self._trend = error / max(last.systematic, 1e-12)
            if found[0].chance > 0 < last.chance:
                grown = math.log(last.chance / found[0].chance)
                self._power = min(max(grown / math.log(spacings[0] / spacings[-1]), 0.0), 1.0)
        elif not self._whole:
            error, noise = error * self._trend, noise * self._trend
        return Expected(error, noise, last.chance * finer**self._power)


def continued(
    found: Sequence[Expected], spacings: list[float], spacing: float
) -> tuple[float, float]:
    """The systematic error at `spacing` with its noise, linear in the spacing of the grid."""
    last = found[-1]
    if len(found) == 1 or spacing >= spacings[-1]:
        return last.systematic, last.noise
    share = (spacings[-1] - spacing) / (spacings[0] - spacings[-1])
    error = last.systematic + share * (last.systematic - found[0].systematic)
    error = min(max(error, last.systematic / FURTHEST), last.systematic * FURTHEST)
    return error, math.hypot((1 + share) * last.noise, share * found[0].noise)
