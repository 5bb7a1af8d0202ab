"""The judge's spherical harmonics of visibility: closed forms, scipy's harmonics, statistics."""

from __future__ import annotations

import math

import numpy as np
import pytest
from judging import SIGMAS, SYSTEMATIC, check_statistics, half_space
from scipy.special import expi, sph_harm_y
from trilinear import affine

from volillum_addon.core.directions import sphere_rule
from volillum_native import exact_optical_depth, exact_visibility_harmonics


def test_vacuum_has_the_first_one_alone() -> None:
    value, error = exact_visibility_harmonics(
        np.zeros((3, 2, 3, 4), np.float32), np.eye(4), np.ones((2, 3)), directions=65536
    )
    assert value.shape == error.shape == (2, 16, 3)
    assert value[:, 0] == pytest.approx(math.sqrt(4 * math.pi))
    assert np.all(np.abs(value[:, 1:]) < SIGMAS * error[:, 1:] + 1e-12)
    assert np.all(error[:, 1:] < 1e-3)


@pytest.mark.parametrize("depth", [0.3, 1.0])
def test_a_half_space(depth: float) -> None:
    """V_l0 = sqrt((2 l + 1) pi) integral of exp(-t / mu) P_l(mu) over [0, 1]; the rest is 0."""
    sigma_t, matrix, point = half_space(depth, floor=1e6)
    value, error = exact_visibility_harmonics(sigma_t, matrix, point, directions=1 << 17)
    t = depth
    moments = [math.exp(-t) + t * expi(-t)]  # E_2, then E_n+1 = (exp(-t) - t E_n) / n
    for n in range(2, 6):
        moments.append((math.exp(-t) - t * moments[-1]) / n)
    legendre = [[1], [0, 1], [-0.5, 0, 1.5], [0, -1.5, 0, 2.5]]
    for degree, powers in enumerate(legendre):
        mean = sum(c * moments[power] for power, c in enumerate(powers))
        truth = math.sqrt((2 * degree + 1) * math.pi) * mean
        for m in range(-degree, degree + 1):
            index = degree * (degree + 1) + m
            expected = truth if m == 0 else 0.0
            room = SIGMAS * error[0, index, 0] + 10 * SYSTEMATIC
            assert abs(value[0, index, 0] - expected) < room
            assert error[0, index, 0] < 3e-3


def test_a_random_medium_by_quadrature_with_other_harmonics() -> None:
    """Scipy's complex harmonics made real (its Condon-Shortley sign taken away), on a sheared
    lattice, cut at a radius, with three colours."""
    rng = np.random.default_rng(1)
    sigma_t = rng.random((3, 5, 4, 6)).astype(np.float32)
    matrix, radius = affine(2), 1.5
    point = (matrix @ np.array([2.2, 1.7, 2.9, 1]))[:3]
    directions, weights = sphere_rule(8192)
    depth = exact_optical_depth(
        sigma_t, matrix, np.tile(point, (len(directions), 1)), directions, radius=radius
    )
    polar, azimuth = np.arccos(directions[:, 2]), np.arctan2(directions[:, 1], directions[:, 0])
    value, error = exact_visibility_harmonics(
        sigma_t, matrix, point[None], radius=radius, directions=1 << 16
    )
    for degree in range(4):
        for m in range(-degree, degree + 1):
            complex_ = sph_harm_y(degree, abs(m), polar, azimuth) * (-1) ** m
            basis = complex_.real if m >= 0 else complex_.imag
            basis = basis * (1 if m == 0 else math.sqrt(2))
            truth = 4 * math.pi * (weights * basis) @ np.exp(-depth)
            index = degree * (degree + 1) + m
            # The rule over 8,192 directions meets kinks of the depth: second order, 1e-4.
            assert np.all(np.abs(value[0, index] - truth) < SIGMAS * error[0, index] + 1e-4)
            assert np.all(error[0, index] < 1e-3)


def test_it_is_unbiased_and_its_errors_cover() -> None:
    sigma_t, matrix, point = half_space(0.5, floor=1e6)
    points = np.tile(point, (2000, 1))
    value, error = exact_visibility_harmonics(sigma_t, matrix, points, order=1, directions=256)
    t = 0.5
    second = math.exp(-t) + t * expi(-t)
    third = (math.exp(-t) - t * second) / 2
    # Replicates of 32 directions are not normal where the lattice fits the integrand well.
    check_statistics(value[:, 0, 0], error[:, 0, 0], math.sqrt(math.pi) * second, skew=0.05)
    check_statistics(value[:, 2, 0], error[:, 2, 0], math.sqrt(3 * math.pi) * third, skew=0.05)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"order": 4}, "order is 4; expected 0, 1, 2 or 3"),
        ({"replicates": 1}, "replicates is 1"),
        ({"radius": 0.0}, "radius"),
        ({"points": np.zeros(3)}, "points has shape"),
    ],
)
def test_bad_input_is_named(change: dict[str, object], message: str) -> None:
    given: dict[str, object] = {
        "sigma_t": np.ones((1, 2, 2, 2), np.float32), "index_to_world": np.eye(4),
        "points": np.zeros((1, 3)),
    }  # fmt: skip
    with pytest.raises(ValueError, match=message):
        exact_visibility_harmonics(**(given | change))
