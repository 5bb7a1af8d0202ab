"""Neighbourhood sums against exact integrals, closed forms and their own symmetries."""

from __future__ import annotations

import math
import threading
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray
from trilinear import Ray, affine, interpolate

import volillum_native
from volillum_native import convolve

IDENTITY = np.eye(4)
# float32 sums that have passed through float64 transforms: one rounding at the end.
FLOAT = 1.2e-7
# The kernel's cubature: a homogeneous medium shows it (the sum of all weights).
CUBATURE = 3e-6


def random_field(shape: tuple[int, ...], seed: int) -> NDArray[np.float32]:
    return np.random.default_rng(seed).random(shape).astype(np.float32)


def sums(field: NDArray[np.float32], index_to_world: NDArray[np.float64] = IDENTITY,
         precision: str = "double", **settings: float) -> NDArray[np.float32]:  # fmt: skip
    return convolve(
        np.ascontiguousarray(field)[None], index_to_world, precision=precision, **settings
    )[0]


def by_rays(field: NDArray[np.float32], matrix: NDArray[np.float64], voxel: tuple[int, int, int],
            radius: float, p: int, rings: int) -> float:  # fmt: skip
    """(3 - p) / (4 pi R^(3-p)) integral over directions and s < R of s^(2-p) field ds, exact along
    each ray."""
    cosines, weights = np.polynomial.legendre.leggauss(rings)
    origin = matrix[:3, :3] @ np.array(voxel) + matrix[:3, 3]
    total = 0.0
    for cosine, weight in zip(cosines, weights, strict=True):
        for angle in (np.arange(2 * rings) + 0.5) * math.pi / rings:
            sine = math.sqrt(1 - cosine * cosine)
            direction = np.array([sine * math.cos(angle), sine * math.sin(angle), cosine])
            ray = Ray(field.shape, matrix, origin, direction, radius)
            _, t, step = ray.nodes(4)
            value = (step * t ** (2 - p) * interpolate(field, ray.at(t))).sum()
            total += weight / (4 * rings) * float(value)
    return total * (3 - p) / radius ** (3 - p)


@pytest.mark.parametrize(
    ("matrix", "voxel", "radius", "p"),
    [
        (IDENTITY, (3, 2, 2), 2.2, 1),
        (IDENTITY, (0, 5, 1), 0.4, 2),
        (affine(1), (3, 2, 2), 1.7, 2),
        (affine(1), (6, 0, 4), 1.1, 0),
        (affine(2, mirrored=True), (1, 2, 3), 2.0, 1),
    ],
)
def test_integrals_along_rays(
    matrix: NDArray[np.float64], voxel: tuple[int, int, int], radius: float, p: int
) -> None:
    """Spherical coordinates and exact pieces instead of cells and hats."""
    field = random_field((7, 6, 5), seed=1)
    rings = 24
    expected = by_rays(field, matrix, voxel, radius, p, rings)
    # The rule over directions meets kinks: second order, with 2 rings^2 / pi cells of the sphere.
    tolerance = 0.5 / rings**2
    found = sums(field, matrix, radius=radius, weight_p=p)[voxel]
    assert found == pytest.approx(expected, rel=tolerance)


@pytest.mark.parametrize("p", [0, 1, 2])
@pytest.mark.parametrize("radius", [0.3, 1.0, 2.5, 4.0, 9.3])
def test_homogeneous_inside(radius: float, p: int) -> None:
    """Case G1, at every voxel whose sphere stays inside: the weights' sum."""
    reach = math.ceil(radius)
    field = np.full((2 * reach + 3,) * 3, 0.7, np.float32)
    found = sums(field, radius=radius, weight_p=p, total=radius)
    inside = found[reach : reach + 3, reach : reach + 3, reach : reach + 3]
    assert np.allclose(inside, np.float32(0.7) * radius, rtol=CUBATURE)


