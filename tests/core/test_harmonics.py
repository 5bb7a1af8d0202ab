"""Spherical harmonics: orthonormality, windows, and the lights' coefficients."""

from __future__ import annotations

import math

import numpy as np
import pytest

from volillum_addon.core import harmonics
from volillum_addon.core.directions import about, cone_rule, sphere_rule
from volillum_addon.core.lights import DistantLight, EnvironmentLight, latitude_longitude


def test_basis_is_orthonormal() -> None:
    vectors, weights = sphere_rule(128)  # 8 Gauss rings: exact to degree 15, the products have 6
    basis = harmonics.evaluate(vectors)
    gram = 4 * math.pi * (basis * weights[:, None]).T @ basis
    assert np.allclose(gram, np.eye(16), atol=1e-13)


def test_bands_have_constant_energy() -> None:
    """Sum over m of Y_lm^2 is (2 l + 1) / 4 pi (MODELS: property 6)."""
    vectors, _ = sphere_rule(66)
    squares = harmonics.evaluate(vectors) ** 2
    for band in range(4):
        total = squares[:, band**2 : (band + 1) ** 2].sum(axis=1)
        assert np.allclose(total, (2 * band + 1) / (4 * math.pi), rtol=1e-12)


def test_coefficients_follow_the_documented_order() -> None:
    x, y, z = np.eye(3)
    at_axes = harmonics.evaluate(np.array([x, y, z]))[:, 1:4]
    assert np.allclose(at_axes / math.sqrt(3 / (4 * math.pi)), [[0, 0, 1], [1, 0, 0], [0, 1, 0]])


@pytest.mark.parametrize(
    ("name", "low", "high"), [("none", -0.1137, 1.1137), ("hanning", -0.042, 1.042),
                              ("lanczos", -0.047, 1.047)]
)  # fmt: skip
def test_windows_damp_the_ringing_of_a_half_space(name: str, low: float, high: float) -> None:
    """Cases F2 and F3: V_l0 of a half space, reconstructed to order 3."""
    zonal = [math.sqrt(math.pi), math.sqrt(3 * math.pi) / 2, 0.0, -0.5861840]
    coefficients = np.zeros(16)
    coefficients[[0, 2, 6, 12]] = zonal
    cosine = np.linspace(-1, 1, 4001)
    line = np.stack([np.sqrt(1 - cosine**2), 0 * cosine, cosine], axis=-1)
    shape = harmonics.evaluate(line) @ (coefficients * harmonics.window(name, 3))
    # The quoted extrema have 3 to 4 digits.
    assert shape.min() == pytest.approx(low, abs=1e-3)
    assert shape.max() == pytest.approx(high, abs=1e-3)


@pytest.mark.parametrize("angle", [0.0, 0.2, 1.0, math.pi])
def test_sun_disc_coefficients(angle: float) -> None:
    direction = np.array([0.6, 0.0, 0.8])
    sun = DistantLight(direction, (1.0, 2.0, 3.0), angle)
    vectors, weights = cone_rule(max(angle / 2, 1e-7), 4096)
    projected = weights @ harmonics.evaluate(about(vectors, direction))
    assert np.allclose(sun.harmonics(), np.outer(projected, sun.fluence(np.zeros(3))), atol=1e-6)


def test_environment_image_equals_its_own_function() -> None:
    vectors, solid_angles = latitude_longitude(128, 256)
    assert solid_angles.sum() == pytest.approx(4 * math.pi, rel=1e-12)
    wanted = np.zeros((16, 3))
    wanted[0] = 3.0
    wanted[3], wanted[7, 1] = 0.5, 0.4
    image = (harmonics.evaluate(vectors.reshape(-1, 3)) @ wanted).reshape(128, 256, 3)
    assert image.min() > 0
    # Midpoint rule on 128 x 256 pixels: second order, (pi / 128)^2 / 24 of the largest coefficient.
    assert np.allclose(EnvironmentLight(image).harmonics(), wanted, atol=3 * (math.pi / 128) ** 2)


def test_a_coarse_image_is_the_same_light_as_a_fine_one() -> None:
    """A pixel has one radiance: what is split into many is no other image."""
    coarse = np.random.default_rng(1).random((2, 3, 3))
    fine = EnvironmentLight(coarse.repeat(128, axis=0).repeat(128, axis=1)).harmonics()
    scale = np.abs(fine).max()
    assert np.allclose(EnvironmentLight(coarse).harmonics(), fine, atol=2e-3 * scale)
    even = EnvironmentLight(np.ones((1, 1, 3))).harmonics()
    assert even[0] == pytest.approx(math.sqrt(4 * math.pi))
    assert np.abs(even[1:]).max() < 2e-3


def test_environment_rotation_turns_the_light() -> None:
    vectors, _ = latitude_longitude(64, 128)
    image = np.repeat(np.maximum(vectors[..., :1], 0), 3, axis=-1)  # bright toward the image's +x
    quarter = np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]])  # world +y looks up the image's +x
    turned = EnvironmentLight(image, quarter).harmonics()[:, 0]
    assert turned[1] > 1  # Y_1,-1 is y
    assert abs(turned[3]) < 1e-12


def test_constant_environment_is_exact() -> None:
    coefficients = EnvironmentLight((1.0, 0.5, 0.25)).harmonics()
    assert np.allclose(coefficients[0], np.array([1, 0.5, 0.25]) * math.sqrt(4 * math.pi))
    assert not coefficients[1:].any()
    fluence = EnvironmentLight((1.0, 0.5, 0.25)).fluence(np.zeros(3))
    assert np.allclose(fluence, 4 * math.pi * np.array([1, 0.5, 0.25]))
