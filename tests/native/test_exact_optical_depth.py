"""The judge's rays: optical depth through the trilinear medium, cell by cell."""

from __future__ import annotations

import threading
import time
from typing import Any

import numpy as np
import pytest
import trilinear
from numpy.typing import ArrayLike, NDArray
from trilinear import Array

import volillum_native as native

# Sums of at most a few hundred positive terms in double precision: 1e-16 each.
ROUNDING = 1e-12


def directions(count: int, seed: int) -> Array:
    vectors = np.random.default_rng(seed).normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def depth(
    sigma_t: NDArray[np.float32],
    affine: Array,
    origin: ArrayLike,
    direction: ArrayLike,
    radius: float = np.inf,
) -> float:
    """Of one ray, first channel."""
    ray = np.array([origin, direction], float)
    found = native.exact_optical_depth(sigma_t, affine, ray[:1], ray[1:], radius=radius)
    return float(found[0, 0])


def truth(
    sigma_t: NDArray[np.float32],
    affine: Array,
    origins: Array,
    vectors: Array,
    radius: float = np.inf,
) -> Array:
    return np.array(
        [
            [
                trilinear.Ray(plane.shape, affine, o, d, radius).optical_depth(plane)
                for plane in sigma_t
            ]
            for o, d in zip(origins, vectors, strict=True)
        ]
    )


def test_reference_against_dense_sampling() -> None:
    """A8: the piecewise quadrature is the integral of the interpolant (the truth of this file)."""
    rng = np.random.default_rng(1)
    values = rng.random((4, 5, 6), dtype=np.float32)
    ray = trilinear.Ray(
        values.shape, np.eye(4), np.array([-3.0, 1.2, 2.1]), directions(1, 3)[0] + [2, 0, 0]
    )
    t = (np.arange(400_000) + 0.5) / 400_000 * 4
    dense = trilinear.interpolate(values, ray.at(t)).mean() * 4
    # Midpoint rule with steps of 1e-5 and slopes of at most 4 a unit: kinks cost (1e-5)^2 each.
    assert ray.optical_depth(values) == pytest.approx(dense, abs=1e-8)


@pytest.mark.parametrize("shape", [(7, 9, 17), (1, 1, 1), (2, 3, 5), (1, 1, 64), (33, 2, 8)])
@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("radius", [np.inf, 1.7])
def test_random_rays(shape: tuple[int, int, int], mirrored: bool, radius: float) -> None:
    rng = np.random.default_rng(2)
    affine = trilinear.affine(7, mirrored)
    sigma_t = rng.random((3, *shape), dtype=np.float32)
    corners = np.array(shape) * rng.uniform(-0.4, 1.4, (60, 3))
    origins = corners @ affine[:3, :3].T + affine[:3, 3]
    targets = np.array(shape) * rng.uniform(-0.1, 1.1, (60, 3)) @ affine[:3, :3].T + affine[:3, 3]
    vectors = targets - origins
    vectors /= np.linalg.norm(vectors, axis=1, keepdims=True)
    expected = truth(sigma_t, affine, origins, vectors, radius)
    assert (expected > 0).mean() > 0.3
    found = native.exact_optical_depth(sigma_t, affine, origins, vectors, radius=radius)
    np.testing.assert_allclose(found, expected, rtol=ROUNDING, atol=ROUNDING)
    one = native.exact_optical_depth(sigma_t[1:2].copy(), affine, origins, vectors, radius=radius)
    np.testing.assert_allclose(one[:, 0], found[:, 1], rtol=ROUNDING, atol=ROUNDING)


def test_rays_leap_over_empty_space() -> None:
    """A few voxels in a wide grid: every block is met by some rays and none is lost."""
    rng = np.random.default_rng(3)
    sigma_t = np.zeros((1, 40, 37, 50), np.float32)
    for voxel in rng.integers(0, (40, 37, 50), (60, 3)):
        sigma_t[(0, *voxel)] = rng.uniform(1, 5)
    sigma_t[0, 7:9, 7:9, 7:9] = 1  # on the corner of eight blocks
    sigma_t[0, -1, -1, -1] = sigma_t[0, 0, 0, 0] = 2
    affine = trilinear.affine(5)
    voxels = np.argwhere(sigma_t[0]) @ affine[:3, :3].T + affine[:3, 3]
    vectors = directions(len(voxels), 4)
    origins = voxels - 30 * vectors
    expected = truth(sigma_t, affine, origins, vectors)
    found = native.exact_optical_depth(sigma_t, affine, origins, vectors)
    np.testing.assert_allclose(found, expected, rtol=ROUNDING, atol=ROUNDING)