@pytest.mark.parametrize("matrix", [affine(1), affine(4, mirrored=True), np.diag([1, 1, 9.0, 1])])
def test_homogeneous_inside_on_any_lattice(matrix: NDArray[np.float64]) -> None:
    inverse = np.linalg.inv(matrix[:3, :3])
    reach = np.ceil(2.3 * np.linalg.norm(inverse, axis=1)).astype(int)
    field = np.ones(2 * reach + 1, np.float32)
    for p in (0, 1, 2):
        found = sums(field, matrix, radius=2.3, weight_p=p)
        assert found[tuple(reach)] == pytest.approx(1, rel=CUBATURE)


@pytest.mark.parametrize("p", [1, 2])
def test_plane_face(p: int) -> None:
    """Case G2: a homogeneous half space behind a plane, at depths on both sides of it.

    The field is 1 up to z = 0 and falls to 0 at z = 1 (one voxel). With the area of |y|^-p on the
    plane at height z, 2 pi (R - |z|) for p = 1 and 2 pi ln(R / |z|) for p = 2, the sum is one
    integral over z; a sharp face half a voxel up is the closed form of the table, to second order.
    """
    reach, depth = 8, 20
    radius = float(reach)
    field = np.zeros((2 * reach + 1, 2 * reach + 1, depth + reach + 2), np.float32)
    field[..., : depth + 1] = 1
    row = sums(field, radius=radius, weight_p=p)[reach, reach]
    x, w = np.polynomial.legendre.leggauss(60)
    for index in range(depth - reach + 1, depth + reach):
        # z up from the voxel; the ramp lies between begin and begin + 1. Squares of the variable
        # tame the logarithm at 0.
        begin = depth - index
        total = 0.0
        for low, high in ((-radius, 0.0), (0.0, radius)):
            cuts = sorted({low, high, *(c for c in (begin, begin + 1) if low < c < high)})
            for a, b in pairwise(cuts):
                near, far = sorted((abs(a), abs(b)))
                u = (x + 1) / 2 * (math.sqrt(far) - math.sqrt(near)) + math.sqrt(near)
                height = u * u
                step = w / 2 * (math.sqrt(far) - math.sqrt(near)) * 2 * u
                area = radius - height if p == 1 else np.log(radius / height)
                value = np.clip(begin + 1 - np.sign(a + b) * height, 0, 1)
                total += float((step * 2 * math.pi * area * value).sum())
        expected = total * (3 - p) / (4 * math.pi * radius ** (3 - p))
        # The disc's rim is resolved by cubature like the sphere's: absolute, of a full sum of 1.
        assert row[index] == pytest.approx(expected, abs=CUBATURE)
        inside = depth + 0.5 - index  # how deep below the sharp face
        if inside >= 0:
            sharp = (
                1 - ((radius - inside) / radius) ** 2 / 2
                if p == 1
                else 1 - (radius - inside - inside * math.log(radius / inside)) / (2 * radius)
            )
            # Second derivative of the sum over a ramp of variance 1/12: at most 1 / R^2 for p = 1
            # and 1 / (2 R inside) for p = 2; twice that as room for the next order.
            curvature = 1 / radius**2 if p == 1 else 1 / (2 * radius * inside)
            assert row[index] == pytest.approx(sharp, abs=curvature / 12)


