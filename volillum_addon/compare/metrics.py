"""How far an estimate is from a truth, with the noise of that figure itself.

An image here is [h, w, 3] float64 with the variance of every value. Figures are formed inside the
volume's silhouette, over all pixels and colours together:

    relative RMSE = sqrt(Q),  Q = (sum err^2 - sum var(err)) / (sum truth^2 - sum var(truth))
    bias          = sum err / sum truth

with err = estimate - truth. Subtracting the variances removes the part of the RMSE that is only
the images' own noise. What remains has a standard error, derived here from the variances:
neighbouring pixels are independent (box filter, no denoising), the colours of a pixel count as
fully correlated, which can only make the noise that we state too large. For one value with error e
and variance S, estimated with n degrees of freedom,

    var(err^2 - S') = 4 e^2 S + 2 S^2 (1 + 1 / n),  and a change dF of the truth changes Q by
    -2 (e + Q F) dF / sum truth^2.

A Q below twice its standard error is not told from zero. Its figure is then a bound, the RMSE
which 97.5 % of such measurements of a larger error would exceed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..core.errors import bad

# Rays that lose less than this share of their light count as beside the volume.
SILHOUETTE_TRANSMITTANCE = 0.999
# Blocks of two compared images with less than this share of the brightest one's light are left out:
# at the volume's rim few samples hit anything, and where none did the variance is 0 by mistake.
FAINT_BLOCK = 0.02
# Standard errors that a squared error must stand out by to count as seen (one-sided 97.7 %).
DETECTION = 2.0

Values = NDArray[np.float64]
Mask = NDArray[np.bool_]
Choice = NDArray[np.bool_] | NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Image:
    """Values and their variances, of one shape [..., 3]; `degrees` of freedom are behind the
    variances (infinity: known, as for a noise-free image)."""

    value: Values
    variance: Values
    degrees: float = math.inf

    def __post_init__(self) -> None:
        if self.value.shape != self.variance.shape or self.value.shape[-1:] != (3,):
            raise bad("an image's shapes", (self.value.shape, self.variance.shape), "equal, RGB")
        if not (np.all(np.isfinite(self.value)) and np.all(np.isfinite(self.variance))):
            raise bad("an image", "not finite", "finite values and variances")

    @classmethod
    def noiseless(cls, value: NDArray[np.floating]) -> Image:
        """An image that is what it is."""
        exact = np.asarray(value, dtype=np.float64)
        return cls(exact, np.zeros_like(exact))

    def scaled(self, factor: float) -> Image:
        """The image under another exposure."""
        return Image(self.value * factor, self.variance * factor**2, self.degrees)

    def inside(self, choice: Choice) -> Image:
        """The values of a mask's pixels, or at indices of the first axis: [n, 3]."""
        return Image(self.value[choice], self.variance[choice], self.degrees)


@dataclass(frozen=True)
class Figure:
    """An error and its noise. With `is_bound`, `relative_rmse` is an upper bound: nothing was seen
    above the noise. `noise` and `bias_noise` are standard errors (of a bound: the bound itself).
    """

    relative_rmse: float
    noise: float
    bias: float
    bias_noise: float
    is_bound: bool


@dataclass(frozen=True)
class Exposure:
    """The one factor that brings an image closest to the truth, and its standard error."""

    factor: float
    noise: float


@dataclass(frozen=True)
class Agreement:
    """Two independent images of one truth, in units of their noise.

    `mean_z_squared` of block means should be 1 +- `spread`, `bias_z` of the whole 0 +- 1.
    """

    mean_z_squared: float
    spread: float
    bias_z: float
    blocks: int

    @property
    def agrees(self) -> bool:
        """Whether both statistics stay within three standard errors."""
        return self.mean_z_squared < 1 + 3 * self.spread and abs(self.bias_z) < 3


def silhouette(transmittance: Values) -> Mask:
    """Pixels [h, w] of the volume, from the core's line integral [h, w, 1 or 3]."""
    mask = np.asarray(transmittance.min(axis=-1) < SILHOUETTE_TRANSMITTANCE)
    if not mask.any():
        raise bad("the volume's silhouette", "empty", "the camera to see the volume")
    return mask


