"""The line of the profile: through a planted shadow boundary, across it, from rim to rim."""

import numpy as np
import pytest
from comparisons import synthetic_comparison

from volillum_addon.compare.profile import eroded, line, profile, sample, smoothed
from volillum_addon.core.colour import LUMINANCE

HEIGHT, WIDTH = 60, 80
ROWS, COLUMNS = np.mgrid[0:HEIGHT, 0:WIDTH].astype(float)


@pytest.mark.parametrize("angle", [0.0, 0.6, 2.0])
def test_the_line_crosses_the_shadow_boundary_at_a_right_angle(angle: float) -> None:
    mask = np.hypot(COLUMNS - 40, ROWS - 30) < 26
    across = (COLUMNS - 44) * np.cos(angle) + (ROWS - 32) * np.sin(angle)
    # A soft edge of 1 against 0.2, and a rim that is steeper: the volume against nothing.
    luminance = mask * (0.6 + 0.4 * np.tanh(across / 3))
    noise = 0.01 * np.random.default_rng(1).standard_normal(mask.shape) * mask
    columns, rows = line(luminance + noise, mask)
    direction = np.array([columns[-1] - columns[0], rows[-1] - rows[0]])
    direction /= np.hypot(*direction)
    # The gradient of a smoothed edge of 80 pixels with 1 % noise: right to a few degrees.
    assert abs(direction @ [np.cos(angle), np.sin(angle)]) > np.cos(np.radians(10))
    distance = (columns - 44) * np.cos(angle) + (rows - 32) * np.sin(angle)
    assert distance.min() < -5
    assert distance.max() > 5
    inside = np.hypot(columns - 40, rows - 30)
    assert inside.max() < 27
    assert min(inside[0], inside[-1]) > 24
    np.testing.assert_allclose(np.hypot(np.diff(columns), np.diff(rows)), 0.5, rtol=1e-9)


def test_an_even_picture_and_a_single_pixel_have_a_line_too() -> None:
    mask = np.zeros((HEIGHT, WIDTH), bool)
    mask[20:40, 30:50] = True
    columns, rows = line(np.ones(mask.shape), mask)
    assert len(columns) == len(rows) > 20
    mask[:] = False
    mask[7, 9] = True
    columns, rows = line(np.ones(mask.shape), mask)
    assert np.all(np.abs(columns - 9) <= 0.5)


def test_sampling_is_bilinear_and_smoothing_keeps_the_mean() -> None:
    plane = 2 * COLUMNS - 3 * ROWS + 1
    columns, rows = np.array([3.25, 70.5, 79.0]), np.array([4.75, 10.0, 59.0])
    np.testing.assert_allclose(sample(plane, columns, rows), 2 * columns - 3 * rows + 1)
    assert sample(plane, np.array([-5.0]), np.array([-5.0])) == 1
    # Twice a mean over 3: the weights 1, 2, 3, 2, 1 of 9, along each axis.
    spike = np.zeros((9, 9))
    spike[4, 4] = 1
    weights = np.array([0, 0, 1, 2, 3, 2, 1, 0, 0]) / 9
    np.testing.assert_allclose(smoothed(spike, 1), np.outer(weights, weights), atol=1e-15)
    np.testing.assert_allclose(smoothed(np.full((5, 6), 3.0), 2), 3.0)


def test_a_margin_is_kept_from_the_rim_and_the_image_s_border() -> None:
    mask = np.ones((12, 14), bool)
    mask[6, 7] = False
    kept = eroded(mask, 2)
    assert not kept[:2].any()
    assert not kept[:, -2:].any()
    assert not kept[6, 5:10].any()
    assert kept[3, 3]
    np.testing.assert_array_equal(eroded(mask, 0), mask)


def test_the_profile_is_what_the_pictures_show() -> None:
    comparison = synthetic_comparison()
    found = profile(comparison)
    full = comparison.full.image.value @ LUMINANCE
    mean = full[comparison.mask].mean()
    middle = len(found.distance) // 2
    share = found.distance[middle] / found.distance[-1]
    x, y = (np.array([a + share * (b - a)]) for a, b in zip(found.begin, found.end, strict=True))
    assert found.truth[middle] == pytest.approx(sample(full, x, y)[0] / mean)
    assert len(found.models) == len(comparison.measured)
    displayed = comparison.measured[1][1].images.displayed.value @ LUMINANCE
    assert found.models[1][middle] == pytest.approx(sample(displayed, x, y)[0] / mean)
    assert np.all(found.noise > 0)
