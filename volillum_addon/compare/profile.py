"""Luminance along one line through the shadow boundary: the steepest place of full scattering.

The line goes through the pixel where the reference's smoothed luminance is steepest, well inside
the silhouette (its rim is steep in every picture and says nothing about light), along the gradient,
from rim to rim.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ..core.colour import LUMINANCE
from .metrics import Mask
from .results import Comparison

Values = NDArray[np.float64]
# The reference is smoothed and kept away from the rim by these shares of the image's width.
SMOOTHING, RIM = 0.02, 0.06
# Samples a pixel along the line.
FINE = 2


@dataclass(frozen=True, eq=False)
class Profile:
    """`begin` and `end` (column, row) in pixels; `distance` [n] from `begin` in pixels; luminance
    relative to the mean of full scattering: the `truth` with its standard error, and the models'
    in their order, [n] each."""

    begin: tuple[float, float]
    end: tuple[float, float]
    distance: Values
    truth: Values
    noise: Values
    models: tuple[Values, ...]


@lru_cache(maxsize=1)
def profile(comparison: Comparison) -> Profile:
    """The profile of every model beside full scattering."""
    full, mask = comparison.full.image, comparison.mask
    luminance = full.value @ LUMINANCE
    mean = max(float(luminance[mask].mean()), 1e-12)
    columns, rows = line(luminance, mask)
    # A pixel's colours share their noise.
    deviation = np.sqrt(full.variance) @ LUMINANCE
    return Profile(
        (float(columns[0]), float(rows[0])),
        (float(columns[-1]), float(rows[-1])),
        np.hypot(columns - columns[0], rows - rows[0]),
        sample(luminance, columns, rows) / mean,
        sample(deviation, columns, rows) / mean,
        tuple(
            sample(found.images.displayed.value @ LUMINANCE, columns, rows) / mean
            for _, found in comparison.measured
        ),
    )


def line(luminance: Values, mask: Mask) -> tuple[Values, Values]:
    """Columns and rows [n] of points along the line through the steepest place."""
    height, width = mask.shape
    smooth = smoothed(luminance, max(1, round(SMOOTHING * width)))
    down, right = (np.gradient(smooth, axis=axis) for axis in (0, 1))
    steepness: Values = np.hypot(down, right)
    inside = mask
    for margin in range(max(1, round(RIM * width)), -1, -1):
        inside = eroded(mask, margin)
        if inside.any():
            break
    row, column = divmod(int(np.argmax(np.where(inside, steepness, -1))), width)
    along = np.array([right[row, column], down[row, column]])
    size = float(np.hypot(*along))
    along = along / size if size > 0 else np.array([1.0, 0.0])
    steps = np.arange(-FINE * (height + width), FINE * (height + width) + 1) / FINE
    columns, rows = column + steps * along[0], row + steps * along[1]
    near = (np.rint(rows).astype(int), np.rint(columns).astype(int))
    seen = (near[0] >= 0) & (near[0] < height) & (near[1] >= 0) & (near[1] < width)
    seen[seen] = mask[near[0][seen], near[1][seen]]
    # From rim to rim around the steepest place; what lies beyond a gap is another part.
    middle = len(steps) // 2
    gaps = np.flatnonzero(~seen)
    first = int(gaps[gaps < middle].max(initial=-1)) + 1
    last = int(gaps[gaps > middle].min(initial=len(steps)))
    return columns[first:last], rows[first:last]


def smoothed(values: Values, radius: int) -> Values:
    """Twice the mean over 2 radius + 1 pixels along each axis."""
    return box_means(box_means(values, radius), radius)


def box_means(values: Values, radius: int) -> Values:
    """The mean over 2 radius + 1 pixels along each axis; borders are continued."""
    for axis in (0, 1):
        padded = np.pad(values, [(radius, radius) if a == axis else (0, 0) for a in (0, 1)], "edge")
        sums = np.cumsum(padded, axis=axis)
        sums = np.concatenate([np.zeros_like(np.take(sums, [0], axis)), sums], axis=axis)
        count = values.shape[axis]
        ends = np.take(sums, np.arange(2 * radius + 1, 2 * radius + 1 + count), axis)
        values = (ends - np.take(sums, np.arange(count), axis)) / (2 * radius + 1)
    return values


def eroded(mask: Mask, margin: int) -> Mask:
    """Pixels farther than `margin` from all that is outside, along both axes; so is the image's
    surroundings."""
    inside = np.pad(mask, margin + 1).astype(np.float64)
    full = box_means(inside, margin)
    return np.asarray(full[margin + 1 : -margin - 1, margin + 1 : -margin - 1] > 1 - 1e-9)


def sample(values: Values, columns: Values, rows: Values) -> Values:
    """Bilinear values at points, borders continued."""
    height, width = values.shape
    x, y = np.clip(columns, 0, width - 1), np.clip(rows, 0, height - 1)
    i, j = (np.floor(each).astype(int) for each in (x, y))
    right, below = np.minimum(i + 1, width - 1), np.minimum(j + 1, height - 1)
    a, b = x - i, y - j
    upper = values[j, i] * (1 - a) + values[j, right] * a
    lower = values[below, i] * (1 - a) + values[below, right] * a
    return np.asarray(upper * (1 - b) + lower * b)
