"""The judge's occlusion of first order (Eq. 13) against closed forms and sums over volume."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
import pytest
from judging import SIGMAS, UP, WIDE, check_statistics, constant, in_scattered
from numpy.typing import NDArray
from scipy import integrate
from trilinear import Array, affine, interpolate

SPHERE = (UP, "direction", -1.0, constant(1.0))


def occlusion(
    occluder: NDArray[np.float32], where: Array, points: Array, radius: float, p: float, **more: Any
) -> tuple[Array, Array]:
    """T_p = (3 - p) R^(p - 2) mean_w int_0^R s^(2 - p) sigma ds, one channel, and its error."""
    equation = {
        "kind": "occluded", "occluder": occluder, "outward": more.pop("outward", None),
        "weight_p": p, "scale": (3 - p) * radius ** (p - 2),
    }  # fmt: skip
    value, error = in_scattered(
        occluder[:1], where, points, [SPHERE], equation=equation, radius=radius, **more
    )
    return 1 - value[:, 0], error[:, 0]


@pytest.mark.parametrize("p", [0.0, 0.5, 1.0, 2.0, 2.75])
def test_homogeneous_medium_is_its_optical_depth(p: float) -> None:
    """G1 at any p; every ray is the same, so there is no noise."""
    block = np.full((1, 40, 40, 40), 0.3, np.float32)
    value, error = occlusion(block, np.eye(4), np.array([[20, 19.3, 20.7]]), 7.5, p)
    # The rounding of differences near the origin, and the smooth pieces' 1e-8 where p is not whole.
    np.testing.assert_allclose(value, np.float64(np.float32(0.3)) * 7.5, rtol=1e-7)
    assert np.all(error < 1e-7)


@pytest.mark.parametrize("p", [1.0, 2.0])
@pytest.mark.parametrize("below", [0.3, 0.6])
def test_g2_below_a_plane_face(p: float, below: float) -> None:
    """The face falls off over one slice h: the mean of G2 over faces from d -/+ h / 2."""
    sigma, radius, slices = np.float32(0.7), 0.9, 8
    h = below / (slices + 0.5)
    block = np.full((1, 3, 3, 40), sigma, np.float32)
    point = np.array([[WIDE, WIDE, (39 - slices) * h]])
    assert (39 - slices) * h > radius

    def face(d: float) -> float:
        s = float(sigma)
        if p == 1:
            printed = 2 * math.pi * s * radius**2 - math.pi * s * (radius - d) ** 2
            return printed * 2 / (4 * math.pi * radius)
        return s * radius - s / 2 * (radius - d - d * math.log(radius / d))

    truth = integrate.quad(face, below - h / 2, below + h / 2)[0] / h
    affine_ = np.diag([WIDE, WIDE, h, 1.0])
    value, error = occlusion(block, affine_, point, radius, p, directions=65536)
    assert error[0] < 1e-4
    assert abs(value[0] - truth) < SIGMAS * error[0] + 1e-7


@pytest.mark.parametrize("p", [0.0, 0.7, 1.0, 1.5, 2.0, 2.5])
def test_layers(p: float) -> None:
    """Random layers: the mean over directions is one over cosines, integrated by other means."""
    rng = np.random.default_rng(1)
    layers, h, radius = rng.random(30).astype(np.float32), 0.1, 1.0
    block = np.broadcast_to(layers, (1, 3, 3, 30)).copy()
    height = 1.4321
    point = np.array([[WIDE, WIDE, height]])
    ends = np.concatenate([[-h], np.arange(30) * h, [30 * h]])
    values = np.concatenate([[0.0], layers, [0.0]])
    nodes, weights = np.polynomial.legendre.leggauss(20)
    # int s^(2 - p) m(z + s mu) ds dmu / 2 with u = s^(3 - p): (3 - p) int s^(2-p) ds = int du, and
    # for each s the mean over mu is that of m over z -/+ s: an antiderivative's difference.
    knots = np.sort(np.abs(np.concatenate([ends - height])))
    knots = np.unique(np.concatenate([[0.0], knots[knots < radius], [radius]]))
    steps = np.diff(values) / np.diff(ends)
    areas = np.concatenate([[0.0], np.cumsum((values[1:] + values[:-1]) / 2 * np.diff(ends))])

    def antiderivative(z: Array) -> Array:
        place = np.clip(np.searchsorted(ends, z) - 1, 0, len(steps) - 1)
        x = np.clip(z, ends[0], ends[-1]) - ends[place]
        return areas[place] + values[place] * x + steps[place] * x**2 / 2

    truth = 0.0
    for low, high in itertools.pairwise(knots):
        # Smooth inside; from 0 on the substitution makes the weight constant.
        a, b = low ** (3 - p), high ** (3 - p)
        s = ((a + b) / 2 + (b - a) / 2 * nodes) ** (1 / (3 - p))
        mean = (antiderivative(height + s) - antiderivative(height - s)) / (2 * s)
        truth += float((b - a) / 2 * weights @ mean)
    truth *= radius ** (p - 2)
    value, error = occlusion(
        block, np.diag([WIDE, WIDE, h, 1.0]), point, radius, p, directions=65536
    )
    assert error[0] < 1e-4
    assert abs(value[0] - truth) < SIGMAS * error[0] + 1e-6


@pytest.mark.parametrize("p", [0.0, 1.0, 2.0])
def test_g3_potential_of_a_blob(p: float) -> None:
    """All matter inside the ball, the point outside of it: a sum over cells in oblique space."""
    rng = np.random.default_rng(2)
    where, shape = affine(7), (4, 5, 3)
    sigma = rng.random((1, *shape), dtype=np.float32)
    index = np.array([6.5, 2.2, 1.1])
    point = where[:3, :3] @ index + where[:3, 3]
    x, w = np.polynomial.legendre.leggauss(8)
    axes = [(np.arange(-1, n)[:, None] + (x + 1) / 2).ravel() for n in shape]
    weights = [np.tile(w / 2, n + 1) for n in shape]
    cells = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    volume = np.einsum("i,j,k->ijk", *weights) * abs(np.linalg.det(where[:3, :3]))
    distance = np.linalg.norm((cells - index) @ where[:3, :3].T, axis=-1)
    radius = float(distance.max()) + 1
    potential = float((volume * interpolate(sigma[0], cells) * distance**-p).sum())
    truth = (3 - p) * radius ** (p - 2) * potential / (4 * math.pi)
    value, error = occlusion(sigma, where, point[None], radius, p, directions=1 << 17)
    assert error[0] < 5e-3 * truth
    assert abs(value[0] - truth) < SIGMAS * error[0] + 1e-6


def test_half_space_about_the_outward_vector() -> None:
    """With sigma = a + b z seen over the half space about w only: the mean cosine is w_z / 2."""
    p, radius, a, b = 1.0, 3.0, 5.0, 0.25
    sigma = np.broadcast_to(a + b * np.arange(20, dtype=np.float32), (1, 20, 20, 20)).copy()
    outward = np.zeros((3, 20, 20, 20), np.float32)
    outward[0], outward[2] = 0.3, -0.4  # not of unit length: only its direction counts
    points = np.array([[10.0, 10, 10], [9.2, 10.4, 8.7]])
    value, error = occlusion(
        sigma, np.eye(4), points, radius, p, outward=outward, directions=1 << 15
    )
    level = a + b * points[:, 2]
    truth = level * radius - 0.8 * b / 2 * radius**2 * (3 - p) / (4 - p)
    assert np.all(error < 1e-3)
    assert np.all(np.abs(value - truth) < SIGMAS * error)
    whole, _ = occlusion(
        sigma, np.eye(4), points, radius, p, outward=0 * outward, directions=1 << 15
    )
    np.testing.assert_allclose(whole, level * radius, rtol=1e-3)


def test_channels_have_their_own_occluder() -> None:
    rng = np.random.default_rng(3)
    occluder = rng.random((3, 9, 9, 9), dtype=np.float32)
    points, equation = rng.uniform(1, 7, (5, 3)), {"outward": None, "weight_p": 1.0, "scale": 0.3}
    light = (UP, "direction", -1.0, constant([1, 2, 3]))
    found, _ = in_scattered(
        occluder[:1], np.eye(4), points, [light], radius=4.0,
        equation={"kind": "occluded", "occluder": occluder} | equation,
    )  # fmt: skip
    for c in range(3):
        grey, _ = in_scattered(
            occluder[:1], np.eye(4), points, [light], radius=4.0,
            equation={"kind": "occluded", "occluder": occluder[c : c + 1].copy()} | equation,
        )  # fmt: skip
        np.testing.assert_allclose(found[:, c], grey[:, c], rtol=1e-12)


def test_unbiased_with_errors_that_cover() -> None:
    sigma, radius, h = np.float32(0.7), 0.9, 0.05
    block = np.full((1, 3, 3, 40), sigma, np.float32)
    points = np.repeat([[WIDE, WIDE, 39.5 * h - 0.3]], 2000, axis=0)
    where = np.diag([WIDE, WIDE, h, 1.0])
    value, error = occlusion(block, where, points, radius, 1.0, directions=128)

    def face(d: float) -> float:
        return float(sigma) * (radius - (radius - d) ** 2 / (2 * radius))

    check_statistics(value, error, integrate.quad(face, 0.3 - h / 2, 0.3 + h / 2)[0] / h)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"occluder": np.ones((2, 3, 3, 3), np.float32)}, "equation's occluder has shape"),
        ({"occluder": np.ones((1, 3, 3, 3))}, "occluder is not a C-contiguous array of float32"),
        ({"outward": np.ones((1, 3, 3, 3), np.float32)}, "outward has shape .* c = 3"),
        ({"weight_p": 3.0}, "weight_p is not a number from 0"),
        ({"radius": math.inf}, "radius is infinite"),
    ],
)
def test_bad_input_is_named(changes: dict[str, Any], message: str) -> None:
    ones = np.ones((1, 3, 3, 3), np.float32)
    fields = {"kind": "occluded", "occluder": ones, "outward": None, "weight_p": 1, "scale": 1}
    radius = changes.pop("radius", 1.0)
    with pytest.raises(ValueError, match=message):
        in_scattered(
            ones, np.eye(4), np.ones((1, 3)), [SPHERE], radius=radius, equation=fields | changes
        )
