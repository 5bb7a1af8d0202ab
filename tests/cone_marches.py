"""Calls of the cone transport that its tests share."""

from __future__ import annotations

import math

import numpy as np
from media import smooth_random
from numpy.typing import NDArray
from trilinear import Array, affine

import volillum_native
from volillum_addon.core.directions import about, cone_rule

Volume = NDArray[np.float32]
THETA = math.radians(30)
# float32 sums of a few products a step; rounding of either sign adds up as a random walk.
ROUNDING = 2e-6


def unit(*vector: float) -> Array:
    return np.array(vector) / np.linalg.norm(vector)


Z = unit(0, 0, 1)
AXES = {
    "along z": Z,
    "along -x": unit(-1, 0, 0),
    "oblique": unit(-1, 2, -3),
    "diagonal": unit(1, 1, 1),
}
AFFINES = {
    "cubes": np.diag([0.05, 0.05, 0.05, 1.0]),
    "oblong": np.diag([0.03, 0.05, 0.1, 1.0]),
    "sheared": affine(1) * 0.06,
    "mirrored": affine(2, mirrored=True) * 0.06,
}
for each in AFFINES.values():
    each[3, 3] = 1.0


def transport(
    sigma_t: Volume,
    sigma_s: Volume,
    world: Array,
    axis: Array,
    *,
    theta: float = THETA,
    count: int = 16,
    spacing: float = 1.0,
    threads: int = 0,
    directions: Array | None = None,
) -> Volume:
    """The solution [c, i, j, k] of the medium [c, i, j, k] (or [i, j, k])."""
    vectors, weights = cone_rule(theta, count)
    return volillum_native.cone_transport(
        sigma_t if sigma_t.ndim == 4 else sigma_t[None],
        sigma_s if sigma_s.ndim == 4 else sigma_s[None],
        world,
        axis,
        about(vectors, axis) if directions is None else directions,
        weights,
        spacing=spacing,
        threads=threads,
    )


def smooth(shape: tuple[int, int, int] = (14, 16, 18), depth: float = 4.0) -> Volume:
    """Smooth values for voxels of about 0.05: optical depth about `depth` across."""
    return smooth_random(shape, seed=3, depth=depth).sigma_t.values
