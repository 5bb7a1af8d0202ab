"""The figures on synthetic images whose errors are known, and the coverage of their noise."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from volillum_addon.compare.metrics import (
    Image,
    agreement,
    best_exposure,
    drawn_figure,
    figure,
    relative_noise,
    sampled_figure,
    silhouette,
)
from volillum_addon.core.errors import InputError

SHAPE = (24, 32, 3)
EVERYWHERE = np.ones(SHAPE[:2], bool)


def seeds_image(
    random: np.random.Generator, mean: NDArray[np.float64], deviation: float, seeds: int
) -> Image:
    """The mean of `seeds` noisy images, as a reference has it; colours share their noise."""
    noise = random.standard_normal((seeds, *SHAPE[:2], 1)) * deviation
    images = mean + noise
    return Image(images.mean(axis=0), images.var(axis=0, ddof=1) / seeds, seeds - 1)


def truth_of(random: np.random.Generator) -> NDArray[np.float64]:
    return random.uniform(0.5, 1.5, SHAPE)


def test_noiseless_figures_are_the_definitions() -> None:
    random = np.random.default_rng(1)
    truth = truth_of(random)
    error = random.normal(0.1, 0.3, SHAPE)
    result = figure(Image.noiseless(truth + error), Image.noiseless(truth), EVERYWHERE)
    expected = math.sqrt(np.sum(error**2) / np.sum(truth**2))
    assert result.relative_rmse == pytest.approx(expected, rel=1e-12)
    assert result.bias == pytest.approx(error.sum() / truth.sum(), rel=1e-12)
    assert (result.noise, result.bias_noise, result.is_bound) == (0, 0, False)


def test_equal_noiseless_images_have_no_error_and_no_noise() -> None:
    image = Image.noiseless(truth_of(np.random.default_rng(2)))
    result = figure(image, image, EVERYWHERE)
    assert (result.relative_rmse, result.noise, result.bias) == (0, 0, 0)
    assert not result.is_bound


def test_only_the_mask_counts() -> None:
    random = np.random.default_rng(3)
    truth = truth_of(random)
    wrong = truth * 1.25
    wrong[:, 16:] += 100
    mask = EVERYWHERE.copy()
    mask[:, 16:] = False
    result = figure(Image.noiseless(wrong), Image.noiseless(truth), mask)
    assert result.relative_rmse == pytest.approx(0.25)
    assert result.bias == pytest.approx(0.25)


@pytest.mark.parametrize("seeds", [4, 16])
@pytest.mark.parametrize("relative_error", [0.1, 0.3])
@pytest.mark.parametrize("colours", ["alike", "opposed"])
def test_the_noise_of_a_figure_covers_its_true_value(
    seeds: int, relative_error: float, colours: str
) -> None:
    # 400 independent references: with a right standard error 68.3 % of the figures lie within one
    # of the truth; the binomial standard error is 2.3 %, four of them 9.3 %. Noise and errors that
    # are alike in the colours are what the bound on their correlation is sharp for: then the
    # z-scores' spread is 1 +- 0.035, four of which are 0.14. Opposed errors can only make it less.
    random = np.random.default_rng([4, seeds, int(relative_error * 1000)])
    truth = truth_of(random)
    signs = np.array([1, 1, 1] if colours == "alike" else [1, -1, 1])
    error = random.normal(0, relative_error, (*SHAPE[:2], 1)) * signs
    estimate = Image.noiseless(truth + error)
    true_rmse = math.sqrt(np.sum(error**2) / np.sum(truth**2))
    true_bias = error.sum() / truth.sum()
    scores, bias_scores = [], []
    for _ in range(400):
        reference = seeds_image(random, truth, 0.2, seeds)
        result = figure(estimate, reference, EVERYWHERE)
        assert not result.is_bound
        scores.append((result.relative_rmse - true_rmse) / result.noise)
        bias_scores.append((result.bias - true_bias) / result.bias_noise)
    for score in (np.array(scores), np.array(bias_scores)):
        assert np.mean(np.abs(score) < 1) > 0.683 - 0.093
        assert abs(score.mean()) < 0.2  # 4 standard errors of the mean of 400
        assert score.std() < 1.14
        if colours == "alike":
            assert score.std() > 0.86


def test_the_noise_of_a_random_image_is_its_error() -> None:
    """Three draws with noise of 0.3 and a bias of 0.05 against a noisy reference."""
    random = np.random.default_rng(11)
    truth = truth_of(random)
    power = np.mean(truth**2)
    true_rmse = math.sqrt((0.3**2 + 0.05**2 * power) / power)
    scores, bias_scores = [], []
    for _ in range(400):
        noise = 0.3 * random.standard_normal((3, *SHAPE[:2], 1))
        result = drawn_figure(1.05 * truth + noise, seeds_image(random, truth, 0.2, 8), EVERYWHERE)
        scores.append((result.relative_rmse - true_rmse) / result.noise)
        bias_scores.append((result.bias - 0.05) / result.bias_noise)
    for score in (np.array(scores), np.array(bias_scores)):
        # Student's t of 2 degrees of freedom, tempered by the reference's part: within one standard
        # error lie 57.7 % to 68.3 %; four binomial standard errors are 10 %.
        inside = np.mean(np.abs(score) < 1)
        assert 0.577 - 0.1 < inside < 0.683 + 0.1
        assert abs(np.median(score)) < 0.25


def test_one_draw_alone_has_no_spread() -> None:
    truth = Image.noiseless(np.ones(SHAPE))
    with pytest.raises(InputError, match="draws of a random image is 1; expected at least 2"):
        drawn_figure(np.ones((1, *SHAPE)), truth, EVERYWHERE)


def test_noise_in_both_images_is_accounted_for() -> None:
    random = np.random.default_rng(5)
    truth = truth_of(random)
    scores = []
    for _ in range(400):
        estimate = seeds_image(random, truth * 1.1, 0.3, 8)
        reference = seeds_image(random, truth, 0.2, 4)
        result = figure(estimate, reference, EVERYWHERE)
        scores.append((result.relative_rmse - 0.1) / result.noise)
    assert abs(np.mean(scores)) < 0.2
    assert 0.7 < np.std(scores) < 1.15


def test_an_error_below_the_noise_is_a_bound_that_holds() -> None:
    # The true error is zero: the bound holds always, and nearly all figures are bounds (Q exceeds
    # twice its noise in 2.3 % of the cases; 400 tries make 9 +- 3).
    random = np.random.default_rng(6)
    truth = truth_of(random)
    bounds = []
    for _ in range(400):
        result = figure(Image.noiseless(truth), seeds_image(random, truth, 0.2, 4), EVERYWHERE)
        assert result.relative_rmse >= result.noise > 0
        bounds.append(result.is_bound)
    assert np.mean(bounds) > 1 - 0.023 - 4 * 0.0075


def test_the_bound_covers_an_error_that_is_hidden_in_the_noise() -> None:
    random = np.random.default_rng(7)
    truth = truth_of(random)
    wrong = truth + np.where(random.random(SHAPE) < 0.5, -1, 1) * 0.01
    true_rmse = math.sqrt(np.sum((wrong - truth) ** 2) / np.sum(truth**2))
    covered = []
    for _ in range(300):
        result = figure(Image.noiseless(wrong), seeds_image(random, truth, 0.3, 4), EVERYWHERE)
        covered.append(not result.is_bound or result.relative_rmse > true_rmse)
    # 97.7 % by construction; four binomial standard errors of 300 tries below that.
    assert np.mean(covered) > 0.977 - 4 * 0.0087


def test_the_mean_square_without_correction_would_be_wrong() -> None:
    # The uncorrected figure is the noise level itself; the corrected one is far below.
    random = np.random.default_rng(8)
    truth = truth_of(random)
    noisy = seeds_image(random, truth, 0.4, 4)
    plain = math.sqrt(np.sum((truth - noisy.value) ** 2) / np.sum(truth**2))
    result = figure(Image.noiseless(truth), noisy, EVERYWHERE)
    assert plain == pytest.approx(0.2 / math.sqrt(np.mean(truth**2)), rel=0.1)
    assert result.relative_rmse < 0.4 * plain


def test_best_exposure_finds_a_planted_factor() -> None:
    random = np.random.default_rng(9)
    truth = truth_of(random)
    estimate = Image.noiseless(truth / 1.7)
    scores = []
    for _ in range(200):
        exposure = best_exposure(estimate, seeds_image(random, truth, 0.2, 4), EVERYWHERE)
        scores.append((exposure.factor - 1.7) / exposure.noise)
    assert abs(np.mean(scores)) < 4 / math.sqrt(200)
    assert 0.7 < np.std(scores) < 1.2
    after = figure(estimate.scaled(1.7), Image.noiseless(truth), EVERYWHERE)
    assert after.relative_rmse < 1e-12


def test_no_other_exposure_is_better() -> None:
    random = np.random.default_rng(10)
    truth = Image.noiseless(truth_of(random))
    estimate = Image.noiseless(truth.value * random.uniform(0.2, 0.8, SHAPE))
    best = best_exposure(estimate, truth, EVERYWHERE).factor
    least = figure(estimate.scaled(best), truth, EVERYWHERE).relative_rmse
    for factor in (best * 0.99, best * 1.01):
        assert figure(estimate.scaled(factor), truth, EVERYWHERE).relative_rmse > least


def test_sampled_figures_cover_the_population() -> None:
    # A population of voxels with known values; 2000 draws, judged by a noisy evaluator.
    random = np.random.default_rng(11)
    truth = random.gamma(2.0, 0.5, (50_000, 1)) * np.array([1.0, 0.9, 0.8])
    baked = truth * 1.03 + random.normal(0, 0.05, truth.shape)
    true_rmse = math.sqrt(np.sum((baked - truth) ** 2) / np.sum(truth**2))
    true_bias = np.sum(baked - truth) / truth.sum()
    scores, bias_scores = [], []
    for _ in range(300):
        draws = random.integers(0, len(truth), 2000)
        deviation = 0.05
        replicates = truth[draws] + random.normal(0, deviation, (8, 2000, 1))
        judged = Image(replicates.mean(axis=0), replicates.var(axis=0, ddof=1) / 8, 7)
        result = sampled_figure(Image.noiseless(baked[draws]), judged)
        scores.append((result.relative_rmse - true_rmse) / result.noise)
        bias_scores.append((result.bias - true_bias) / result.bias_noise)
    for score in (scores, bias_scores):
        assert abs(np.mean(score)) < 4 / math.sqrt(300)
        assert 0.85 < np.std(score) < 1.15


def test_points_that_count_often_bring_their_noise_once() -> None:
    # Candidates are drawn evenly, and counted in proportion to their weight, up to 30 times each.
    random = np.random.default_rng(14)
    truth = random.gamma(2.0, 0.5, (50_000, 1)) * np.array([1.0, 0.9, 0.8]) - 0.5
    weight = random.gamma(0.5, 1.0, (len(truth), 1))
    baked = truth + 0.03 + random.normal(0, 0.05, truth.shape)
    true_rmse = math.sqrt(np.sum(weight * (baked - truth) ** 2) / np.sum(weight * truth**2))
    scores = []
    for _ in range(300):
        candidates = random.integers(0, len(truth), 800)
        share = weight[candidates, 0] / weight[candidates].sum()
        draws, counts = np.unique(random.choice(candidates, 4000, p=share), return_counts=True)
        assert (counts**2).sum() > 3 * counts.sum()
        replicates = truth[draws] + random.normal(0, 0.1, (8, len(draws), 1))
        judged = Image(replicates.mean(axis=0), replicates.var(axis=0, ddof=1) / 8, 7)
        result = sampled_figure(Image.noiseless(baked[draws]), judged, counts)
        scores.append((result.relative_rmse - true_rmse) / result.noise)
    assert abs(np.mean(scores)) < 4 / math.sqrt(300)
    assert 0.85 < np.std(scores) < 1.15


def test_relative_noise_is_the_planted_level() -> None:
    random = np.random.default_rng(12)
    truth = np.ones(SHAPE)
    noisy = seeds_image(random, truth, 0.1, 25)
    # 768 pixels with 24 degrees of freedom each: the level itself is known to 0.5 %.
    assert relative_noise(noisy, EVERYWHERE) == pytest.approx(0.02, rel=0.03)


def test_agreement_of_equal_images_and_of_ones_that_differ_by_half_a_percent() -> None:
    random = np.random.default_rng(13)
    truth = truth_of(random)
    biases, squares = [], []
    for _ in range(200):
        result = agreement(
            seeds_image(random, truth, 0.1, 8), seeds_image(random, truth, 0.1, 4), EVERYWHERE, 8
        )
        biases.append(result.bias_z)
        squares.append((result.mean_z_squared - 1) / result.spread)
    assert np.std(biases) == pytest.approx(1, abs=0.2)
    assert abs(np.mean(squares)) < 0.4  # 4 standard errors, and 1 % of heavier tails
    many = agreement(
        seeds_image(random, truth, 0.1, 64),
        seeds_image(random, truth * 1.005, 0.1, 64),
        EVERYWHERE,
        8,
    )
    # 0.5 % of the mean 1 against 0.1 * sqrt(2 / 64 / 768) = 0.06 %: eight standard errors.
    assert not many.agrees
    assert many.bias_z < -3


def test_agreement_sees_a_pattern_without_bias() -> None:
    random = np.random.default_rng(14)
    truth = truth_of(random)
    tilted = truth + np.linspace(-0.05, 0.05, SHAPE[1])[None, :, None]
    result = agreement(
        seeds_image(random, truth, 0.1, 16), seeds_image(random, tilted, 0.1, 16), EVERYWHERE, 8
    )
    assert not result.agrees


def test_a_rim_that_no_sample_hit_does_not_spoil_the_agreement() -> None:
    random = np.random.default_rng(15)
    truth = truth_of(random)
    truth[:, 24:] *= 1e-3
    # The second image never hit the rim: there it is 0 with a variance of 0.
    fine = seeds_image(random, truth, 0.0, 4)
    fine = Image(fine.value, (1e-5 * truth) ** 2, 7)
    rough = seeds_image(random, truth, 0.1, 64)
    value, variance = rough.value.copy(), rough.variance.copy()
    value[:, 24:] = variance[:, 24:] = 0
    result = agreement(fine, Image(value, variance, rough.degrees), EVERYWHERE, 8)
    assert result.blocks == 9  # of 12
    assert result.agrees


def test_silhouette_is_where_light_is_lost() -> None:
    transmittance = np.ones((4, 5, 1))
    transmittance[1, 2] = 0.5
    transmittance[0, 0] = 0.9995
    assert np.argwhere(silhouette(transmittance)).tolist() == [[1, 2]]
    with pytest.raises(InputError, match="silhouette is empty"):
        silhouette(np.ones((4, 5, 3)))


def test_black_truths_are_refused() -> None:
    black = Image.noiseless(np.zeros(SHAPE))
    with pytest.raises(InputError, match="expected some light"):
        figure(black, black, EVERYWHERE)
    with pytest.raises(InputError, match="expected some light"):
        best_exposure(black, black, EVERYWHERE)


def test_images_must_be_finite() -> None:
    with pytest.raises(InputError, match="not finite"):
        Image.noiseless(np.full(SHAPE, np.nan))
