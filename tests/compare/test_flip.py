"""HDR-FLIP: the library's own figures where they are meant, and its noise."""

import flip_evaluator
import numpy as np
import pytest

from volillum_addon.compare.flip import Eye, _exposures
from volillum_addon.compare.metrics import Image
from volillum_addon.core.colour import LUMINANCE

SHAPE = (24, 30)
EVERYWHERE = np.ones(SHAPE, bool)


def picture(seed: int = 1) -> np.ndarray:
    """A smooth picture with a highlight."""
    y, x = np.mgrid[0 : SHAPE[0], 0 : SHAPE[1]] / 30
    grey = 0.3 + 0.2 * np.sin(3 * x + seed) * np.cos(2 * y) + 4 * np.exp(-8 * (x - 1) ** 2)
    return grey[..., None] * np.array([1.0, 0.9, 0.7])


def test_without_noise_it_is_the_library_s_own_figure() -> None:
    # 2 % of the pixels are equally bright and the brightest.
    truth = np.minimum(picture(), np.quantile(picture()[..., 0], 0.98) * np.array([1.0, 0.9, 0.7]))
    other = truth * 1.1
    found = Eye(Image.noiseless(truth), EVERYWHERE).flip([other])
    _, mean, given = flip_evaluator.evaluate(
        truth.astype(np.float32), other.astype(np.float32), "HDR", applyMagma=False
    )
    exposures = _exposures((truth @ LUMINANCE).ravel())
    # The library's median is a value, ours lies between two: a few hundredths of a stop.
    assert exposures["startExposure"] == pytest.approx(given["startExposure"], abs=1e-5)
    assert exposures["stopExposure"] == pytest.approx(given["stopExposure"], abs=0.05)
    assert exposures["numExposures"] == given["numExposures"]
    assert found.value == pytest.approx(mean, rel=2e-3)
    assert (found.noise, found.is_bound) == (0, False)


def test_black_around_the_volume_changes_nothing() -> None:
    truth, other = picture(), picture() * 1.1
    mask = EVERYWHERE.copy()
    mask[:, 20:] = False
    inside = Eye(Image.noiseless(truth[:, :20]), mask[:, :20]).flip([other[:, :20]])
    wide = (3 * SHAPE[0], 3 * SHAPE[1])
    around, around_other, around_mask = np.zeros((*wide, 3)), np.zeros((*wide, 3)), np.zeros(wide)
    place = np.s_[20 : 20 + SHAPE[0], 30:50]
    around[place], around_other[place], around_mask[place] = truth[:, :20], other[:, :20], 1
    found = Eye(Image.noiseless(around), around_mask.astype(bool)).flip([around_other])
    assert found.value == pytest.approx(inside.value, rel=1e-6)


def test_equal_and_constant_pictures_differ_by_nothing() -> None:
    for truth in (picture(), np.full((*SHAPE, 3), 0.5), np.zeros((*SHAPE, 3))):
        found = Eye(Image.noiseless(truth), EVERYWHERE).flip([truth])
        assert (found.value, found.is_bound) == (0, False)


@pytest.mark.parametrize("factor", [1.02, 1.3])
def test_the_reference_s_noise_is_taken_off_and_stated(factor: float) -> None:
    truth, random = picture(), np.random.default_rng(3)
    exact = Eye(Image.noiseless(truth), EVERYWHERE).flip([truth * factor]).value
    deviation = 0.02 * truth
    found, plain = [], []
    for seed in range(8):
        noisy = truth + deviation * random.standard_normal((*SHAPE, 1))
        reference = Image(noisy, deviation**2, 15)
        found.append(Eye(reference, EVERYWHERE, seed).flip([truth * factor]))
        plain.append(Eye(Image.noiseless(noisy), EVERYWHERE).flip([truth * factor]).value)
    assert not any(each.is_bound for each in found)
    values = [each.value for each in found]
    raised, left = np.mean(plain) - exact, np.mean(values) - exact
    spread = np.std(values, ddof=1)
    # The first order of what noise adds is taken off: at least a quarter, and no more than it is
    # by more than chance.
    assert np.mean(values) < np.mean(plain) - raised / 4
    assert abs(left) < raised / 2 + 4 * spread / np.sqrt(8)
    # The standard error has 3 degrees of freedom, and the spread of 8 is known to 27 %.
    stated = np.sqrt(np.mean([each.noise**2 for each in found]))
    assert 0.4 < stated / spread < 2.5


def test_a_picture_like_the_truth_is_a_bound() -> None:
    truth, random = picture(), np.random.default_rng(4)
    deviation = 0.03 * truth
    bounds = []
    for seed in range(8):
        noisy = truth + deviation * random.standard_normal((*SHAPE, 1))
        bounds.append(Eye(Image(noisy, deviation**2, 15), EVERYWHERE, seed).flip([truth]))
    # 2.3 % are seen by chance if the standard error is right; it has 3 degrees of freedom: 7 %.
    assert sum(each.is_bound for each in bounds) >= 6
    assert all(each.value >= each.noise > 0 for each in bounds)


def test_draws_of_a_random_picture_bring_their_spread() -> None:
    truth, random = picture(), np.random.default_rng(5)
    draws = truth * (1 + 0.2 * random.standard_normal((3, *SHAPE, 1)))
    eye = Eye(Image.noiseless(truth), EVERYWHERE)
    each = [eye.flip([draw]).value for draw in draws]
    found = eye.flip(list(draws))
    assert found.value == pytest.approx(np.mean(each), rel=1e-12)
    assert found.noise == pytest.approx(np.std(each, ddof=1) / np.sqrt(3), rel=1e-9)
