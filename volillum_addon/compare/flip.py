"""HDR-FLIP: how different two pictures look, by flip-evaluator, with the noise of that figure.

FLIP (Andersson et al. 2020, 2021) compares two pictures as an eye that flips between them does, 0
alike, 1 as different as can be, under all exposures that show something of the reference. Here it
is the mean over the volume's silhouette; its range of exposures is that of the silhouette too: the
library's own looks at the whole picture, and black around the volume would stretch it without end.

The reference's own noise makes FLIP larger. How much is found by adding that noise once more (a
parametric bootstrap from the variance of the pixels):

    value = flip(image, reference) - [mean of flip(image, resampled) - flip(image, reference)]

and the spread of the resampled figures is its standard error. Where the figure does not stand out
from the floor, what noise alone does to the reference (flip(reference, resampled)), it is a bound:
noise only adds, so that the figure before the correction is above the truth.
"""

from __future__ import annotations

import importlib.util
import math
import platform
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..core.colour import LUMINANCE
from ..core.errors import InputError
from .metrics import DETECTION, Image, Mask

Values = NDArray[np.float64]
# Resampled references behind a standard error.
RESAMPLED = 4
# What counts as the brightest: the very brightest pixel of a path-traced picture is noise.
BRIGHTEST = 0.99
# The tone curve of the library's default (ACES, as a quotient of two squares), and the level that
# its exposures carry the brightest and the median luminance to.
TONE_UPPER, TONE_LOWER, TONE_LEVEL = (0.9036, 0.018, 0.0), (0.8748, 0.354, 0.14), 0.85


@dataclass(frozen=True)
class Flip:
    """A FLIP difference, 0 to 1, and its standard error; of a bound the bound itself."""

    value: float
    noise: float
    is_bound: bool


def check() -> None:
    """Raise InputError where flip-evaluator is missing: it is published for Python 3.13 alone, and
    some Blenders are built with a newer one."""
    if importlib.util.find_spec("flip_evaluator") is None:
        version = platform.python_version()
        raise InputError(f"flip-evaluator is not there for Python {version}; expected a Blender "
                         "with Python 3.13, as the Blender Foundation's, to compare")  # fmt: skip


class Eye:
    """Looks at pictures [h, w, 3] beside one reference, inside its silhouette."""

    def __init__(self, truth: Image, mask: Mask, seed: int = 0) -> None:
        rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
        self._box = np.s_[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
        self._mask = mask[self._box]
        self._truth, self._variance = truth.value[self._box], truth.variance[self._box]
        self._exposures = _exposures((truth.value @ LUMINANCE)[mask])
        self._seed = seed

    def identity(self) -> dict[str, object]:
        """All that a figure depends on, but the picture."""
        return {"truth": self._truth, "variance": self._variance, "mask": self._mask,
                "seed": self._seed}  # fmt: skip

    @cached_property
    def _resampled(self) -> tuple[Values, ...]:
        """The reference with its noise once more; a pixel's colours share theirs."""
        if not self._variance.any():
            return ()
        random = np.random.default_rng(self._seed)
        deviation = np.sqrt(self._variance)
        return tuple(
            self._truth + deviation * random.standard_normal((*self._mask.shape, 1))
            for _ in range(RESAMPLED)
        )

    @cached_property
    def _floor(self) -> float:
        seen = [self._see(self._truth, other) for other in self._resampled]
        return float(np.mean(seen)) if seen else 0.0

    def flip(self, draws: Sequence[NDArray[np.floating]]) -> Flip:
        """The difference to expect of a picture that is random, from independent draws of it; of
        one that is not, from itself alone."""
        seen = [self._see(draw[self._box], self._truth) for draw in draws]
        first = draws[0][self._box]
        again = [self._see(first, other) for other in self._resampled]
        variance = float(np.var(again, ddof=1)) if again else 0.0
        if len(seen) > 1:
            variance += float(np.var(seen, ddof=1)) / len(seen)
        mean, noise = float(np.mean(seen)), math.sqrt(variance)
        if mean > self._floor + DETECTION * noise:
            raised = float(np.mean(again)) - seen[0] if again else 0.0
            return Flip(max(mean - max(raised, 0.0), 0.0), noise, is_bound=False)
        bound = mean + DETECTION * noise
        return Flip(bound, bound, is_bound=bound > 0)

    def _see(self, picture: NDArray[np.floating], truth: NDArray[np.floating]) -> float:
        import flip_evaluator  # not there for every Python, and only comparisons need it

        pictures = [
            np.ascontiguousarray(np.maximum(each, 0), np.float32) for each in (truth, picture)
        ]
        seen, _, _ = flip_evaluator.evaluate(
            *pictures, "HDR", applyMagma=False, computeMeanError=False, parameters=self._exposures
        )
        return float(np.asarray(seen, np.float64).reshape(self._mask.shape)[self._mask].mean())


def _exposures(luminance: Values) -> dict[str, float | int]:
    """The library's range of exposures for these luminances alone, from the median's to that of
    nearly the brightest."""
    a, b, c = (
        upper - TONE_LEVEL * lower for upper, lower in zip(TONE_UPPER, TONE_LOWER, strict=True)
    )
    level = (-b + math.sqrt(b * b - 4 * a * c)) / (2 * a)
    brightest = max(float(np.quantile(luminance, BRIGHTEST)), 1e-12)
    # Never darker than a thousandth: 10 stops show what there is.
    median = max(float(np.median(luminance)), 1e-3 * brightest)
    start, stop = math.log2(level / brightest), math.log2(level / median)
    # The library ends the process where they are equal.
    stop = max(stop, start + 1e-3)
    return {
        "startExposure": start,
        "stopExposure": stop,
        "numExposures": max(2, math.ceil(stop - start)),
    }
