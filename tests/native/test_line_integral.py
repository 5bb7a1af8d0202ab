"""The image of baked grids against brute force in numpy and against closed forms."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import trilinear
from numpy.typing import NDArray
from scipy.special import sph_harm_y
from trilinear import Array

import volillum_native as native

Planes = NDArray[np.float32]
WIDTH, HEIGHT, SUBPIXELS = 3, 2, 2


def march(
    rays: Array,
    affine: Array,
    sigma_t: Planes,
    sigma_s: Planes,
    emission: Planes | None,
    channels: Planes,
    terms: list[tuple[tuple[int, ...], Array]],
    clamp: bool,
    halvings: int,
    angular: Callable[[int, Array, Array], Array] | None = None,
) -> tuple[Array, Array]:
    """The definition, ray by ray: cells cut in 2^halvings parts of 4 nodes, depth to each exact.

    `angular(term, v, points)` is a term's factor at world points for the direction toward the eye.
    """
    radiance, through = np.zeros((HEIGHT, WIDTH, 3)), np.zeros((HEIGHT, WIDTH, 3))
    fields = [np.broadcast_to(sigma_t, (3, *sigma_t.shape[1:]))]
    fields.append(np.broadcast_to(sigma_s, fields[0].shape))
    fields.append(np.zeros_like(fields[0]) if emission is None else emission)
    stack = np.concatenate([*fields, channels])
    offsets = (np.arange(SUBPIXELS) + 0.5) / SUBPIXELS
    # From the start of a part to each node, two-point Gauss: exact for a cubic.
    inner = (1 + np.array([-1, 1]) / math.sqrt(3)) / 2
    for y, x, b, a in np.ndindex(HEIGHT, WIDTH, SUBPIXELS, SUBPIXELS):
        origin, direction = trilinear.camera_ray(rays, x + offsets[a], y + offsets[b])
        ray = trilinear.Ray(sigma_t.shape[1:], affine, origin, direction)
        starts, t, weight = ray.nodes(4, halvings)
        values = trilinear.interpolate(stack, ray.at(t))
        light = np.zeros((3, *t.shape))
        for number, (factors, rgb) in enumerate(terms):
            product = np.prod([values[9 + factor] for factor in factors], axis=0)
            if angular is not None:
                product = product * angular(number, -direction, origin + t[..., None] * direction)
            light += np.asarray(rgb)[:, None, None] * product
        if clamp:
            light = np.maximum(light, 0)
        reach = t - starts[:, None]
        on_the_way = ray.at(starts[:, None, None] + reach[..., None] * inner)
        partial = reach * trilinear.interpolate(stack[:3], on_the_way).mean(axis=-1)
        whole = (weight * values[:3]).sum(axis=2)
        before = np.concatenate([np.zeros((3, 1)), np.cumsum(whole, axis=1)], axis=1)
        tau = np.exp(-before[:, :-1, None] - partial)
        source = values[3:6] * light + values[6:9]
        radiance[y, x] += (weight * tau * source).sum(axis=(1, 2)) / SUBPIXELS**2
        through[y, x] += np.exp(-before[:, -1]) / SUBPIXELS**2
    return radiance, through


@pytest.mark.parametrize("perspective", [True, False])
@pytest.mark.parametrize(
    ("grey_t", "grey_s", "emits", "clamp", "thickness"),
    [
        (True, True, False, True, 1),
        (False, False, True, True, 1),
        (True, False, True, False, 1),
        (False, True, False, True, 30),
    ],
)
def test_against_brute_force(
    perspective: bool, grey_t: bool, grey_s: bool, emits: bool, clamp: bool, thickness: float
) -> None:
    rng = np.random.default_rng(1)
    shape = (5, 6, 4)
    affine = trilinear.affine(2, mirrored=perspective)
    sigma_t = thickness * rng.random((1 if grey_t else 3, *shape), dtype=np.float32)
    sigma_s = thickness * rng.random((1 if grey_s else 3, *shape), dtype=np.float32)
    emission = rng.random((3, *shape), dtype=np.float32) if emits else None
    channels = rng.uniform(-0.5, 1, (4, *shape)).astype(np.float32)
    terms = [
        ((0,), rng.normal(size=3)),
        ((1, 2), rng.normal(size=3)),
        ((3,), rng.normal(size=3)),
        ((0, 0), rng.normal(size=3)),
    ]
    centre = affine[:3, :3] @ (np.array(shape) / 2) + affine[:3, 3]
    rays = trilinear.camera(centre, 4.0, 3, (WIDTH, HEIGHT), perspective)
    radiance, through = native.line_integral(
        sigma_t, sigma_s, emission, affine, channels, terms, rays, WIDTH, HEIGHT,
        subpixels=SUBPIXELS, clamp=clamp,
    )  # fmt: skip
    expected, expected_through = march(
        rays, affine, sigma_t, sigma_s, emission, channels, terms, clamp, 8 if clamp else 4
    )
    assert np.abs(expected).mean() > 0.05
    np.testing.assert_allclose(through, expected_through, rtol=1e-10)
    # The promise of 1e-5. Brute force at a kink: 2^-16 of a cell's square, times 1e-2 of a rule.
    np.testing.assert_allclose(radiance, expected, rtol=1e-5, atol=1e-5 * np.abs(expected).mean())


def harmonic(index: int, direction: Array) -> float:
    """A real harmonic from scipy's complex ones, without the Condon-Shortley sign."""
    degree = math.isqrt(index)
    order = index - degree * (degree + 1)
    polar, azimuth = math.acos(direction[2]), math.atan2(direction[1], direction[0])
    value = complex(sph_harm_y(degree, abs(order), polar, azimuth))
    if order == 0:
        return value.real
    return math.sqrt(2) * (-1) ** order * (value.real if order > 0 else value.imag)


