"""The judge's light that gathers colour on its way, and its split into luminance and hue."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from judging import SIGMAS, UP, check, cone, constant, half_space, in_scattered
from numpy.typing import ArrayLike
from scipy import integrate
from trilinear import Array, affine

import volillum_native as native

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


def coloured(
    medium: tuple[Any, ...],
    kappa: ArrayLike,
    albedo: ArrayLike,
    glow: ArrayLike,
    term: Any,
    beta: float = 0.0,
    split: bool = True,
    **more: Any,
) -> tuple[Array, Array]:
    """A medium of extinction kappa, single scattering albedo, and source function `glow` per
    extinction: emission = kappa glow."""
    density, where, points = medium

    def planes(rgb: ArrayLike) -> Any:
        values = np.unique(rgb) if np.ptp(rgb) == 0 else np.asarray(rgb)
        return (density * values.reshape(-1, 1, 1, 1)).astype(np.float32)

    kappa, albedo, glow = (np.broadcast_to(np.asarray(x, float), 3) for x in (kappa, albedo, glow))
    equation = {
        "kind": "coloured", "beta": beta, "colour": 1.0, "emission": 1.0, "split": float(split),
    }  # fmt: skip
    return in_scattered(
        planes(kappa), where, points, [term], sigma_s=planes(kappa * albedo),
        emission=planes(kappa * glow), equation=equation, **more,
    )  # fmt: skip


def closed_form(
    depth: float, kappa: ArrayLike, albedo: ArrayLike, glow: ArrayLike, light: ArrayLike,
    degrees: float, beta: float, split: bool = True,
) -> Array:  # fmt: skip
    """A half space: Q = B T + (albedo B + glow) (1 - T), T = exp(-kappa t / mu)."""
    kappa, albedo, glow, light = (
        np.broadcast_to(np.asarray(x, float), 3) for x in (kappa, albedo, glow, light)
    )
    cosine = math.cos(math.radians(degrees))

    def of(mu: float) -> Array:
        through = np.exp(-kappa * depth / mu)
        q = light * through + (albedo * light + glow) * (1 - through)
        if split:
            dark = LUMINANCE @ q < 1e-6 * (LUMINANCE @ light)
            q = light / (LUMINANCE @ light) if dark else q / (LUMINANCE @ q)
        return np.asarray(q * mu**beta)

    mean = integrate.quad_vec(of, cosine, 1, epsabs=1e-12)[0]
    mean *= (beta + 1) / (1 - cosine ** (beta + 1))
    return mean * (LUMINANCE @ (light * np.exp(-kappa * depth)) if split else 1)


def test_e3_coloured_half_space() -> None:
    term = cone(UP, 30)
    value, error = coloured(half_space(0.7), (1, 2, 4), 0, 0, term, 10.0, directions=8192)
    truth = np.array([[0.5095360137036891, 0.24327374014976122, 0.05559467105426503]])
    np.testing.assert_allclose(closed_form(0.7, (1, 2, 4), 0, 0, 1, 30, 10), truth[0], rtol=1e-9)
    check(value, error, truth)
    assert np.all(error < 1e-3 * truth)
    np.testing.assert_allclose(value @ LUMINANCE, 0.28633067071863133, rtol=1e-6)


@pytest.mark.parametrize("split", [True, False])
@pytest.mark.parametrize(
    "row",
    [
        (1, (0.9, 0.5, 0.2), 0, 1, 30, 10),
        (1, (0.9, 0.5, 0.2), (0, 0.1, 0.4), (1, 0.5, 0.2), 60, 2.5),
        (1, 0.3, (0.5, 0, 0), (0, 0, 2), 90, 1),
        ((0.01, 1, 1e6), (0.9, 0.5, 0.7), (0.1, 0.2, 0.3), (1, 2, 3), 40, 50),
        (30, (0.9, 0.5, 0.2), 0, 1, 30, 0),
    ],
)
def test_half_space_with_colour(split: bool, row: tuple[Any, ...]) -> None:
    depth, (kappa, albedo, glow, light, degrees, beta) = 0.8, row
    value, error = coloured(
        half_space(depth), kappa, albedo, glow, cone(UP, degrees, light), beta, split,
        directions=16384,
    )  # fmt: skip
    truth = closed_form(depth, kappa, albedo, glow, light, degrees, beta, split)
    assert np.all(error[0] < 5e-3 * truth.max())
    # A depth x in float32 is wrong by 6e-8 x, and so is what passes, relatively.
    rounding = 6e-8 * depth * min(float(np.max(kappa)), 100)
    assert np.all(np.abs(value[0] - truth) < SIGMAS * error[0] + (1e-6 + rounding) * truth.max())


def test_split_keeps_the_hard_shadow() -> None:
    """The luminance is that of the light on the axis, exactly, in any medium."""
    rng = np.random.default_rng(1)
    where = affine(3)
    sigma_t = (3 * rng.random((3, 7, 8, 6)) ** 3).astype(np.float32)
    sigma_s = sigma_t * rng.random((3, 7, 8, 6), dtype=np.float32)
    emission = rng.random((3, 7, 8, 6), dtype=np.float32)
    points = rng.uniform(0, 6, (12, 3)) @ where[:3, :3].T + where[:3, 3]
    axis, light = np.array([0.48, 0.6, -0.64]), np.array([1.0, 0.2, 0.5])
    value, error = in_scattered(
        sigma_t, where, points, [cone(axis, 40, light)], sigma_s=sigma_s, emission=emission,
        equation={"kind": "coloured", "beta": 5, "colour": 1, "emission": 1, "split": 1},
    )  # fmt: skip
    depth = native.exact_optical_depth(sigma_t, where, points, np.tile(axis, (12, 1)))
    np.testing.assert_allclose(value @ LUMINANCE, (light * np.exp(-depth)) @ LUMINANCE, rtol=1e-12)
    assert error.max() > 0


def test_black_matter_leaves_the_hue_of_the_light() -> None:
    """Deep and black: what is left of the lobe is below 1e-6 of the light."""
    light = np.array([0.1, 0.5, 2.0])
    value, _ = coloured(half_space(40.0), (1, 1.5, 2), 0, 0, cone(UP, 20, light))
    direct = LUMINANCE @ (light * np.exp(-40 * np.array([1, 1.5, 2])))
    np.testing.assert_allclose(value[0], light / (LUMINANCE @ light) * direct, rtol=1e-5)
    value, error = coloured(half_space(1.0), 1, 0.5, 0, cone(UP, 20, 0.0))
    assert np.all(value == 0)
    assert np.all(error == 0)


def test_without_colour_and_split_it_is_the_visibility_of_the_lobe() -> None:
    rng = np.random.default_rng(2)
    sigma_t, points = rng.random((3, 9, 9, 9), dtype=np.float32), rng.uniform(1, 7, (5, 3))
    lamp = (np.array([4.0, 3.0, 12.0]), "lamp", 0.7, constant([1.0, 2, 3]))
    for term in (cone([1, 2, 3], 35, [1, 2, 3]), lamp):
        plain, plain_error = in_scattered(sigma_t, np.eye(4), points, [term])
        found, found_error = in_scattered(
            sigma_t, np.eye(4), points, [term],
            equation={"kind": "coloured", "beta": 0, "colour": 0, "emission": 0, "split": 0},
        )  # fmt: skip
        np.testing.assert_allclose(found, plain, rtol=1e-12)
        np.testing.assert_allclose(found_error, plain_error, rtol=1e-6)


def test_any_number_of_threads_gives_the_same() -> None:
    rng = np.random.default_rng(5)
    density = rng.random((1, 9, 9, 9), dtype=np.float32)
    medium, term = (density, np.eye(4), rng.uniform(0, 8, (40, 3))), cone([1, 1, 0], 50)
    arguments = (medium, (1, 2, 3), (0.2, 0.5, 0.9), 0.1, term, 3.0)
    one = coloured(*arguments, threads=1)
    for threads in (2, 3):
        again = coloured(*arguments, threads=threads)
        assert all(np.array_equal(a, b) for a, b in zip(one, again, strict=True))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"beta": -1}, "equation's beta is not a number from 0"),
        ({"colour": "much"}, "equation's colour is not a number from 0"),
        ({"beta": 2}, "weight cos\\^beta is wider than a half space"),
        ({}, "sigma_s is None; an equation of this kind needs it"),
    ],
)
def test_bad_input_is_named(changes: dict[str, Any], message: str) -> None:
    fields = {"kind": "coloured", "beta": 0, "colour": 0 if changes else 1, "emission": 0}
    ones = np.ones((1, 3, 3, 3), np.float32)
    with pytest.raises(ValueError, match=message):
        in_scattered(
            ones, np.eye(4), np.ones((1, 3)), [cone(UP, 120)],
            equation=fields | {"split": 1} | changes,
        )  # fmt: skip
