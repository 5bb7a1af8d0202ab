"""Direction rules: normalisation, moments, pairs, and cones about varying axes."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from scipy.special import expn

from volillum_addon.core import directions


@pytest.mark.parametrize("theta", [1e-3, 0.3, 1.0, math.pi / 2])
@pytest.mark.parametrize("count", [4, 16, 64])
def test_cone_rule_integrates_its_first_moments(theta: float, count: int) -> None:
    vectors, weights = directions.cone_rule(theta, count)
    assert np.allclose(np.linalg.norm(vectors, axis=1), 1, atol=1e-14)
    assert math.isclose(weights.sum(), 1, rel_tol=1e-13)
    # Mean direction of a uniform cone: (1 + cos theta) / 2 along its axis.
    assert np.allclose(weights @ vectors, (0, 0, (1 + math.cos(theta)) / 2), atol=1e-13)
    assert vectors[:, 2].min() >= math.cos(theta) - 1e-14


@pytest.mark.parametrize("theta", [math.radians(15), math.radians(60), math.radians(90)])
@pytest.mark.parametrize("depth", [0.5, 2.0])
def test_cone_rule_meets_the_half_space(theta: float, depth: float) -> None:
    """Case C1: (E2(t) - c E2(t / c)) / (1 - c)."""
    vectors, weights = directions.cone_rule(theta, 1024)
    cosine = math.cos(theta)
    grazing = cosine * expn(2, depth / cosine) if cosine > 1e-12 else 0.0
    exact = (expn(2, depth) - grazing) / (1 - cosine)
    estimate = weights @ np.exp(-depth / np.maximum(vectors[:, 2], 1e-300))
    # 16 Gauss rings; exp(-t / mu) is smooth but for mu near 0 (theta = 90 degrees).
    assert estimate == pytest.approx(exact, rel=1e-9 if theta < 1.5 else 2e-3)


@pytest.mark.parametrize("count", [8, 66, 128, 512])
def test_sphere_rule_comes_in_opposite_pairs_and_has_no_mean(count: int) -> None:
    vectors, weights = directions.sphere_rule(count)
    assert abs(len(vectors) - count) <= 0.25 * count
    assert math.isclose(weights.sum(), 1, rel_tol=1e-13)
    assert np.allclose(weights @ vectors, 0, atol=1e-14)
    distance = np.linalg.norm(vectors[:, None] + vectors[None], axis=-1)
    assert distance.min(axis=1).max() < 1e-13


def test_frame_is_right_handed() -> None:
    for axis in np.random.default_rng(4).normal(size=(20, 3)):
        rows = directions.frame(axis / np.linalg.norm(axis))
        assert np.allclose(rows @ rows.T, np.eye(3), atol=1e-14)
        assert math.isclose(np.linalg.det(rows), 1, rel_tol=1e-12)


@pytest.mark.parametrize("count", [4, 16, 30, 64])
def test_a_rule_about_a_turning_axis_never_jumps(count: int) -> None:
    """Across axes, diagonals and the planes between, where a nearest axis changes; each direction
    keeps its place but for quarter turns. Frames turn up to 15 times as fast there as the axis."""
    vectors, weights = directions.cone_rule(0.5, count)
    turn = 1e-6
    ties = list(itertools.product((-1.0, 0.0, 1.0, 2.0), repeat=3))
    for axis in np.array([each for each in ties if any(each)]):
        aside = np.cross(axis, (0.36, 0.48, -0.8))
        aside *= np.linalg.norm(axis) / np.linalg.norm(aside)
        one, two = (
            directions.about(vectors, each / np.linalg.norm(each))
            for each in (axis + turn * aside, axis - turn * aside)
        )
        distances = np.linalg.norm(one[:, None] - two, axis=-1)
        assert distances.min(axis=1).max() < 32 * turn
        assert np.allclose(weights, weights[distances.argmin(axis=1)], rtol=1e-12)


@pytest.mark.parametrize("theta", [0.3, math.radians(30), 1.0, 1.5])
def test_angular_lattice_serves_cones_about_many_axes(theta: float) -> None:
    rng = np.random.default_rng(5)
    axes = np.array([3.0, 2.0, 1.0]) - rng.uniform(-1, 1, (200, 3))
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    lattice = directions.AngularLattice.covering(axes, theta, 64)
    weights = lattice.cone_weights(axes, theta)
    assert np.allclose(weights.sum(axis=0), 1, atol=2e-6)
    # Mean direction of each cone; cubic interpolation is third order in the lattice's spacing.
    mean = weights.T @ lattice.directions
    assert np.abs(mean - axes * (1 + math.cos(theta)) / 2).max() < 0.1 * lattice.spacing**3
    # Visibility in a tilted half space against a dense rule about each axis.
    normal = np.array([0.2, 0.3, 1.0]) / math.sqrt(1.13)
    dense, dense_weights = directions.cone_rule(theta, 40000)

    def visibility(vectors: np.ndarray) -> np.ndarray:
        cosine = vectors @ normal
        return np.where(cosine > 0, np.exp(-1 / np.maximum(cosine, 1e-9)), 0)

    truth = [dense_weights @ visibility(directions.about(dense, axis)) for axis in axes[:20]]
    error = weights.T[:20] @ visibility(lattice.directions) - truth
    assert np.abs(error).max() < 0.1 * lattice.spacing**3 + 2e-5


def test_angular_lattice_refuses_axes_all_around() -> None:
    axes = np.concatenate([np.eye(3), -np.eye(3)])
    with pytest.raises(ValueError, match="spread of axes"):
        directions.AngularLattice.covering(axes, 0.5, 64)