def figure(estimate: Image, truth: Image, mask: Mask) -> Figure:
    """The error of `estimate` against `truth` inside `mask`."""
    a, b = estimate.inside(mask), truth.inside(mask)
    error = a.value - b.value
    scale = float(np.sum(b.value**2) - np.sum(b.variance))
    total = float(np.sum(b.value))
    if not (scale > 0 and total > 0):
        raise bad("the truth inside the silhouette", "black or all noise", "some light")
    q = float(np.sum(error**2) - np.sum(a.variance) - np.sum(b.variance)) / scale
    # Gradients of Q's numerator by the two images; never below 0, as Q may be by its noise.
    share = max(q, 0.0)
    variance = (
        _square_variance(error, a.variance, a.degrees)
        + _square_variance(error + share * b.value, b.variance, b.degrees)
        + _mixed_variance(a.variance, b.variance)
    )
    bias = float(np.sum(error)) / total
    bias_variance = _sum_variance(a.variance) + (1 + bias) ** 2 * _sum_variance(b.variance)
    return _figure(q, math.sqrt(max(variance, 0.0)) / scale, bias, math.sqrt(bias_variance) / total)


def drawn_figure(draws: Values, truth: Image, mask: Mask) -> Figure:
    """The error to expect of an image that is itself random, from independent `draws`
    [n, h, w, 3]: their noise is error and stays, as whoever renders one such image has it.

    The standard error holds the spread of the draws and the truth's noise, which all share.
    """
    b = truth.inside(mask)
    errors = draws[:, mask] - b.value
    count = len(errors)
    if count < 2:
        raise bad("draws of a random image", count, "at least 2")
    scale = float(np.sum(b.value**2) - np.sum(b.variance))
    total = float(np.sum(b.value))
    if not (scale > 0 and total > 0):
        raise bad("the truth inside the silhouette", "black or all noise", "some light")
    squares = (np.sum(errors**2, axis=(1, 2)) - np.sum(b.variance)) / scale
    biases = np.sum(errors, axis=(1, 2)) / total
    q, bias = float(squares.mean()), float(biases.mean())
    shared = _square_variance(errors.mean(axis=0) + max(q, 0.0) * b.value, b.variance, b.degrees)
    bias_shared = (1 + bias) ** 2 * _sum_variance(b.variance)
    return _figure(
        q,
        math.sqrt(max(shared, 0.0) / scale**2 + float(squares.var(ddof=1)) / count),
        bias,
        math.sqrt(bias_shared / total**2 + float(biases.var(ddof=1)) / count),
    )


def sampled_figure(
    estimate: Image, truth: Image, counts: NDArray[np.integer] | None = None
) -> Figure:
    """The error at points [n, ..., 3] that are themselves a random sample of a population, each
    counted `counts` [n] times (once).

    The noise is the spread of the points' own contributions, so it holds the choice of the points
    as well as the variances: a point that counts twice brings the same noise twice, not two
    independent ones. The bias is relative to the truth's magnitudes; the truth may be negative.
    """
    error = estimate.value - truth.value
    times = np.ones(len(error)) if counts is None else np.asarray(counts, np.float64)

    def total(values: Values) -> Values:
        """All values of a point, [n]."""
        return np.asarray(values.reshape(len(values), -1).sum(axis=-1))

    squares = times * total(error**2 - estimate.variance - truth.variance)
    weights = times * total(truth.value**2 - truth.variance)
    count = len(squares)
    if count < 2 or not weights.sum() > 0:
        raise bad("the sampled points", f"{count}, or all dark", "at least 2 with some light")
    q = float(squares.sum() / weights.sum())
    spread = float(np.sqrt(np.sum((squares - q * weights) ** 2) * count / (count - 1)))
    sums, totals = times * total(error), times * total(np.abs(truth.value))
    bias = float(sums.sum() / totals.sum())
    bias_spread = float(np.sqrt(np.sum((sums - bias * totals) ** 2) * count / (count - 1)))
    return _figure(q, spread / float(weights.sum()), bias, bias_spread / float(totals.sum()))


