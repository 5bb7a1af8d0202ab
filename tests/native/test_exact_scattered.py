"""The judge's random walks in a fixed lobe (half angle slicing) against closed forms."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from judging import SIGMAS, UP, check, check_statistics, cone, constant, half_space, in_scattered
from numpy.typing import ArrayLike
from scipy import integrate, interpolate
from trilinear import Array, affine

import volillum_native as native

SCATTERED = {"kind": "scattered"}
# float32 rounding of sigma_s / sigma_t = 0.9 or 0.99 over the collisions of a path (at most 20).
ALBEDO_ROUNDING = 20 * 6e-8


def scattered(medium: tuple[Any, ...], albedo: ArrayLike, *terms: Any, **more: Any) -> Any:
    sigma_t, *where = medium
    rgb = np.asarray(albedo, np.float32).reshape(-1, 1, 1, 1)
    return in_scattered(
        sigma_t, *where, list(terms), sigma_s=sigma_t * rgb, equation=SCATTERED, **more
    )


@pytest.mark.parametrize(
    ("albedo", "degrees", "values"),
    [
        (0.9, 30, (0.9477534142, 0.898264571, 0.8069449955, 0.6512612281)),
        (0.9, 60, (0.9337674356, 0.8728157913, 0.7635947852, 0.5852932619)),
        (0.99, 30, (0.9946482485, 0.9893280927, 0.9787774348, 0.9580182931)),
    ],
)
def test_d1_half_space(albedo: float, degrees: float, values: tuple[float, ...]) -> None:
    for depth, truth in zip((0.5, 1.0, 2.0, 4.0), values, strict=True):
        value, error = scattered(half_space(depth), albedo, cone(UP, degrees), directions=16384)
        assert np.all(error < 2e-3)
        check(value, error, truth, 1e-6 + ALBEDO_ROUNDING)


def test_white_media_are_as_bright_as_no_medium() -> None:
    """Albedo 1: every walk ends at the light with its weight untouched, whatever the medium."""
    rng = np.random.default_rng(1)
    sigma_t = (20 * rng.random((1, 9, 8, 7)) ** 3).astype(np.float32)
    points = affine(1)[:3, 3] + rng.uniform(0, 7, (20, 3)) @ affine(1)[:3, :3].T
    lamp = (np.array([1.0, 2.0, 3.0]), "lamp", math.cos(0.5), constant(1.0))
    terms = [cone([1, 2, 3], 50, [1, 2, 3])]
    value, error = scattered((sigma_t, affine(1), points), 1, *terms, directions=64)
    np.testing.assert_allclose(value, np.broadcast_to([1.0, 2, 3], value.shape), rtol=1e-12)
    assert np.all(error < 1e-12)
    value, _ = scattered((sigma_t, affine(1), points), 1, lamp, directions=64)
    squared = ((points - lamp[0]) ** 2).sum(axis=-1)
    np.testing.assert_allclose(value, np.outer(1 / squared, np.ones(3)), rtol=1e-12)


@pytest.mark.parametrize("axis", [UP, np.array([0.3, -0.5, 0.8])])
def test_a_narrow_cone_loses_what_is_absorbed(axis: Array) -> None:
    """Zero theta: exp(-integral of sigma_a), whatever the scattering."""
    rng = np.random.default_rng(2)
    sigma_t = rng.random((1, 9, 9, 9), dtype=np.float32)
    point, albedo = np.array([[4.2, 3.9, 1.7]]), np.float32(0.75)
    depth = native.exact_optical_depth(sigma_t, np.eye(4), point, axis[None] / np.linalg.norm(axis))
    truth = math.exp(-depth[0, 0] * (1 - float(albedo)))
    medium = (sigma_t, np.eye(4), point)
    check(*scattered(medium, albedo, cone(axis, 0), directions=65536), truth)
    far = (point[0] + 4 * axis, "lamp", 1.0, constant(16 * axis @ axis))
    near = native.exact_optical_depth(
        sigma_t, np.eye(4), point, axis[None] / np.linalg.norm(axis),
        radius=4 * float(np.linalg.norm(axis)),
    )  # fmt: skip
    truth = math.exp(-near[0, 0] * (1 - float(albedo)))
    check(*scattered(medium, albedo, far, directions=65536), truth)


def test_without_scattering_it_is_the_cone_of_light() -> None:
    rng = np.random.default_rng(3)
    sigma_t = rng.random((1, 9, 9, 9), dtype=np.float32)
    points = rng.uniform(2, 6, (6, 3))
    for term in (cone([1, 1, 3], 40), ([4.0, 5.0, 30.0], "lamp", 0.8, constant(500.0))):
        plain, plain_error = in_scattered(sigma_t, np.eye(4), points, [term], directions=4096)
        value, error = scattered((sigma_t, np.eye(4), points), 0, term, directions=16384)
        combined = np.hypot(error, plain_error)
        assert np.all(np.abs(value - plain) < SIGMAS * combined)
        assert np.all(error < 0.03 * value)


def test_a_lamp_in_a_homogeneous_medium() -> None:
    """V depends on the distance r to the lamp alone: a Volterra equation, solved by quadrature.

    V(r) = mean over the cone of exp(-l) + albedo int_0^l exp(-s) V(|r - s w|) ds, l = r cos(angle),
    per unit of optical depth.
    """
    albedo, cosine = 0.9, math.cos(math.radians(50))
    radii = np.linspace(0, 3, 121)
    mu_nodes, mu_weights = np.polynomial.legendre.leggauss(16)
    s_nodes, s_weights = np.polynomial.legendre.leggauss(24)
    mu = (1 + cosine) / 2 + mu_nodes * (1 - cosine) / 2
    length = radii[:, None, None] * mu[None, :, None]
    s = length * (s_nodes + 1) / 2
    distance = np.sqrt(np.maximum(radii[:, None, None] ** 2 + s**2 - 2 * s * length, 0))
    solution = np.ones_like(radii)
    for _ in range(60):  # the n-th scattering contributes less than (0.9 * 0.95)^n
        spline = interpolate.CubicSpline(radii, solution)
        inner = (length / 2 * s_weights * np.exp(-s) * spline(distance)).sum(axis=-1)
        rays = np.exp(-length[..., 0]) + albedo * inner
        solution = rays @ mu_weights / 2
    truth = float(interpolate.CubicSpline(radii, solution)(2.2))

    size, spacing = 24, 0.25
    block = np.ones((1, size, size, size), np.float32)
    lamp = np.array([2.9, 2.8, 2.95])
    direction = np.array([0.36, -0.48, 0.8])
    point = (lamp - 2.2 * direction)[None]  # rays stay within 2.2 of the lamp, inside the block
    term = (lamp, "lamp", cosine, constant(2.2**2))
    medium = (block, np.diag([spacing, spacing, spacing, 1.0]), point)
    value, error = scattered(medium, albedo, term, directions=65536)
    assert np.all(error < 1e-3)
    check(value, error, truth, systematic=1e-5)  # quadrature and spline: halving moves 1e-6


def test_colours_scatter_by_themselves() -> None:
    """Chromatic extinction: each colour is a grey medium of its own, with its own albedo."""
    rng = np.random.default_rng(4)
    sigma_t = (2 * rng.random((3, 7, 7, 7))).astype(np.float32)
    points, term = rng.uniform(1, 5, (4, 3)), cone([1, 0, 2], 45)
    albedo = np.array([0.5, 0.9, 0.99])
    value, error = scattered((sigma_t, np.eye(4), points), albedo, term, directions=16384)
    for c in range(3):
        grey, grey_error = scattered(
            (sigma_t[c : c + 1].copy(), np.eye(4), points), albedo[c], term, directions=16384
        )
        combined = np.hypot(error[:, c], grey_error[:, c])
        assert np.all(np.abs(value[:, c] - grey[:, c]) < SIGMAS * combined)
        assert np.all(error[:, c] < 0.01)


def test_colours_of_the_albedo_share_their_walks() -> None:
    medium, albedo = half_space(1.0), np.array([0.3, 0.9, 0.99], np.float32)
    value, error = scattered(medium, albedo, cone(UP, 30), directions=65536)
    for c, truth in ((1, 0.898264571), (2, 0.9893280927)):
        check(value[:, c], error[:, c], truth, 1e-6 + ALBEDO_ROUNDING)
    assert value[0, 0] < value[0, 1] < value[0, 2]


def test_unbiased_with_errors_that_cover() -> None:
    """2,000 independent points of case D1, albedo 0.9, theta 30 degrees, t = 2."""
    sigma_t, where, point = half_space(2.0)
    points = np.repeat(point, 2000, axis=0)
    value, error = scattered((sigma_t, where, points), 0.9, cone(UP, 30), directions=256)
    check_statistics(value[:, 0], error[:, 0], 0.8069449955)


def test_white_and_very_deep_is_given_up_and_told() -> None:
    """1e6 collisions a walk: the work is bounded, the share says that nothing arrived."""
    deep = np.full((1, 3, 3, 3), 1e6, np.float32)
    arguments = (deep, np.eye(4), np.ones((1, 3)), [cone(UP, 30)])
    value, _, neglected = native.exact_in_scattered(
        *arguments, sigma_s=deep, equation=SCATTERED, directions=16
    )
    assert np.all(value == 0)
    np.testing.assert_allclose(neglected, 1, rtol=1e-9)
    _, _, neglected = native.exact_in_scattered(
        *arguments, sigma_s=deep * np.float32(0.9), equation=SCATTERED, directions=16
    )
    assert np.all(neglected == 0)


def test_any_number_of_threads_gives_the_same() -> None:
    rng = np.random.default_rng(5)
    sigma_t = rng.random((3, 9, 9, 9), dtype=np.float32)
    medium, term = (sigma_t, np.eye(4), rng.uniform(0, 8, (40, 3))), cone([1, 1, 0], 50)
    one = scattered(medium, 0.9, term, threads=1)
    for threads in (2, 3):
        again = scattered(medium, 0.9, term, threads=threads)
        assert all(np.array_equal(a, b) for a, b in zip(one, again, strict=True))
    assert not np.any(scattered(medium, 0.9, term, seed=1)[0] == one[0])


def test_image_of_a_half_space() -> None:
    """Seen from the light: integral of exp(-t) albedo V(t) dt, V by its own values."""
    wide, depth, count, albedo = 1e4, 2.0, 9, 0.9
    sigma_t = np.full((1, 3, 3, count), depth, np.float32)
    where = np.diag([wide, wide, 1 / count, 1.0])
    rays = np.array(
        [[wide, wide, 5], [10, 0, 0], [0, 10, 0], [0, 0, -1], [0, 0, 0], [0, 0, 0]], float
    )
    value, error, _ = native.exact_image(
        sigma_t, sigma_t * np.float32(albedo), None, where, [cone(UP, 30)], rays, 12, 12,
        equation=SCATTERED, directions=8,
    )  # fmt: skip
    # V at Gauss nodes of the slab by the points' evaluator, whose closed form is case D1.
    nodes, weights = np.polynomial.legendre.leggauss(8)
    t = depth * (nodes + 1) / 2
    # Depth t is below the border's half voxel where t > depth / count / 2: the fall-off only
    # stretches the coordinate, V depends on t alone.
    values = [scattered(half_space(float(x)), albedo, cone(UP, 30), directions=32768) for x in t]
    v = np.array([pair[0][0, 0] for pair in values])
    v_error = np.array([pair[1][0, 0] for pair in values])
    factor = depth / 2 * weights * albedo * np.exp(-t)
    truth, truth_error = float(factor @ v), float(np.sqrt((factor**2) @ v_error**2))
    assert truth == pytest.approx(integrate.quad(lambda x: albedo * math.exp(-x), 0, depth)[0], 0.2)
    mean_error = math.hypot(math.sqrt((error[..., 0] ** 2).sum()) / error[..., 0].size, truth_error)
    assert mean_error < 2e-3 * truth
    assert abs(value[..., 0].mean() - truth) < 4 * mean_error


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"sigma_s": None}, "sigma_s is None; an equation of this kind needs it"),
        ({"equation": {"kind": "other"}}, "equation's kind is 'other'; expected one of 'gather'"),
        ({"equation": {}}, "equation has no key 'kind'"),
        ({"equation": {"kind": "gather", "x": 1}}, "equation has the unknown key 'x'"),
        ({"terms": [(UP, "sun", 0.5, constant(1))]}, r"terms\[0\]'s toward is 'sun'; expected"),
        ({"terms": [(UP, 1, 0.5, constant(1))]}, r"terms\[0\]'s toward is not a string"),
    ],
)
def test_bad_input_is_named(changes: dict[str, Any], message: str) -> None:
    ones = np.ones((1, 3, 3, 3), np.float32)
    arguments: dict[str, Any] = {
        "sigma_t": ones,
        "index_to_world": np.eye(4),
        "points": np.zeros((1, 3)),
        "terms": [cone(UP, 30)],
        "sigma_s": ones,
        "equation": SCATTERED,
    }
    with pytest.raises(ValueError, match=message):
        native.exact_in_scattered(**(arguments | changes))
