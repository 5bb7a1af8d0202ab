"""Passes of the photon engine that its tests share."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

import volillum_native as native
from volillum_native import Photons, PhotonSource

# Sheared, oblong, mirrored.
AFFINE = np.array([[0.1, 0.02, 0, 3], [0, -0.12, 0.01, 1], [0, 0, 0.09, -2], [0, 0, 0, 1.0]])


def random_medium(size: int = 10, channels: int = 1, seed: int = 0) -> NDArray[np.float32]:
    random = np.random.default_rng(seed)
    return (random.random((channels, size, size + 1, size + 2)) * 8).astype(np.float32)


class Run:
    """Passes of one source; `tallies` has each pass's power."""

    def __init__(
        self,
        sigma_t: NDArray[np.float32],
        sigma_s: NDArray[np.float32],
        source: PhotonSource,
        *,
        g: float = 0.0,
        affine: NDArray[np.float64] = AFFINE,
        photons: int = 10_000,
        unscattered: bool = True,
        moments: int = 1,
    ) -> None:
        self.engine = Photons(sigma_t, sigma_s, affine, g)
        self.source, self.photons, self.unscattered = source, photons, unscattered
        colours = self.engine.colours(source)
        self.shape = sigma_t.shape[1:]
        plain = (math.prod(self.shape), colours)
        self.sums, self.deviations = np.zeros(plain, np.float32), np.zeros(plain, np.float32)
        self.higher = self.wraps = None
        if moments > 1:
            shape = (plain[0], moments - 1, colours)
            self.higher, self.wraps = np.zeros(shape, np.int32), np.zeros(shape, np.int32)
        self.tallies: list[dict[str, object]] = []

    def add(self, *passes: int, seed: int = 1, threads: int = 0) -> Run:
        for index in passes:
            self.tallies.append(
                self.engine.run(
                    self.source, self.sums, self.deviations, self.higher, self.wraps,
                    seed=seed, pass_index=index, photons=self.photons,
                    unscattered=self.unscattered, threads=threads,
                )
            )  # fmt: skip
        return self

    def unit(self) -> float:
        return self.engine.deposit_unit(self.source, self.unscattered) / self.photons

    def moments(self) -> NDArray[np.float64]:
        """Sums of all moments, [voxels, moments, colours]."""
        first = self.sums[:, None].astype(np.float64)
        if self.higher is None or self.wraps is None:
            return first
        higher = (self.higher + self.wraps * 2.0**32) * native.higher_unit
        return np.concatenate([first, higher], axis=1)

    def replicates(self, count: int, seed: int = 1) -> NDArray[np.float64]:
        """In-scattered radiance of independent passes, [count, voxels, moments, colours]."""
        found = []
        for index in range(count):
            for array in (self.sums, self.higher, self.wraps):
                if array is not None:
                    array[:] = 0
            self.add(index, seed=seed)
            found.append(self.moments() * self.unit())
        return np.array(found)


def z_scores(replicates: NDArray[np.float64], truth: NDArray[np.float64] | float) -> NDArray:
    """Deviations of the mean of replicates [r, ...] from the truth in standard errors."""
    error = replicates.std(axis=0, ddof=1) / math.sqrt(len(replicates))
    return np.asarray((replicates.mean(axis=0) - truth) / error)