def test_rays_along_faces_edges_and_diagonals() -> None:
    """Zero components (of both signs), ties of several planes at once, starts on planes."""
    rng = np.random.default_rng(5)
    sigma_t = rng.random((1, 9, 10, 11), dtype=np.float32)
    steps = np.array([s for s in np.ndindex(3, 3, 3) if s != (1, 1, 1)]) - 1.0
    steps[steps == 0] = np.where(np.arange((steps == 0).sum()) % 2, 0.0, -0.0)
    vectors = steps / np.linalg.norm(steps, axis=1, keepdims=True)
    for origin in [
        (4, 4, 4),
        (7, 7, 7),
        (4.5, 3, 7),
        (0, 0, 0),
        (-1, 5, 5),
        (8, 9, 10),
        (3, 9.5, 2),
    ]:
        origins = np.tile(np.array(origin, float), (len(vectors), 1))
        expected = truth(sigma_t, np.eye(4), origins, vectors)
        found = native.exact_optical_depth(sigma_t, np.eye(4), origins, vectors)
        # A diagonal's direction is rounded: 1e-16 off a face of the interpolant's kink.
        np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-12)


def test_a1_slab_and_its_border() -> None:
    """N voxels of size h: exactly kappa n h across (half a voxel of fall-off on either side)."""
    kappa, thickness, count = 1.7, 2.3, 23
    affine = np.diag([1e3, 1e3, thickness / count, 1])
    sigma_t = np.full((1, 3, 3, count), kappa, np.float32)
    found = depth(sigma_t, affine, (1e3, 1e3, -5), (0, 0, 1))
    # The voxel value is kappa rounded to float32: relative 6e-8 of a depth of 4.
    assert np.exp(-found) == pytest.approx(0.02004050106168402, rel=3e-7)
    centre = depth(sigma_t, affine, (1e3, 1e3, 0), (0, 0, -1))
    assert centre == pytest.approx(float(np.float32(kappa)) * thickness / count / 2, rel=1e-13)


@pytest.mark.parametrize(
    ("step", "start", "mean"),
    [
        ((1, 0, 0), (2, 2, 2), 1 / 2),  # linear between 1 and 0
        ((1, 1, 0), (2, 2, 2), 2 / 3),  # (1 - s)^2 + s^2
        ((1, 1, 0), (2, 3, 2), 1 / 3),  # 2 s (1 - s)
        ((1, 1, 1), (2, 2, 2), 1 / 2),  # (1 - s)^3 + 3 s^2 (1 - s)
        ((1, -1, 1), (2, 18, 2), 1 / 2),
    ],
)
def test_a7_checkerboard_of_voxels(
    step: tuple[int, ...], start: tuple[int, ...], mean: float
) -> None:
    """Trilinear between voxels of 1 and 0: closed forms along the axis and the diagonals."""
    kappa, cells = 4.0, 16
    parity = np.indices((21, 21, 21)).sum(axis=0) % 2 == 0
    sigma_t = (kappa * parity).astype(np.float32)[None]
    length = float(np.linalg.norm(step))
    found = depth(sigma_t, np.eye(4), start, np.array(step) / length, cells * length)
    assert found == pytest.approx(kappa * mean * cells * length, rel=ROUNDING)


def test_reciprocity_and_semigroup() -> None:
    rng = np.random.default_rng(6)
    sigma_t = rng.random((1, 12, 13, 14), dtype=np.float32)
    affine = trilinear.affine(11, mirrored=True)
    a, b = (rng.uniform(0, 12, (50, 3)) @ affine[:3, :3].T + affine[:3, 3] for _ in range(2))
    for start, end in zip(a, b, strict=True):
        length = np.linalg.norm(end - start)
        w = (end - start) / length
        whole = depth(sigma_t, affine, start, w, length)
        back = depth(sigma_t, affine, end, -w, length)
        first = depth(sigma_t, affine, start, w, 0.3 * length)
        rest = depth(sigma_t, affine, start + 0.3 * length * w, w, 0.7 * length)
        assert back == pytest.approx(whole, rel=1e-11)
        assert first + rest == pytest.approx(whole, rel=1e-11)