@pytest.mark.parametrize("perspective", [True, False])
@pytest.mark.parametrize("clamp", [True, False])
def test_angular_terms_against_brute_force(perspective: bool, clamp: bool) -> None:
    """Distant and local lights (one of them inside the grid) and all moments, by a definition."""
    rng = np.random.default_rng(4)
    shape = (5, 6, 4)
    affine = trilinear.affine(5)
    sigma_t = rng.random((1, *shape), dtype=np.float32)
    channels = rng.uniform(-0.5, 1, (4, *shape)).astype(np.float32)
    centre = affine[:3, :3] @ (np.array(shape) / 2) + affine[:3, 3]
    toward = np.array([0.48, -0.6, 0.64])
    angular = [
        ("direction", 0.7, toward),
        ("position", -0.5, centre + np.array([3.0, -4.0, 5.0])),
        ("position", 0.9, centre + np.array([0.31, 0.17, -0.23])),
        *(("moment", index) for index in range(9)),
    ]

    def factor(number: int, v: Array, points: Array) -> Array:
        kind, *values = angular[number]
        if kind == "moment":
            return np.full(points.shape[:-1], harmonic(values[0], -v))
        g, source = values
        omega = source if kind == "direction" else source - points
        omega = omega / np.linalg.norm(omega, axis=-1, keepdims=True)
        cosine = -omega @ v
        return (1 - g * g) / (1 + g * g - 2 * g * cosine) ** 1.5

    terms = [((n % 4,) if n % 3 else (n % 4, 1), rng.normal(size=3)) for n in range(len(angular))]
    rays = trilinear.camera(centre, 4.0, 3, (WIDTH, HEIGHT), perspective)
    radiance, _ = native.line_integral(
        sigma_t, sigma_t, None, affine, channels, [(*term, n) for n, term in enumerate(terms)],
        rays, WIDTH, HEIGHT, angular=angular, subpixels=SUBPIXELS, clamp=clamp,
    )  # fmt: skip
    expected, _ = march(
        rays, affine, sigma_t, sigma_t, None, channels, terms, clamp, 8, angular=factor
    )
    assert np.abs(expected).mean() > 0.05
    # As above: the promise of 1e-5.
    np.testing.assert_allclose(radiance, expected, rtol=1e-5, atol=1e-5 * np.abs(expected).mean())


