"""The cone transport against closed forms and quadrature along rays."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from cone_marches import AFFINES, AXES, ROUNDING, THETA, Volume, Z, smooth, transport, unit
from media import half_space
from trilinear import Array, Ray

import volillum_native
from volillum_addon.core.directions import about, cone_rule


@pytest.mark.parametrize("world", list(AFFINES.values()), ids=list(AFFINES))
@pytest.mark.parametrize("axis", list(AXES.values()), ids=list(AXES))
@pytest.mark.parametrize("theta", [1, 30, 60, 85])
@pytest.mark.parametrize("depth", [4.0, 1e3, 1e8])
def test_without_absorption_all_light_arrives_everywhere(
    world: Array, axis: Array, theta: int, depth: float
) -> None:
    """The furnace: L_i = 1 at any depth and any step, and at hard edges."""
    sigma_t = smooth(depth=depth)
    sigma_t[5:8, :, 4:9] = 0
    sigma_t[9, 9, :] *= 100
    found = transport(sigma_t, sigma_t, world, axis, theta=math.radians(theta), count=8)
    assert np.abs(found - 1).max() < ROUNDING


@pytest.mark.parametrize("axis", list(AXES.values()), ids=list(AXES))
def test_opaque_voxels_stay_within_bounds(axis: Array) -> None:
    rng = np.random.default_rng(2)
    sigma_t = (10 ** rng.uniform(-6, 6, (12, 17, 13))).astype(np.float32)
    sigma_t[rng.random(sigma_t.shape) < 0.3] = 0
    for albedo in (0.0, 0.5, 0.999):
        sigma_s = sigma_t * rng.uniform(0, albedo, sigma_t.shape).astype(np.float32)
        found = transport(sigma_t, sigma_s, np.eye(4), axis, theta=math.radians(50))
        assert np.all(np.isfinite(found))
        assert found.min() >= 0
        assert found.max() <= 1 + ROUNDING
    huge = np.full((5, 6, 7), np.finfo(np.float32).max, np.float32)
    for sigma_s in (huge, 0 * huge, 0.5 * huge):
        found = transport(huge, sigma_s, np.diag([1e6, 1e6, 1e6, 1.0]), axis)
        assert np.all(np.isfinite(found))
    assert np.all(transport(0 * huge, 0 * huge, np.eye(4), axis) == pytest.approx(1, abs=ROUNDING))


@pytest.mark.parametrize("world", list(AFFINES.values()), ids=list(AFFINES))
def test_without_scattering_it_is_the_mean_transmittance(world: Array) -> None:
    """Against exact optical depths along every ray of the rule."""
    sigma_t = smooth((30, 31, 32), depth=1.5)
    axis = unit(-1, 2, -3)
    vectors, weights = cone_rule(THETA, 16)
    found = transport(sigma_t, 0 * sigma_t, world, axis)[0]
    truth, values = [], []
    for voxel in np.random.default_rng(1).integers(0, sigma_t.shape, (40, 3)):
        origin = world[:3, :3] @ voxel + world[:3, 3]
        depths = [
            Ray(sigma_t.shape, world, origin, direction).optical_depth(sigma_t)
            for direction in about(vectors, axis)
        ]
        truth.append(float(weights @ np.exp(-np.array(depths))))
        values.append(found[tuple(voxel)])
    error = np.sqrt(np.mean((np.array(values) - truth) ** 2) / np.mean(np.square(truth)))
    # Second order: linear interpolation of waves of 8 voxels is off by (2 pi / 8)^2 / 8 = 0.08 of
    # their optical depth, a few tenths, and rays of several directions average it.
    assert error < 0.02


D1 = {
    (0.9, 30): (0.9477534142, 0.898264571, 0.8069449955, 0.6512612281),
    (0.9, 60): (0.9337674356, 0.8728157913, 0.7635947852, 0.5852932619),
    (0.99, 30): (0.9946482485, 0.9893280927, 0.9787774348, 0.9580182931),
}


@pytest.mark.parametrize(("albedo", "degrees"), list(D1))
@pytest.mark.parametrize(("place", "depth"), list(enumerate((0.5, 1.0, 2.0, 4.0))))
def test_half_space(albedo: float, degrees: int, place: int, depth: float) -> None:
    """Case D1, the Volterra equation, at 128 slices: the angular rule has converged."""
    medium, point = half_space(depth, slices=128)
    sigma_t = medium.sigma_t.values
    found = transport(
        sigma_t,
        sigma_t * np.float32(albedo),
        medium.sigma_t.index_to_world,
        Z,
        theta=math.radians(degrees),
        count=64,
    )[0]
    index = tuple(np.rint(medium.sigma_t.to_index(point)).astype(int))
    # A step is 1/32 deep at most: second order errors of a few (1/32)^2 / 12, and rounding.
    assert found[index] == pytest.approx(D1[albedo, degrees][place], rel=3e-5)


def test_coarse_steps_are_good_too() -> None:
    """D1 at optical depth 4 in steps of half a mean free path: second order, small constant."""
    errors = []
    for slices in (8, 16, 32, 64):
        medium, point = half_space(4.0, slices)
        sigma_t = medium.sigma_t.values
        world = medium.sigma_t.index_to_world
        found = transport(sigma_t, sigma_t * np.float32(0.9), world, Z, count=64)[0]
        index = tuple(np.rint(medium.sigma_t.to_index(point)).astype(int))
        errors.append(abs(float(found[index]) / 0.6512612281 - 1))
    assert errors[0] < 1e-3
    assert errors[-1] < errors[0] / 10


def blob(size: int) -> tuple[Volume, Array]:
    """A Gaussian on the cube [-1, 1]^3, `size` + 1 voxels along an edge; 0 at the border, where
    the medium would otherwise depend on the voxel size."""
    axis = np.linspace(-1, 1, size + 1)
    squares = axis[:, None, None] ** 2 + 1.3 * axis[:, None] ** 2 + 0.8 * axis**2
    ends = 1 - axis**2
    world = np.diag([2 / size] * 3 + [1.0])
    world[:3, 3] = -1
    window = ends[:, None, None] * ends[:, None] * ends
    return (4 * window * np.exp(-3 * squares)).astype(np.float32), world


@pytest.mark.parametrize("axis", [AXES["along z"], AXES["oblique"]], ids=["along z", "oblique"])
@pytest.mark.parametrize("degrees", [30, 75])
def test_second_order_of_convergence(axis: Array, degrees: int) -> None:
    fields = []
    for size in (16, 32, 64, 128):
        sigma_t, world = blob(size)
        found = transport(
            sigma_t, np.float32(0.8) * sigma_t, world, axis, theta=math.radians(degrees)
        )[0]
        step = size // 16
        fields.append(found[::step, ::step, ::step].astype(np.float64))
    steps = [np.sqrt(np.mean((b - a) ** 2)) for a, b in itertools.pairwise(fields)]
    # Halving the voxel quarters the difference. How far lattice points are from voxels, which says
    # how much they are interpolated, differs from grid to grid: hence the margin.
    assert steps[1] / steps[2] > 3.4, steps
    assert steps[0] / steps[2] > 10, steps


def test_with_exact_transmittance_it_follows_hard_surfaces() -> None:
    """A better transmittance is taken over: all of it where nothing scatters, and the furnace."""
    rng = np.random.default_rng(4)
    sigma_t = (rng.random((16, 17, 18)) < 0.2).astype(np.float32) * 3
    axis = unit(1, 2, 3)
    vectors, weights = cone_rule(THETA, 16)
    directions = about(vectors, axis)
    seen = volillum_native.sweep(
        sigma_t, np.eye(4), directions, weights[:, None].astype(np.float32), near_slices=4
    )

    def solved(albedo: float) -> Volume:
        return volillum_native.cone_transport(
            sigma_t[None],
            np.float32(albedo) * sigma_t[None],
            np.eye(4),
            axis,
            directions,
            weights,
            transmittance=seen,
        )

    assert np.abs(solved(1.0) - 1).max() < ROUNDING
    # 1e-5: below that share the lattice does not say how much of the met light is lost.
    assert np.abs(solved(0.0) - seen).max() < 2e-5
    half = solved(0.5)
    assert np.all(half >= seen - ROUNDING)
    assert half.max() <= 1 + ROUNDING


def test_a_narrow_cone_leaves_the_absorption() -> None:
    """Theta -> 0: L_i = exp(-integral of sigma_a), whatever the scattering."""
    rng = np.random.default_rng(5)
    albedo = np.linspace(0.2, 0.9, 12, dtype=np.float32)[:, None, None]
    sigma_t = np.repeat(rng.random((12, 12, 1), dtype=np.float32), 40, axis=2)
    sigma_s = sigma_t * albedo
    found = transport(sigma_t, sigma_s, AFFINES["cubes"], Z, theta=1e-6, count=4)[0]
    sigma_a = (sigma_t - sigma_s).astype(np.float64)
    cubes = np.diag(AFFINES["cubes"])[2]
    above = cubes * (np.cumsum(sigma_a[:, :, ::-1], axis=2)[:, :, ::-1] - 0.5 * sigma_a)
    # Steps of up to 0.1: each is off by albedo (1 - albedo) 0.1^3 / 12 at most, and there are 40.
    np.testing.assert_allclose(found, np.exp(-above), rtol=8e-4)


@pytest.mark.parametrize("second", [unit(1, 0, 0), unit(0, 1, 1)], ids=["to x", "to yz"])
def test_a_turning_light_makes_no_jump(second: Array) -> None:
    """Between any two axes the solution changes as smoothly as the light turns."""
    sigma_t = smooth((18, 19, 20))
    sigma_s = np.float32(0.8) * sigma_t
    angles = np.radians(np.arange(40.0, 50.01, 0.5))
    across = second - (second @ Z) * Z
    across /= np.linalg.norm(across)
    fields = [
        transport(sigma_t, sigma_s, AFFINES["cubes"], np.cos(a) * Z + np.sin(a) * across)[0]
        for a in angles
    ]
    steps = [float(np.sqrt(np.mean((b - a) ** 2))) for a, b in itertools.pairwise(fields)]
    # Equal turns make about equal changes; a jump would stand out.
    assert max(steps) < 2.0 * float(np.median(steps)), steps


@pytest.mark.parametrize("world", list(AFFINES.values()), ids=list(AFFINES))
@pytest.mark.parametrize("shape", [(6, 7, 8), (7, 9, 1)], ids=["block", "sheet"])
def test_a_light_that_crosses_a_diagonal_makes_no_jump(
    world: Array, shape: tuple[int, int, int]
) -> None:
    """A hard medium, whose lattice would show: turned by 2e-6 it changes by some 1e-5."""
    sigma_t = np.random.default_rng(3).choice(np.array([0, 1, 1e3], np.float32), shape)
    sigma_s = np.float32(0.8) * sigma_t
    edges = world[:3, :3] / np.linalg.norm(world[:3, :3], axis=0)
    for tie in itertools.product((-1.0, 0.0, 1.0), repeat=3):
        if not any(tie):
            continue
        axis = unit(*(edges @ tie))
        across = np.cross(axis, unit(0.36, 0.48, -0.8))
        one, two = (
            transport(sigma_t, sigma_s, world, unit(*(axis + turn * across)))
            for turn in (1e-6, -1e-6)
        )
        assert np.sqrt(np.mean((one - two) ** 2)) < 1e-4


@pytest.mark.parametrize("albedo", [0.0, 0.5])
def test_rays_end_on_the_plane_through_the_lamp(albedo: float) -> None:
    """One direction in a homogeneous block: exp(-sigma_a times the way to the lamp's plane)."""
    sigma_t = np.full((1, 9, 10, 41), 1.2, np.float32)
    for lamp in (20.3, 20.0, -3.0, 60.0):
        found = volillum_native.cone_transport(
            sigma_t, np.float32(albedo) * sigma_t, np.diag([0.05, 0.05, 0.05, 1.0]), Z, Z[None],
            np.ones((1, 2, 2, 2), np.float32), node_spacing=64,
            lamp=np.array([0.2, 0.2, 0.05 * lamp]),
        )[0, 4, 5]  # fmt: skip
        # The block ends half a voxel beyond its last (the interpolant's fall to zero).
        way = np.clip(min(lamp, 40.5) - np.arange(41), 0, None) * 0.05
        # Steps of 0.06: each is off by albedo (1 - albedo) 0.06^3 / 12 at most, and there are 40.
        np.testing.assert_allclose(found, np.exp(-(1 - albedo) * 1.2 * way), rtol=3e-4)
