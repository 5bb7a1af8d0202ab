"""What the tests of the judge share: media, lobes, and how estimates are compared with truth."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats
from trilinear import Array

import volillum_native as native

UP = np.array([0.0, 0.0, 1.0])
# A voxel so wide that rays leaving sideways have cosines below 1e-4: a half space of three voxels.
WIDE = 1e4
REPLICATES = 8
# |t| of 7 degrees of freedom exceeds 7 in 2e-4 of cases.
SIGMAS = 7.0
# sigma_t and the geometry in float32 and the sides' 1e-4 together.
SYSTEMATIC = 1e-6


def in_scattered(*arguments: Any, **settings: Any) -> tuple[Array, Array]:
    """Value and standard error; nothing may be neglected."""
    value, error, neglected = native.exact_in_scattered(*arguments, **settings)
    assert np.all(neglected == 0)
    return value, error


def constant(radiance: ArrayLike) -> Array:
    """Coefficients of one radiance from everywhere."""
    return np.broadcast_to(np.asarray(radiance, float), 3)[None] * math.sqrt(4 * math.pi)


def cone(axis: ArrayLike, degrees: float, radiance: ArrayLike = 1.0) -> tuple[Any, ...]:
    """A cone about a direction."""
    cosine = math.cos(math.radians(degrees))
    return np.asarray(axis, float), "direction", cosine, constant(radiance)


def half_space(depth: float, floor: float = 1.0) -> tuple[NDArray[np.float32], Array, Array]:
    """sigma_t = 1 around the point [1, 3] at optical depth `depth`, `floor` below it.

    The border's fall-off over one voxel has the depth of half a voxel: `slices` + 1/2 above.
    """
    slices, below = 16, 4
    step = depth / (slices + 0.5)
    sigma_t = np.ones((1, 3, 3, below + slices + 1), np.float32)
    sigma_t[..., :below] = floor
    return sigma_t, np.diag([WIDE, WIDE, step, 1.0]), np.array([[WIDE, WIDE, below * step]])


def check(value: Array, error: Array, truth: ArrayLike, systematic: float = SYSTEMATIC) -> None:
    """The estimate is within SIGMAS of its own errors, and those are small."""
    assert np.all(error <= 2e-2 * np.asarray(truth) + 1e-12)  # an estimate, not a guess
    assert np.all(np.abs(value - truth) <= SIGMAS * error + systematic)


def check_statistics(value: Array, error: Array, truth: float, skew: float = 0.02) -> None:
    """Independent estimates [n] of `truth`, each with the error of REPLICATES replicates: they are
    unbiased, and their errors cover the truth as often as they say.

    `skew` is how much of the coverage the replicates' departure from a normal distribution may
    take.
    """
    count = len(value)
    z = (value.mean() - truth) / (value.std(ddof=1) / math.sqrt(count))
    assert abs(z) < 4  # one seed in 16,000
    expected = 1 - 2 * stats.t.sf(1, REPLICATES - 1)
    inside = int((np.abs(value - truth) < error).sum())
    noise = 4 * math.sqrt(expected * (1 - expected) / count)
    assert abs(inside / count - expected) < noise + skew
    # The mean squared error that is claimed is the one that is made (t with 7 degrees of freedom).
    made, claimed = np.mean((value - truth) ** 2), np.mean(error**2)
    assert abs(made / claimed - 1) < 4 * math.sqrt(2 / count + 2 / (7 * count))