def test_a_ray_through_a_local_light_is_finite() -> None:
    """The cosine jumps from 1 to -1 at the light: the mean of both sides of a symmetric slab."""
    sigma_t, affine = slab(0.02, 1.0, 8)
    middle = affine @ [1, 1, 4.5, 1]
    ray = np.array([[*middle[:2], -5], [0, 0, 0], [0, 0, 0], [0, 0, 2], [0, 0, 0], [0, 0, 0]])
    g = 0.5
    radiance, _ = native.line_integral(
        sigma_t, sigma_t, None, affine, np.ones_like(sigma_t), [((0,), [1, 1, 1], 0)],
        ray, 1, 1, angular=[("position", g, middle[:3])],
    )  # fmt: skip
    front, back = (1 - g * g) / (1 - g) ** 3, (1 - g * g) / (1 + g) ** 3
    # Forward before the light, backward behind it, each half attenuated: to 2^-8 of a cell.
    expected = front * (1 - math.exp(-0.01)) + back * (math.exp(-0.01) - math.exp(-0.02))
    assert radiance == pytest.approx(np.full((1, 1, 3), expected), rel=1e-3)


def slab(values: float, depth: float, count: int) -> tuple[Planes, Array]:
    """Optical depth values * depth along k, wide as the sky; one voxel of padding around it."""
    sigma_t = np.zeros((1, 3, 3, count + 2), np.float32)
    sigma_t[..., 1:-1] = values
    return sigma_t, np.diag([1e3, 1e3, depth / count, 1.0])


DOWN_THE_AXIS = np.array([[1e3, 1e3, -5], [1, 0, 0], [0, 1, 0], [0, 0, 2], [0, 0, 0], [0, 0, 0]])


@pytest.mark.parametrize("depth", [1e-3, 1.0, 7.0, 1e3, 1e7])
def test_furnace(depth: float) -> None:
    """in_scattered = 1 and sigma_s = sigma_t: L = 1 - tau, however opaque a cell is."""
    sigma_t, affine = slab(depth, 1.0, 4)
    ones = np.ones_like(sigma_t)
    radiance, through = native.line_integral(
        sigma_t, sigma_t, None, affine, ones, [((0,), [1, 2, 3])], DOWN_THE_AXIS, 2, 2
    )
    # Four-point Gauss errs by 5.6e-10 times the 8th derivative of d/dt exp(-D t^2) on a border
    # voxel's ramp: D^(9/2) H_9 with D <= 1/2, and |H_9(x)| exp(-x^2) <= 6,528 on [0, 1].
    np.testing.assert_allclose(radiance / [1, 2, 3], 1 - through, rtol=1.7e-7)
    assert np.allclose(through, math.exp(-depth), rtol=1e-6 * depth, atol=1e-30)


def test_b1_emitting_slab() -> None:
    sigma_t, affine = slab(1.3, 0.9, 9)
    emission = np.repeat(2 * sigma_t, 3, axis=0)
    radiance, _ = native.line_integral(
        sigma_t, 0 * sigma_t, emission, affine, sigma_t, [], DOWN_THE_AXIS, 1, 1
    )
    # 1.3 in float32: 4e-8.
    assert radiance == pytest.approx(np.full((1, 1, 3), 1.37926611746909), rel=1e-7)


def test_clamped_kink() -> None:
    """A channel that goes linearly through zero inside a cell, against a fine trapezoid rule."""
    sigma_t = np.zeros((1, 3, 3, 4), np.float32)
    sigma_t[..., 1:3] = 1
    channel = np.broadcast_to(np.array([0, -0.7, 0.3, 0], np.float32), sigma_t.shape).copy()
    # Seen from inside: from k = 1 to the border, ramp included, in unclamped and clamped light.
    rays = DOWN_THE_AXIS.copy()
    rays[0, 2] = 1
    found, _ = native.line_integral(
        sigma_t, sigma_t, None, np.diag([1e3, 1e3, 1, 1]), channel, [((0,), [1, 1, 1])], rays, 1, 1
    )
    s = np.linspace(0, 1, 200_001)
    first = np.exp(-s) * np.maximum(0, s - 0.7)
    second = math.exp(-1) * np.exp(-s + s * s / 2) * (1 - s) * 0.3 * (1 - s)
    truth = np.trapezoid(first, s) + np.trapezoid(second, s)
    assert found == pytest.approx(np.full((1, 1, 3), truth), rel=1e-5)


