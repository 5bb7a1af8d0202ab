"""The directional sweep against exact line integrals, closed forms and its own symmetries."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import erf
from trilinear import Array, Ray, affine

import volillum_native

Volume = NDArray[np.float32]
IDENTITY = np.eye(4)
# Two roundings of float32 per term, stencil coefficients included, and cancelling nothing: a sum
# of positive terms is good to a few units of 6e-8.
FLOAT_TOLERANCE = 1e-6


def unit(*vector: float) -> Array:
    return np.array(vector) / np.linalg.norm(vector)


def optical_depth(
    sigma_t: Volume,
    index_to_world: Array,
    direction: Array,
    *,
    radius: float = np.inf,
    near_slices: int = 0,
    threads: int = 0,
) -> Volume:
    one = np.ones((1, 1), np.float32)
    return volillum_native.sweep(
        sigma_t,
        index_to_world,
        direction[None],
        one,
        radius=radius,
        near_slices=near_slices,
        quantity="optical_depth",
        threads=threads,
    )[0]


def exact(
    sigma_t: Volume, index_to_world: Array, voxel: Array, direction: Array, radius: float = np.inf
) -> float:
    origin = index_to_world[:3, :3] @ voxel + index_to_world[:3, 3]
    return Ray(sigma_t.shape, index_to_world, origin, direction, radius).optical_depth(sigma_t)


AXES = [sign * np.roll([1.0, 0, 0], axis) for axis in range(3) for sign in (1, -1)]
OBLIQUE = [unit(*v) for v in [(3, 1, -2), (-1, 4, 1), (1, 2, 5), (-2, -1, -3), (-1, -5, 2)]]
DIAGONAL = [unit(1, 1, 0), unit(-1, 0, 1), unit(0, -1, -1), unit(1, -1, 1)]
AFFINES = {
    "identity": IDENTITY,
    "oblong": np.diag([0.3, 1.0, 2.5, 1.0]),
    "sheared": affine(1),
    "mirrored": affine(2, mirrored=True),
}


@pytest.mark.parametrize("name", AFFINES)
@pytest.mark.parametrize("radius", [np.inf, 0.4, 6.5])
def test_all_slices_near_is_the_exact_integral(name: str, radius: float) -> None:
    rng = np.random.default_rng(3)
    sigma_t = rng.random((13, 18, 21), dtype=np.float32)
    for direction in AXES + OBLIQUE + DIAGONAL:
        found = optical_depth(sigma_t, AFFINES[name], direction, radius=radius, near_slices=21)
        for voxel in rng.integers(0, sigma_t.shape, (4, 3)):
            truth = exact(sigma_t, AFFINES[name], voxel, direction, radius)
            assert found[tuple(voxel)] == pytest.approx(truth, rel=FLOAT_TOLERANCE, abs=1e-7)


@pytest.mark.parametrize(
    "shape",
    [
        (1, 1, 1),
        (2, 3, 5),
        (1, 1, 64),
        (64, 1, 1),
        (1, 37, 2),
        (17, 16, 33),
        (5, 140, 9),
        (40, 2, 3),
    ],
)
@pytest.mark.parametrize("radius", [np.inf, 2.3])
def test_small_and_odd_grids(shape: tuple[int, int, int], radius: float) -> None:
    rng = np.random.default_rng(4)
    sigma_t = rng.random(shape, dtype=np.float32)
    world = affine(5)
    for direction in AXES + OBLIQUE:
        found = optical_depth(sigma_t, world, direction, radius=radius, near_slices=max(shape))
        for voxel in rng.integers(0, shape, (3, 3)):
            truth = exact(sigma_t, world, voxel, direction, radius)
            assert found[tuple(voxel)] == pytest.approx(truth, rel=FLOAT_TOLERANCE, abs=1e-7)


@pytest.mark.parametrize("near_slices", [0, 3])
@pytest.mark.parametrize("radius", [np.inf, 0.7, 5.0, 11.3])
def test_along_an_axis_the_lattice_is_exact_too(near_slices: int, radius: float) -> None:
    """Lattice rays through voxel centres: the trapezoid rule integrates a linear interpolant."""
    rng = np.random.default_rng(5)
    sigma_t = rng.random((19, 20, 35), dtype=np.float32)
    world = AFFINES["oblong"]
    for direction in AXES:
        found = optical_depth(sigma_t, world, direction, radius=radius, near_slices=near_slices)
        for voxel in rng.integers(0, sigma_t.shape, (6, 3)):
            truth = exact(sigma_t, world, voxel, direction, radius)
            # The end inside a slice is a difference of terms of the size of one voxel's.
            assert found[tuple(voxel)] == pytest.approx(truth, rel=2e-6, abs=3e-7)


@pytest.mark.parametrize("thickness", [1, 7, 40])
def test_uniform_slab_has_the_border_half_a_voxel_beyond_its_last_centre(thickness: int) -> None:
    """The linear fall-off beyond the last centre weighs half a voxel."""
    sigma_t = np.full((thickness, 3, 3), 0.25, np.float32)
    size = 0.4
    found = optical_depth(sigma_t, np.diag([size, size, size, 1]), np.array([1.0, 0, 0]))
    centres = np.arange(thickness)
    truth = 0.25 * size * (thickness - 1 - centres + 0.5)
    np.testing.assert_allclose(found[:, 1, 1], truth, rtol=FLOAT_TOLERANCE)


def gaussian(size: int) -> tuple[Volume, Array, float]:
    """A Gaussian of deviation 0.12 and peak 8 in the unit cube, voxels and affine."""
    deviation = 0.12
    centres = (np.arange(size) + 0.5) / size - 0.5
    x, y, z = np.meshgrid(centres, centres, centres, indexing="ij")
    values = 8 * np.exp(-(x * x + y * y + z * z) / (2 * deviation**2))
    world = np.diag([1 / size, 1 / size, 1 / size, 1.0])
    world[:3, 3] = 0.5 / size - 0.5
    return values.astype(np.float32), world, deviation


def gaussian_depth(size: int, deviation: float, direction: Array) -> Array:
    """Closed form: Gaussian across the ray, error function along it."""
    centres = (np.arange(size) + 0.5) / size - 0.5
    points = np.stack(np.meshgrid(centres, centres, centres, indexing="ij"), axis=-1)
    along = points @ direction
    across = (points**2).sum(-1) - along**2
    scale = deviation * np.sqrt(2)
    return (
        8 * np.exp(-across / scale**2) * (deviation * np.sqrt(np.pi / 2)) * (1 - erf(along / scale))
    )


@pytest.mark.parametrize("near_slices", [0, 4])
def test_second_order_convergence_on_a_gaussian(near_slices: int) -> None:
    sizes = np.array([16, 32, 64, 128])
    for direction in (unit(3, 1, -2), unit(-1, 4, 1), unit(1, 1.5, -2)):
        errors = []
        for size in sizes:
            sigma_t, world, deviation = gaussian(int(size))
            found = optical_depth(sigma_t, world, direction, near_slices=near_slices)
            truth = gaussian_depth(int(size), deviation, direction)
            errors.append(np.sqrt(np.mean((found - truth) ** 2)))
        order = -np.polyfit(np.log(sizes), np.log(errors), 1)[0]
        assert order > 1.8, errors
        assert errors[-1] < 1e-3  # of a largest depth of 2.4


@pytest.mark.parametrize("radius", [0.11, 0.37])
def test_second_order_convergence_with_a_radius(radius: float) -> None:
    direction = unit(1, 2, -1.3)
    sizes = np.array([16, 32, 64, 128])
    errors = []
    for size in sizes:
        sigma_t, world, deviation = gaussian(int(size))
        found = optical_depth(sigma_t, world, direction, radius=radius)
        centres = (np.arange(size) + 0.5) / size - 0.5
        points = np.stack(np.meshgrid(centres, centres, centres, indexing="ij"), axis=-1)
        along = points @ direction
        scale = deviation * np.sqrt(2)
        across = (points**2).sum(-1) - along**2
        span = erf((along + radius) / scale) - erf(along / scale)
        truth = 8 * np.exp(-across / scale**2) * deviation * np.sqrt(np.pi / 2) * span
        errors.append(np.sqrt(np.mean((found - truth) ** 2)))
    assert -np.polyfit(np.log(sizes), np.log(errors), 1)[0] > 1.8, errors


def test_near_field_halves_the_error_at_hard_surfaces() -> None:
    """Ambient visibility of the voxels that one sees: the outer ones of opaque, hard-edged bodies.

    Between a body's outermost voxels and the air before them the lattice interpolates optical
    depths of 0 and several units: that is the error that the near field is for.
    """
    rng = np.random.default_rng(6)
    index = np.stack(np.meshgrid(*[np.arange(48.0)] * 3, indexing="ij"), axis=-1)
    sigma_t = np.zeros((48, 48, 48), np.float32)
    for _ in range(6):
        centre, size = rng.uniform(8, 40, 3), rng.uniform(2, 8, 3)
        sigma_t[(np.abs(index - centre) < size).all(-1)] = rng.uniform(0.5, 2)
        centre = rng.uniform(8, 40, 3)
        sigma_t[((index - centre) ** 2).sum(-1) < rng.uniform(3, 8) ** 2] = rng.uniform(0.5, 2)
    covered = np.minimum.reduce(
        [np.roll(sigma_t, step, axis) for axis in range(3) for step in (1, -1)]
    )
    outer = np.argwhere((sigma_t > 0) & (covered == 0))
    voxels = outer[rng.choice(len(outer), 60, replace=False)]
    directions = rng.normal(size=(24, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    weights = np.full((24, 1), 1 / 24, np.float32)
    truth = np.array(
        [
            np.mean([np.exp(-exact(sigma_t, IDENTITY, voxel, w)) for w in directions])
            for voxel in voxels
        ]
    )
    errors = []
    for near_slices in (0, 4):
        found = volillum_native.sweep(
            sigma_t, IDENTITY, directions, weights, near_slices=near_slices
        )[0]
        errors.append(float(np.sqrt(np.mean((found[tuple(voxels.T)] - truth) ** 2))))
    assert errors[1] < 0.5 * errors[0], errors


def test_transmittance_is_the_exponential_of_the_optical_depth() -> None:
    rng = np.random.default_rng(7)
    sigma_t = (10 ** rng.uniform(-4, 2, (9, 20, 30))).astype(np.float32)
    for direction in OBLIQUE:
        depth = optical_depth(sigma_t, IDENTITY, direction, near_slices=2).astype(np.float64)
        found = volillum_native.sweep(
            sigma_t, IDENTITY, direction[None], np.ones((1, 1), np.float32), near_slices=2
        )[0]
        # The exponential's own 2e-7, and its argument's: a sum of its own, in units of log 2.
        tolerance = np.exp(-depth) * (3e-7 + depth * FLOAT_TOLERANCE)
        assert np.all(np.abs(found - np.exp(-depth)) <= tolerance + 2e-38)
        assert np.all(found[depth > 88] == 0)


@pytest.mark.parametrize("weight", [1.0, -3.0, 1e30, 1e-20, -1e-37, 1e-40, 0.0])
def test_a_weight_of_any_size_scales_the_transmittance(weight: float) -> None:
    """It is folded into the exponential: what would be denormal is 0."""
    sigma_t = np.full((200, 2, 5), 0.5, np.float32)
    along = np.array([[1.0, 0, 0]])
    one, found = (
        volillum_native.sweep(sigma_t, IDENTITY, along, np.array([[w]], np.float32))
        for w in (1.0, weight)
    )
    least = float(np.finfo(np.float32).tiny)
    np.testing.assert_allclose(found, one * np.float64(weight), rtol=3e-7, atol=1.5 * least)
    assert np.all((found == 0) | (np.abs(found) >= least))


@pytest.mark.parametrize("radius", [np.inf, 1e3])
def test_sums_do_not_lose_precision_on_long_rays(radius: float) -> None:
    """1,024 slices; a plain sum in float32 errs by 6e-6 of the constant's.

    The sum of a slab joins those before it with one rounding: 128 of them, of sums half as long as
    the last on average. For a constant they may all go one way; for noise, where they cancel, four
    standard deviations are allowed, and 8 for the samples of the last slab. Rays that end keep
    pairs.
    """
    rng = np.random.default_rng(9)
    constant, noise = np.full((1024, 1, 1), 1 / 3, np.float32), rng.random((1024, 1, 1))
    for sigma_t, slabs in ((constant, 64), (noise.astype(np.float32), 4 * np.sqrt(64))):
        roundings = 8 + (slabs if radius == np.inf else 0)
        along = np.array([1.0, 0, 0])
        found = optical_depth(sigma_t, IDENTITY, along, radius=radius, near_slices=0)
        outward = np.cumsum(sigma_t[::-1].astype(np.float64), axis=0)[::-1] - 0.5 * sigma_t
        if radius != np.inf:
            outward[:-1000] -= outward[1000:]
        np.testing.assert_allclose(found, outward, rtol=roundings * 2.0**-24)


def test_a_small_depth_before_an_enormous_one_survives() -> None:
    """Sums run from the border toward the voxel, so nothing is subtracted from 10^8."""
    sigma_t = np.full((96, 5, 5), 1e6, np.float32)
    sigma_t[66:] = 0
    sigma_t[80] = 0.5
    for tilt in (0.0, 0.02):
        depth = optical_depth(sigma_t, IDENTITY, unit(1, tilt, 0))
        assert depth[70, 2, 2] == pytest.approx(
            0.5 * np.sqrt(1 + tilt**2), rel=1e-3 if tilt else 1e-6
        )
    # From the other side, and inside a window that has left the enormous part behind.
    assert optical_depth(sigma_t, IDENTITY, unit(-1, 0, 0))[20, 2, 2] > 1e7
    window = optical_depth(sigma_t[::-1].copy(), IDENTITY, unit(1, 0, 0), radius=12.0)
    np.testing.assert_allclose(window[:, 2, 2][4:14], 0.5, rtol=1e-6)
    passed = optical_depth(sigma_t, IDENTITY, unit(-1, 0, 0), radius=9.0)
    np.testing.assert_allclose(passed[81:88, 2, 2], 0.5, rtol=1e-6)


def test_empty_and_extreme_grids_stay_finite() -> None:
    zero = np.zeros((20, 33, 40), np.float32)
    directions = np.array(AXES + OBLIQUE)
    weights = np.ones((len(directions), 1), np.float32)
    assert np.all(volillum_native.sweep(zero, IDENTITY, directions, weights) == len(directions))
    huge = np.full((20, 33, 40), np.finfo(np.float32).max, np.float32)
    for quantity, world in itertools.product(
        ("transmittance", "optical_depth"), (IDENTITY, 1e6 * IDENTITY)
    ):
        found = volillum_native.sweep(huge, world, directions, weights, quantity=quantity)
        assert np.all(np.isfinite(found))
        if quantity == "transmittance":
            assert np.all(found == 0)