@pytest.mark.parametrize("scale", [1e-7, 1.0, 1e7])
def test_unit_change(scale: float) -> None:
    """V(kappa, h) = V(kappa / s, s h), also for rays that start a thousand grids away."""
    rng = np.random.default_rng(7)
    sigma_t = rng.random((1, 5, 6, 7), dtype=np.float32)
    affine = trilinear.affine(3)
    scaled = np.diag([scale, scale, scale, 1]) @ affine
    targets = rng.uniform(0, 5, (20, 3)) @ affine[:3, :3].T + affine[:3, 3]
    vectors = directions(20, 8)
    expected = truth(sigma_t, affine, targets - 5000 * vectors, vectors)
    found = native.exact_optical_depth(sigma_t, scaled, scale * (targets - 5000 * vectors), vectors)
    # Positions carry 1e-16 of 5,000 units, 1e-12 of a cell.
    np.testing.assert_allclose(found / scale, expected, rtol=1e-9, atol=1e-10)


def test_any_number_of_threads_gives_the_same() -> None:
    rng = np.random.default_rng(9)
    sigma_t = rng.random((1, 20, 20, 20), dtype=np.float32)
    origins, vectors = rng.uniform(-5, 25, (1000, 3)), directions(1000, 10)
    one, two, three = (
        native.exact_optical_depth(sigma_t, np.eye(4), origins, vectors, threads=n)
        for n in (1, 2, 3)
    )
    assert np.array_equal(one, two)
    assert np.array_equal(one, three)


def test_cancel_stops_it() -> None:
    control = native.Control()
    sigma_t = np.ones((1, 64, 64, 64), np.float32)
    origins, vectors = np.full((400_000, 3), 32.0), directions(400_000, 11)

    def cancel_once_under_way() -> None:
        while control.progress == 0:
            time.sleep(0.001)
        control.cancel()

    watcher = threading.Thread(target=cancel_once_under_way)
    watcher.start()
    with pytest.raises(native.Cancelled):
        native.exact_optical_depth(sigma_t, np.eye(4), origins, vectors, control=control)
    watcher.join()
    assert 0 < control.progress < 1
    control = native.Control()
    native.exact_optical_depth(sigma_t, np.eye(4), origins[:10], vectors[:10], control=control)
    assert control.progress == 1


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"sigma_t": np.ones((2, 3, 3, 3), np.float32)},
            r"sigma_t has shape \(2, 3, 3, 3\); .* c = 1 or 3",
        ),
        ({"sigma_t": np.ones((3, 3, 3), np.float32)}, r"sigma_t has shape \(3, 3, 3\)"),
        ({"index_to_world": np.diag([1, 1, 0, 1.0])}, "index_to_world is singular"),
        ({"index_to_world": np.ones((4, 4))}, "last row of index_to_world"),
        ({"index_to_world": np.diag([1, np.nan, 1, 1.0])}, r"not finite, at \(1, 1\)"),
        ({"index_to_world": np.eye(3)}, r"index_to_world has shape \(3, 3\)"),
        ({"origins": np.zeros((2, 3))}, "directions has 1 rows; expected one for each of the 2"),
        ({"origins": np.full((1, 3), np.inf)}, "origins holds a value that is not finite"),
        ({"directions": np.array([[0, 0, 1.1]])}, r"directions\[0\] has length 1.1"),
        ({"directions": np.zeros((1, 2))}, r"directions has shape \(1, 2\); expected \(n, 3\)"),
        ({"radius": 0.0}, "radius is 0.0"),
        ({"radius": np.nan}, "radius is nan"),
    ],
)
def test_bad_input_is_named(changes: dict[str, Any], message: str) -> None:
    arguments: dict[str, Any] = {
        "sigma_t": np.ones((1, 3, 3, 3), np.float32),
        "index_to_world": np.eye(4),
        "origins": np.zeros((1, 3)),
        "directions": np.array([[0, 0, 1.0]]),
    }
    with pytest.raises(ValueError, match=message):
        native.exact_optical_depth(**(arguments | changes))