def best_exposure(estimate: Image, truth: Image, mask: Mask) -> Exposure:
    """Least squares over all pixels and colours: argmin of sum (factor estimate - truth)^2."""
    a, b = estimate.inside(mask), truth.inside(mask)
    scale = float(np.sum(a.value**2) - np.sum(a.variance))
    if scale <= 0:
        raise bad("the image inside the silhouette", "black or all noise", "some light")
    factor = float(np.sum(a.value * b.value)) / scale
    variance = _gradient_variance(a.value, b.variance) + _gradient_variance(
        2 * factor * a.value - b.value, a.variance
    )
    return Exposure(factor, math.sqrt(variance) / scale)


def relative_noise(image: Image, mask: Mask) -> float:
    """Relative RMS of the image's standard errors inside `mask`: the noise level of a reference."""
    some = image.inside(mask)
    noise = float(np.sum(some.variance))
    signal = float(np.sum(some.value**2)) - noise
    return math.sqrt(noise / signal) if signal > 0 else math.inf


def agreement(first: Image, second: Image, mask: Mask, block: int = 8) -> Agreement:
    """Whether two noisy images [h, w, 3] show the same: means over blocks of pixels in units of
    their standard errors. Blocks make the statistic normal and sensitive to systematic errors;
    those with hardly any light count in the bias alone."""
    height, width = mask.shape
    rows, columns = np.indices(mask.shape) // block
    label = (rows * ((width + block - 1) // block) + columns)[mask]
    count = ((height + block - 1) // block) * ((width + block - 1) // block)
    error = (first.value - second.value)[mask].sum(axis=-1)
    variance = np.sum(
        [np.sqrt(image.variance[mask]).sum(axis=-1) ** 2 for image in (first, second)], axis=0
    )
    sums = np.bincount(label, error, minlength=count)
    variances = np.bincount(label, variance, minlength=count)
    light = np.bincount(label, (first.value + second.value)[mask].sum(axis=-1), minlength=count)
    seen = (variances > 0) & (light > FAINT_BLOCK * light.max())
    if not seen.any():
        raise bad("the noise of two images to compare", 0, "some in at least one of them")
    squared = sums[seen] ** 2 / variances[seen]
    blocks = int(seen.sum())
    return Agreement(
        mean_z_squared=float(squared.mean()),
        spread=math.sqrt(2 / blocks),
        bias_z=float(error.sum() / math.sqrt(variance.sum())),
        blocks=blocks,
    )


def _figure(q: float, q_noise: float, bias: float, bias_noise: float) -> Figure:
    if q > DETECTION * q_noise:
        rmse = math.sqrt(q)
        return Figure(rmse, q_noise / (2 * rmse), bias, bias_noise, is_bound=False)
    bound = math.sqrt(max(q, 0.0) + DETECTION * q_noise)
    return Figure(bound, bound, bias, bias_noise, is_bound=bound > 0)


def _gradient_variance(gradient: Values, variance: Values) -> float:
    """Variance of sum(gradient * value), colours of a pixel fully correlated."""
    return float(np.sum(np.sum(np.abs(gradient) * np.sqrt(variance), axis=-1) ** 2))


def _sum_variance(variance: Values) -> float:
    return _gradient_variance(np.ones_like(variance), variance)


def _square_variance(error: Values, variance: Values, degrees: float) -> float:
    """Variance of sum(err^2 - variance), from the measured `error`, whose own square holds one
    more variance than the true error's: 4 err^2 S - 4 S^2 + 2 S^2 (1 + 1 / n)."""
    trace = np.sum(variance, axis=-1)
    # The square of an estimated variance is too large by the factor 1 + 2 / n on average.
    fourth = float(np.sum(trace**2)) / (1 + 2 / degrees)
    return 4 * _gradient_variance(error, variance) + (2 / degrees - 2) * fourth


def _mixed_variance(first: Values, second: Values) -> float:
    """What two noise parts add to each other's: 4 e^2 S of the one holds the other's variance,
    which is 4 S1 S2 once and not twice."""
    return -4 * float(np.sum(first.sum(axis=-1) * second.sum(axis=-1)))
