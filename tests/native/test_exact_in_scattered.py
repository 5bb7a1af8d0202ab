"""The judge's in-scattered radiance against closed forms, and the honesty of its errors."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import trilinear
from judging import SIGMAS, UP, WIDE, check, cone, constant, half_space, in_scattered
from scipy import special, stats
from trilinear import Array

import volillum_native as native

OPAQUE = 1e9


def sphere(coefficients: Array) -> tuple[Any, ...]:
    return UP, "direction", -1.0, coefficients


@pytest.mark.parametrize("degrees", [15, 30, 45, 60, 90])
@pytest.mark.parametrize("depth", [0.5, 1.0, 2.0, 5.0])
def test_c1_cone_in_a_half_space(degrees: float, depth: float) -> None:
    cosine = math.cos(math.radians(degrees))
    oblique = cosine * special.expn(2, depth / cosine) if degrees < 90 else 0.0
    truth = float((special.expn(2, depth) - oblique) / (1 - cosine))
    value, error = in_scattered(
        *half_space(depth), [cone(UP, degrees)], directions=8192, seed=int(degrees)
    )
    check(value, error, truth)


@pytest.mark.parametrize(
    ("tilt", "truth"),
    [(20, 0.3178362848363217), (40, 0.24199243682194077), (55, 0.15700048653528936)],
)
def test_c8_tilted_cone(tilt: float, truth: float) -> None:
    for turn in (0.0, 1.0, 4.0):
        sine = math.sin(math.radians(tilt))
        axis = [sine * math.cos(turn), sine * math.sin(turn), math.cos(math.radians(tilt))]
        value, error = in_scattered(*half_space(1.0), [cone(axis, 30)], directions=8192)
        check(value, error, truth)


@pytest.mark.parametrize(
    ("depth", "truth"), [(0.25, 0.2588650622302352), (1.0, 0.07424775338796097)]
)
def test_f5_uniform_environment(depth: float, truth: float) -> None:
    medium = half_space(depth, floor=OPAQUE)
    value, error = in_scattered(*medium, [sphere(constant(1))], directions=32768)
    check(value, error, truth)


def test_f4_radiance_is_of_outward_directions() -> None:
    """L = 1 + w_z / 2 seen by the upper half only: 0.625 (0.375 with the printed parity)."""
    coefficients = np.zeros((4, 3))
    coefficients[0] = math.sqrt(4 * math.pi)
    coefficients[2] = 0.5 * math.sqrt(4 * math.pi / 3)
    sigma_t = np.zeros((1, 3, 3, 3), np.float32)
    sigma_t[..., 0] = OPAQUE
    affine, point = np.diag([WIDE, WIDE, 1, 1]), np.array([[WIDE, WIDE, 1.0]])
    value, error = in_scattered(sigma_t, affine, point, [sphere(coefficients)], directions=32768)
    check(value, error, 0.625)
    affine[2, 2] = -1  # the floor is now a ceiling
    value, error = in_scattered(
        sigma_t, affine, -point * [-1, -1, 1], [sphere(coefficients)], directions=32768
    )
    check(value, error, 0.375)


def test_harmonics_are_real_orthonormal_without_condon_shortley_sign() -> None:
    """A lobe without width returns L(axis): every coefficient against scipy."""
    rng = np.random.default_rng(1)
    coefficients = rng.normal(size=(16, 3))
    empty = np.zeros((1, 2, 2, 2), np.float32)
    for axis in rng.normal(size=(20, 3)):
        x, y, z = axis / np.linalg.norm(axis)
        polar, azimuth = math.acos(z), math.atan2(y, x)
        basis = np.zeros(16)
        for band in range(4):
            for m in range(-band, band + 1):
                full = special.sph_harm_y(band, abs(m), polar, azimuth) * (-1) ** m
                part = full.real if m >= 0 else full.imag
                basis[band * (band + 1) + m] = part * (math.sqrt(2) if m else 1)
        for count in (1, 4, 9, 16):
            term = (axis, "direction", 1.0, coefficients[:count])
            value, error = in_scattered(empty, np.eye(4), np.zeros((1, 3)), [term])
            np.testing.assert_allclose(value[0], basis[:count] @ coefficients[:count], atol=1e-13)
            assert np.all(error == 0)


@pytest.mark.parametrize(
    ("degrees", "offset", "occluded"),
    [
        (30, 0, 0.5),
        (30, 10, 0.2959068366598302),
        (30, 20, 0.11372187938715776),
        (45, 20, 0.23759863358794292),
        (60, 20, 0.3089285321740001),
    ],
)
def test_c4_knife_edge(degrees: float, offset: float, occluded: float) -> None:
    """An opaque plate, 1e-9 thick at distance 1; its edge stands `offset` degrees off the axis."""
    thin = 1e-9
    affine = np.diag([1e3, 1e4, thin, 1.0])
    # The plate reaches one voxel beyond its border voxel; there it ends within 1e3 / (OPAQUE thin
    # 1e9): the depth of the ramp exceeds 30 at 3e-8 of its kilometre.
    affine[:3, 3] = [1e3 + math.tan(math.radians(offset)), -1e4, 1.0]
    plate = np.full((1, 3, 3, 1), OPAQUE * 1e9, np.float32)
    value, error = in_scattered(
        plate, affine, np.zeros((1, 3)), [cone(UP, degrees)], directions=65536
    )
    # A discontinuous integrand: the lattice's error is larger, and its standard error says so.
    check(value, error, 1 - occluded, systematic=1e-4)


def test_c3_disc() -> None:
    """An opaque disc of voxels; its jagged rim lies between two circles that bound the truth."""
    radius, distance = 150, 150 / math.tan(math.radians(20))
    offsets = np.arange(-radius - 1, radius + 2)
    disc = offsets[:, None] ** 2 + offsets**2 <= radius**2
    affine = np.eye(4)
    affine[:3, 3] = [-radius - 1, -radius - 1, distance]
    plate = (disc[None, ..., None] * OPAQUE).astype(np.float32)
    value, error = in_scattered(plate, affine, np.zeros((1, 3)), [cone(UP, 45)], directions=65536)

    def open_share(rim: float, depth: float) -> float:
        blocked = 1 - math.cos(math.atan2(rim, depth))
        return 1 - blocked / (1 - math.cos(math.radians(45)))

    # Points nearer than sqrt(1/2) to a disc voxel's centre have weight from it; none further than
    # sqrt(2) has any, and the plate fills one voxel before and behind its plane.
    low, high = open_share(radius + math.sqrt(2), distance - 1), open_share(radius - 1, distance)
    assert high - low < 0.007
    assert low < 0.7940977279760713 < high
    assert np.all(value > low - SIGMAS * error)
    assert np.all(value < high + SIGMAS * error)


@pytest.mark.parametrize(("at", "truth"), [(0.0, 0.22313016014842982), (0.5, 0.2783595100087991)])
def test_f7_inside_a_homogeneous_sphere(at: float, truth: float) -> None:
    """Mean visibility at the centre and half way out, kappa a = 1.5."""
    voxels, fine = 24, 6
    x = (np.arange(-(voxels + 1) * fine - fine // 2, (voxels + 1) * fine + fine // 2) + 0.5) / fine
    inside = x[:, None, None] ** 2 + x[None, :, None] ** 2 + x**2 <= voxels**2
    size = len(x) // fine
    share = inside.reshape(size, fine, size, fine, size, fine).mean(axis=(1, 3, 5))
    affine = np.diag([1 / voxels] * 3 + [1.0])
    affine[:3, 3] = -(voxels + 1) / voxels
    value, error = in_scattered(
        (1.5 * share).astype(np.float32)[None],
        affine,
        np.array([[0.0, 0.0, at]]),
        [sphere(constant(1))],
        directions=16384,
    )
    # Voxel average (variance 1/12 of a voxel^2) and trilinear hat (1/6) blur the surface by a
    # variance of 1/4 at constant volume, int r^2 dr, so the mean int dr shrinks by (1/4) / voxels^2
    # of the radius to first order; at half radius oblique rays see up to 1 / (1 - 1/4) of it.
    # 6^3 samples a voxel add a volume error below 1e-4.
    shift = 1.5 * (0.25 / voxels**2 / 0.75 + 1e-4)
    check(value, error, truth, systematic=truth * shift)


def test_radius_cuts_visibility() -> None:
    """Deep inside a block every ray of length R has the depth sigma R: no variance at all."""
    block = np.full((1, 40, 40, 40), 0.3, np.float32)
    value, error = in_scattered(
        block, np.eye(4), np.full((1, 3), 20.0), [sphere(constant(2))], radius=7.5
    )
    assert np.allclose(value, 2 * math.exp(-float(np.float32(0.3)) * 7.5), rtol=1e-12)
    assert np.all(error < 1e-14)


def test_narrow_lobe_becomes_its_axis() -> None:
    rng = np.random.default_rng(2)
    block = rng.random((1, 9, 9, 9), dtype=np.float32)
    axis, points = rng.normal(size=3), rng.uniform(1, 7, (30, 3))
    vectors = np.tile(axis / np.linalg.norm(axis), (30, 1))
    depth = native.exact_optical_depth(block, np.eye(4), points, vectors)
    value, error = in_scattered(block, np.eye(4), points, [cone(axis, 0, 3)])
    np.testing.assert_allclose(value, 3 * np.exp(-depth) * np.ones(3), rtol=1e-12)
    assert np.all(error == 0)
    narrow, _ = in_scattered(block, np.eye(4), points, [cone(axis, 1e-3, 3)])
    # 1.7e-5 rad over at most 16 voxels of slope below 1: a depth of 16^2 / 2 times that.
    np.testing.assert_allclose(narrow, value, rtol=3e-3)


def test_axis_toward_a_point() -> None:
    """Toward a point is the fixed axis from each point to the eye, with the same random rays."""
    rng = np.random.default_rng(3)
    block = rng.random((1, 9, 9, 9), dtype=np.float32)
    points, eye = rng.uniform(1, 7, (8, 3)), np.array([4.0, 30.0, -6.0])
    cosine = math.cos(0.6)
    value, _ = in_scattered(block, np.eye(4), points, [(eye, "point", cosine, constant(1))])
    for index, point in enumerate(points):
        fixed, _ = in_scattered(
            block, np.eye(4), points, [(eye - point, "direction", cosine, constant(1))]
        )
        np.testing.assert_allclose(value[index], fixed[index], rtol=1e-10)
    at_eye, _ = in_scattered(
        block, np.eye(4), points[:1], [(points[0], "point", cosine, constant(1))]
    )
    assert np.all(np.isfinite(at_eye))


def test_channels_see_their_own_extinction() -> None:
    rng = np.random.default_rng(4)
    sigma_t = rng.random((3, 6, 7, 8), dtype=np.float32)
    affine, points = trilinear.affine(1), rng.normal(size=(5, 3))
    terms = [cone([1, 2, 3], 40), sphere(rng.normal(size=(16, 3)))]
    value, error = in_scattered(sigma_t, affine, points, terms)
    for channel in range(3):
        grey, grey_error = in_scattered(
            sigma_t[channel : channel + 1].copy(), affine, points, terms
        )
        np.testing.assert_allclose(value[:, channel], grey[:, channel], rtol=1e-11, atol=1e-13)
        np.testing.assert_allclose(error[:, channel], grey_error[:, channel], rtol=1e-7, atol=1e-12)


def test_clamp_is_of_the_mean() -> None:
    dark = sphere(np.array([[-1.0, 1.0, -1.0]]))
    arguments = (np.zeros((1, 2, 2, 2), np.float32), np.eye(4), np.zeros((1, 3)), [dark])
    level = 1 / math.sqrt(4 * math.pi)
    np.testing.assert_allclose(in_scattered(*arguments)[0], [[-level, level, -level]])
    clamped = in_scattered(*arguments, clamp=True)[0]
    np.testing.assert_allclose(clamped, [[0, level, 0]])


def seeds(count: int, directions: int, replicates: int) -> tuple[Array, Array, float]:
    """Independent estimates [count] of case C1, theta = 60 degrees, t = 1, their errors, truth."""
    sigma_t, affine, point = half_space(1.0)
    value, error = in_scattered(
        sigma_t,
        affine,
        np.repeat(point, count, axis=0),
        [cone(UP, 60)],
        directions=directions,
        replicates=replicates,
        seed=5,
    )
    return value[:, 0], error[:, 0], 0.25945675173135346


@pytest.mark.parametrize("directions", [2, 6, 64])
def test_estimates_are_unbiased(directions: int) -> None:
    count = 20_000
    value, _, truth = seeds(count, directions, 2)
    z = (value.mean() - truth) / (value.std(ddof=1) / math.sqrt(count))
    assert abs(z) < 4  # one seed in 16,000


def test_standard_errors_cover_as_often_as_they_say() -> None:
    """|value - truth| < error as often as for t with 7 degrees of freedom: 64.9 %."""
    count, replicates = 2000, 8
    value, error, truth = seeds(count, 128, replicates)
    expected = 1 - 2 * stats.t.sf(1, replicates - 1)
    inside = int((np.abs(value - truth) < error).sum())
    # Each replicate is a rotated lattice, whose error is not normal: the mean of eight is close
    # enough to it that coverage moves by less than two points; the binomial noise is 4 sigma.
    noise = 4 * math.sqrt(expected * (1 - expected) / count)
    assert abs(inside / count - expected) < noise + 0.02
    # The mean squared error that is claimed is the one that is made.
    made, claimed = np.mean((value - truth) ** 2), np.mean(error**2)
    assert made / claimed == pytest.approx(1, abs=4 * math.sqrt(2 / count + 2 / (7 * count)))


def test_a_point_depends_on_its_index_and_seed_only() -> None:
    rng = np.random.default_rng(6)
    block = rng.random((1, 20, 20, 20), dtype=np.float32)
    points, terms = rng.uniform(0, 20, (40, 3)), [cone([1, 1, 0], 50), sphere(constant(1))]
    value, error = in_scattered(block, np.eye(4), points, terms, threads=1)
    for threads in (2, 3):
        again = in_scattered(block, np.eye(4), points, terms, threads=threads)
        assert np.array_equal(value, again[0])
        assert np.array_equal(error, again[1])
    few, _ = in_scattered(block, np.eye(4), points[:7].copy(), terms)
    assert np.array_equal(value[:7], few)
    other, _ = in_scattered(block, np.eye(4), points, terms, seed=1)
    assert not np.any(other == value)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"terms": [(UP, "direction", 0.5)]},
            r"terms\[0\] is not a tuple \(axis, toward, cos_theta",
        ),
        (
            {"terms": [(UP, "direction", 1.5, constant(1))]},
            r"terms\[0\]'s cos_theta is not a number",
        ),
        (
            {"terms": [(UP[:2], "direction", 0.5, constant(1))]},
            r"axis has shape \(2,\); expected \(3,\)",
        ),
        ({"terms": [(0 * UP, "direction", 0.5, constant(1))]}, r"terms\[0\]'s axis is zero"),
        ({"terms": [(UP, "direction", 0.5, np.ones((2, 3)))]}, r"radiance has shape \(2, 3\)"),
        (
            {"terms": [(UP, "direction", 0.5, np.full((1, 3), np.nan))]},
            "radiance holds a value that is",
        ),
        ({"replicates": 1}, "replicates is 1; expected at least 2"),
        ({"directions": 0}, "directions is 0"),
        ({"points": np.zeros((1, 4))}, r"points has shape \(1, 4\)"),
    ],
)
def test_bad_input_is_named(changes: dict[str, Any], message: str) -> None:
    arguments: dict[str, Any] = {
        "sigma_t": np.ones((1, 3, 3, 3), np.float32),
        "index_to_world": np.eye(4),
        "points": np.zeros((1, 3)),
        "terms": [cone(UP, 30)],
    }
    with pytest.raises(ValueError, match=message):
        in_scattered(**(arguments | changes))