def test_potential_of_a_ball() -> None:
    """Case G3: 1/r sums of a homogeneous ball inside the kernel, to second order in the voxels."""
    errors = []
    for n in (8, 16):
        # Voxels hold the exact share of a ball of radius n / 2 by 6^3 points each.
        size = 3 * n + 1
        fine = (np.arange(6 * size) + 0.5) / 6 - size / 2
        squares = fine**2
        inside = (squares[:, None, None] + squares[None, :, None] + squares) <= (n / 2) ** 2
        field = inside.reshape(size, 6, size, 6, size, 6).mean(axis=(1, 3, 5)).astype(np.float32)
        radius = 1.5 * n + 2  # all of the ball, smeared, seen from a ball's radius outside
        row = sums(field, radius=radius)[size // 2, size // 2, size // 2 :]
        r, a = np.arange(n + 1) / n, 0.5
        expected = np.where(
            r < a, 2 * math.pi * (a * a - r * r / 3), 4 * math.pi * a**3 / 3 / np.maximum(r, a)
        )
        scaled = row[: n + 1] * 2 * math.pi * (radius / n) ** 2
        mass = field.sum() / (4 / 3 * math.pi * (n / 2) ** 3)  # what 6^3 points make of the ball
        errors.append(np.abs(scaled / mass - expected).max() / expected[0])
    # Cell averages and hats smear the ball by a variance of 1/12 + 1/6 voxels squared an axis: half
    # of that times the potential's Laplacian (4 pi inside) is (h/a)^2 / 4 of its largest value. The
    # lattice's aliasing is of the same order and smaller: a fifth more.
    assert errors[0] < 0.3 * (2 / 8) ** 2
    assert errors[1] < 0.3 * (2 / 16) ** 2


def test_a_finer_lattice_of_the_same_interpolant_gives_the_same() -> None:
    field = random_field((6, 5, 7), seed=3)
    fine = np.zeros((6, 9, 7), np.float32)
    fine[:, ::2] = field
    fine[:, 1::2] = (field[:, 1:] + field[:, :-1]) / 2
    # Half a voxel of the coarse border's fall to zero, which the fine one must have too.
    fine = np.pad(fine, [(0, 0), (1, 1), (0, 0)])
    fine[:, 0], fine[:, -1] = field[:, 0] / 2, field[:, -1] / 2
    coarse_matrix, fine_matrix = np.diag([1, 2.0, 1, 1]), np.diag([1, 1.0, 1, 1])
    coarse = sums(field, coarse_matrix, radius=2.6)
    again = sums(fine, fine_matrix, radius=2.6)[:, 1:-1:2]
    assert np.allclose(coarse, again, rtol=0, atol=CUBATURE)


@pytest.mark.parametrize("precision", ["single", "double"])
def test_mirrored_and_turned_fields(precision: str) -> None:
    field = random_field((9, 12, 10), seed=4)
    given = {"precision": precision, "radius": 3.3}
    plain = sums(field, **given)
    # Single: the rounding of transforms of 5 N log N operations, about 4 epsilons of the sums.
    slack = 5e-7 if precision == "single" else FLOAT
    assert np.allclose(sums(field[::-1], **given)[::-1], plain, rtol=0, atol=slack)
    assert np.allclose(sums(field[:, ::-1, ::-1], **given)[:, ::-1, ::-1], plain, atol=slack)
    turned = np.ascontiguousarray(field.transpose(2, 0, 1))
    # Where two axes cross the sphere equally steeply, the first is taken: cubature differs.
    slack += CUBATURE
    assert np.allclose(sums(turned, **given), plain.transpose(2, 0, 1), rtol=0, atol=slack)


def test_linear_and_positive() -> None:
    one, two = random_field((8, 7, 9), seed=5), random_field((8, 7, 9), seed=6)
    both = sums(2 * one + 3 * two, radius=2.0)
    apart = 2 * sums(one, radius=2.0) + 3 * sums(two, radius=2.0)
    assert np.allclose(both, apart, rtol=6 * FLOAT)
    sparse = np.where(one > 0.9, one, 0).astype(np.float32)
    assert sums(sparse, radius=2.0).min() >= 0


def test_channels_share_nothing_but_the_kernel() -> None:
    fields = random_field((3, 6, 9, 5), seed=7)
    together = convolve(fields, IDENTITY, radius=2.4)
    for field, found in zip(fields, together, strict=True):
        assert np.array_equal(convolve(field[None], IDENTITY, radius=2.4)[0], found)


@pytest.mark.parametrize("shape", [(1, 1, 1), (1, 7, 1), (2, 3, 40)])
@pytest.mark.parametrize("radius", [0.2, 3.0, 1000.0])
def test_thin_grids_and_radii_beyond_them(shape: tuple[int, int, int], radius: float) -> None:
    """Against direct sums over the offsets, with weights from the sums of a single voxel."""
    field = random_field(shape, seed=8)
    wide = [2 * n - 1 for n in shape]
    spike = np.zeros(wide, np.float32)
    spike[tuple(n - 1 for n in shape)] = 1
    weights = sums(spike, radius=radius)
    expected = np.zeros(shape)
    for at in np.ndindex(shape):
        part = tuple(slice(n - 1 - i, 2 * n - 1 - i) for n, i in zip(shape, at, strict=True))
        expected[at] = (weights[part].astype(np.float64) * field).sum()
    assert np.allclose(sums(field, radius=radius), expected, rtol=4 * FLOAT)


def test_the_number_of_threads_changes_no_bit() -> None:
    field = random_field((1, 21, 18, 37), seed=9)
    for precision in ("single", "double"):
        results = [
            convolve(field, affine(3), radius=3.0, threads=threads, precision=precision)
            for threads in (1, 2, 5)
        ]
        assert np.array_equal(results[0], results[1])
        assert np.array_equal(results[0], results[2])


def test_opacities_are_summed_instead_of_extinction() -> None:
    """To full relative precision where the medium is thin too."""
    for scale in (1e-9, 1.0, 100.0):
        sigma_t = random_field((8, 8, 8), seed=10) * np.float32(scale)
        alpha = (-np.expm1(-sigma_t.astype(np.float64) * 0.8)).astype(np.float32)
        found = sums(sigma_t, radius=2.0, opacity_length=0.8)
        # exp_negative's 2e-7 of 1 - exp(-x) at x > 1/4 is below 1e-6 of it.
        assert np.allclose(found, sums(alpha, radius=2.0), rtol=1e-6)


def test_complement_and_bounds() -> None:
    field = np.full((9, 9, 9), 2, np.float32)
    plain = sums(field, radius=2.5, precision="single", upper=1.0)
    assert plain.max() == 1
    open_ = sums(field, radius=2.5, precision="single", upper=1.0, complement=True)
    assert np.array_equal(open_, 1 - plain)


def test_single_precision_errs_by_its_rounding() -> None:
    field = random_field((40, 33, 29), seed=11)
    exact = sums(field, radius=5.0)
    found = sums(field, radius=5.0, precision="single")
    # A forward and a backward transform of 5 passes an axis: each adds about half an epsilon.
    assert np.sqrt(np.mean((found - exact) ** 2)) < 2e-7 * exact.max()


def test_double_precision_keeps_what_is_faint_beside_spikes() -> None:
    """Voxels out of a spike's reach: their sums must not know of it."""
    field = random_field((40, 9, 9), seed=14)
    spiky = field.copy()
    spiky[2, 4, 4] = 1e6
    assert np.allclose(sums(spiky, radius=3.0)[8:], sums(field, radius=3.0)[8:], rtol=FLOAT)


def test_cancelling_stops_it() -> None:
    control = volillum_native.Control()
    control.cancel()
    field = random_field((1, 20, 20, 20), seed=12)
    with pytest.raises(volillum_native.Cancelled):
        convolve(field, IDENTITY, radius=3.0, control=control)


def test_progress_reaches_the_end() -> None:
    control = volillum_native.Control()
    worker = threading.Thread(
        target=lambda: convolve(
            random_field((2, 24, 24, 24), seed=13), IDENTITY, radius=3.0, control=control
        )
    )
    worker.start()
    worker.join()
    assert control.progress == pytest.approx(1)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"radius": 0.0}, "radius is 0.000000; expected a finite length above 0"),
        ({"radius": math.inf}, "radius is inf"),
        ({"weight_p": 3}, "weight_p is 3; expected 0, 1 or 2"),
        ({"precision": "half"}, "precision is 'half'"),
        ({"index_to_world": np.zeros((4, 4))}, "determinant"),
        ({"field": np.zeros((2, 2, 2), np.float32)}, "field has shape"),
        ({"total": math.nan}, "total"),
    ],
)
def test_bad_input_is_named(change: dict[str, object], message: str) -> None:
    given: dict[str, object] = {
        "field": np.zeros((1, 2, 2, 2), np.float32), "index_to_world": IDENTITY, "radius": 1.0
    }  # fmt: skip
    with pytest.raises(ValueError, match=message):
        convolve(**(given | change))
