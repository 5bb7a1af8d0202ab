"""Photon runs as the tests of the model make and compare them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from media import smooth_random
from numpy.typing import NDArray

from volillum_addon.core.lights import EnvironmentLight
from volillum_addon.core.scene import Scene
from volillum_addon.models.illuminate import bake
from volillum_addon.models.volume import IlluminationVolume

MODEL = "photon_mapping"
MEDIUM = replace(
    smooth := smooth_random((11, 10, 12), 3, depth=4.0),
    sigma_s=smooth.sigma_t.with_values(smooth.sigma_t.values * np.float32(0.9)),
)
SKY = EnvironmentLight(1.0)
# 4.5 standard errors of 16 passes (t with 15 degrees of freedom): one in 2000.
LIMIT = 4.5
VIEWS = (np.array([0.0, 0.0, 1.0]), np.array([0.6, 0.0, 0.8]), np.array([-0.48, 0.64, -0.6]))


def light_of(volume: IlluminationVolume) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """In-scattered radiance and its standard error, [i, j, k, 3]."""
    error = volume.channels["standard_error"].values.astype(np.float64)
    return volume.in_scattered().values.astype(np.float64), (
        error if error.ndim == 4 else error[..., None]
    )


def replicates(scene: Scene, count: int, **parameters: object) -> NDArray[np.float64]:
    """Whole bakes with different seeds: independent, whatever voxels share.

    16 slices near each voxel integrated exactly: nearly all of this small medium.
    """
    parameters = {"near": 16, "photons": 4000, **parameters}
    return np.array(
        [bake(scene, MODEL, noise_seed=seed, **parameters).in_scattered().values
         for seed in range(count)], np.float64
    )  # fmt: skip


def same_mean(first: NDArray[np.float64], second: NDArray[np.float64], slack: float = 0.0) -> None:
    """Two sets of replicates [r, ...] of fields agree: their mean over voxels, and each voxel.

    `slack` is what quadrature of unscattered light may add, a share of the mean.
    """
    for average in (True, False):
        a, b = ((x.reshape(len(x), -1).mean(1, keepdims=True) if average else x)
                for x in (first, second))  # fmt: skip
        error = np.sqrt(a.var(0, ddof=1) / len(a) + b.var(0, ddof=1) / len(b))
        allowed = slack * b.mean() + (LIMIT if average else 8.0) * error
        # 8: voxels are thousands, degrees of freedom about 14.
        assert np.all(np.abs(a.mean(0) - b.mean(0)) <= allowed)


def sun_in_a_map(right: float, down: float) -> NDArray[np.float64]:
    """A dim sky of 1024 x 512 pixels whose light is an even sun of 70,000 of a pixel's size, moved
    by these shares of a pixel: its four pixels get what they hold of it."""
    image = np.full((512, 1024, 3), (0.2, 0.3, 0.5))
    row, column = 140, 733
    for i, high in ((0, 1 - down), (1, down)):
        for j, wide in ((0, 1 - right), (1, right)):
            image[row + i, column + j] += high * wide * np.array([70_000.0, 65_000.0, 55_000.0])
    return image