def test_rays_that_miss_see_nothing() -> None:
    sigma_t = np.ones((1, 3, 3, 3), np.float32)
    rays = trilinear.camera(np.array([100.0, 0, 0]), 4.0, 5, (6, 6), True)
    radiance, through = native.line_integral(
        sigma_t, sigma_t, None, np.eye(4), sigma_t, [((0,), [1, 1, 1])], rays, 6, 6
    )
    assert np.all(radiance == 0)
    assert np.all(through == 1)


def test_any_number_of_threads_gives_the_same_and_cancel_stops_it() -> None:
    rng = np.random.default_rng(6)
    volume = rng.random((1, 12, 12, 12), dtype=np.float32)
    channels = rng.normal(size=(16, 12, 12, 12)).astype(np.float32)
    terms = [((c,), rng.normal(size=3)) for c in range(16)] + [((0, 1), rng.normal(size=3))]
    rays = trilinear.camera(np.full(3, 6.0), 15.0, 7, (12, 12), True)
    arguments = (volume, volume, None, np.eye(4), channels, terms, rays, 12, 12)
    one = native.line_integral(*arguments, threads=1)
    for threads in (2, 3):
        again = native.line_integral(*arguments, threads=threads)
        assert all(np.array_equal(a, b) for a, b in zip(one, again, strict=True))
    control = native.Control()

    def cancel_once_under_way() -> None:
        while control.progress == 0:
            time.sleep(0.001)
        control.cancel()

    watcher = threading.Thread(target=cancel_once_under_way)
    watcher.start()
    with pytest.raises(native.Cancelled):
        native.line_integral(*arguments, subpixels=16, control=control)
    watcher.join()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"sigma_s": np.ones((1, 3, 3, 4), np.float32)},
            r"sigma_s .*; expected the grid of sigma_t",
        ),
        ({"emission": np.ones((1, 3, 3, 3), np.float32)}, r"emission has shape .* c = 3"),
        ({"channels": np.ones((5, 3, 3, 2), np.float32)}, r"channels has shape \(5, 3, 3, 2\)"),
        ({"terms": [((1,), [1, 1, 1])]}, r"terms\[0\] names a channel .* from 0 to 1 - 1"),
        ({"terms": [((0, 0, 0), [1, 1, 1])]}, r"terms\[0\] is not a tuple \(channels, weight\)"),
        ({"terms": [((0,), [1, 1, 1], 0)]}, r"terms\[0\] names an angular .* an integer below 0"),
        ({"angular": [("moment", 9)]}, r"angular\[0\]'s index is not an integer from 0 to 8"),
        ({"angular": [("direction", 1, [1, 0, 0])]}, r"angular\[0\]'s g is not a number between"),
        ({"angular": [("direction", 0, [1, 1, 0])]}, r"direction has length 1.41.*; expected 1"),
        ({"angular": [("position", 0, [1, 0])]}, r"angular\[0\]'s position has shape \(2,\)"),
        ({"angular": [("moments", 1)]}, r"angular\[0\] is not \('direction', g, vector\)"),
        ({"terms": [((0,), [1, 1])]}, r"terms\[0\]'s weight has shape \(2,\)"),
        ({"rays": np.zeros((6, 3))}, "rays have no direction at image position"),
        ({"rays": np.zeros((5, 3))}, r"rays has shape \(5, 3\); expected \(6, 3\)"),
        ({"width": 0}, "image of 0 x 1 pixels"),
        ({"subpixels": 0}, "subpixels is 0"),
    ],
)
def test_bad_input_is_named(changes: dict[str, Any], message: str) -> None:
    ones = np.ones((1, 3, 3, 3), np.float32)
    arguments: dict[str, Any] = {
        "sigma_t": ones,
        "sigma_s": ones,
        "emission": None,
        "index_to_world": np.eye(4),
        "channels": ones,
        "terms": [((0,), [1, 1, 1])],
        "rays": DOWN_THE_AXIS,
        "width": 1,
        "height": 1,
    }
    with pytest.raises(ValueError, match=message):
        native.line_integral(**(arguments | changes))
