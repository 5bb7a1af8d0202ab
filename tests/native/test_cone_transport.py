"""The cone transport against closed forms, quadrature along rays, and its own laws."""

from __future__ import annotations

import itertools
import math
import threading
import time
from collections.abc import Callable

import numpy as np
import pytest
from media import half_space, smooth_random
from numpy.typing import NDArray
from trilinear import Array, Ray, affine

import volillum_native
from volillum_addon.core.directions import about, cone_rule

Volume = NDArray[np.float32]
THETA = math.radians(30)
# float32 sums of a few products a step; rounding of either sign adds up as a random walk.
ROUNDING = 2e-6


def unit(*vector: float) -> Array:
    return np.array(vector) / np.linalg.norm(vector)


Z = unit(0, 0, 1)
AXES = {
    "along z": Z,
    "along -x": unit(-1, 0, 0),
    "oblique": unit(-1, 2, -3),
    "diagonal": unit(1, 1, 1),
}
AFFINES = {
    "cubes": np.diag([0.05, 0.05, 0.05, 1.0]),
    "oblong": np.diag([0.03, 0.05, 0.1, 1.0]),
    "sheared": affine(1) * 0.06,
    "mirrored": affine(2, mirrored=True) * 0.06,
}
for each in AFFINES.values():
    each[3, 3] = 1.0


def transport(
    sigma_t: Volume,
    sigma_s: Volume,
    world: Array,
    axis: Array,
    *,
    theta: float = THETA,
    count: int = 16,
    spacing: float = 1.0,
    threads: int = 0,
    directions: Array | None = None,
) -> Volume:
    """The solution [c, i, j, k] of the medium [c, i, j, k] (or [i, j, k])."""
    vectors, weights = cone_rule(theta, count)
    return volillum_native.cone_transport(
        sigma_t if sigma_t.ndim == 4 else sigma_t[None],
        sigma_s if sigma_s.ndim == 4 else sigma_s[None],
        world,
        axis,
        about(vectors, axis) if directions is None else directions,
        weights,
        spacing=spacing,
        threads=threads,
    )


def smooth(shape: tuple[int, int, int] = (14, 16, 18), depth: float = 4.0) -> Volume:
    """Smooth values for voxels of about 0.05: optical depth about `depth` across."""
    return smooth_random(shape, seed=3, depth=depth).sigma_t.values


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


@pytest.mark.parametrize("world", list(AFFINES.values()), ids=list(AFFINES))
@pytest.mark.parametrize("axis", list(AXES.values()), ids=list(AXES))
def test_every_voxel_is_written_also_over_the_transmittance(world: Array, axis: Array) -> None:
    """Voxels are written slab by slab of the lattice: none twice from its own result, none not."""
    sigma_t = smooth((23, 38, 31))[None]
    vectors, weights = cone_rule(THETA, 8)
    arguments = (sigma_t, sigma_t * np.float32(0.5), world, axis, about(vectors, axis), weights)
    seen = np.exp(-sigma_t)
    wanted = volillum_native.cone_transport(*arguments, transmittance=seen, threads=1)
    for threads in (1, 2, 3):
        out = np.full_like(seen, np.nan)
        volillum_native.cone_transport(*arguments, transmittance=seen, threads=threads, out=out)
        assert np.array_equal(out, wanted)
        out[:] = seen
        volillum_native.cone_transport(*arguments, transmittance=out, threads=threads, out=out)
        assert np.array_equal(out, wanted)


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


def test_colours_are_solved_apart() -> None:
    sigma_t = np.stack([smooth() * scale for scale in (1.0, 2.0, 0.5)]).astype(np.float32)
    sigma_s = sigma_t * np.array([0.9, 0.5, 0.99], np.float32)[:, None, None, None]
    world, axis = AFFINES["sheared"], AXES["oblique"]
    found = transport(sigma_t, sigma_s, world, axis)
    for channel in range(3):
        alone = transport(sigma_t[channel], sigma_s[channel], world, axis)
        assert np.array_equal(found[channel], alone[0])
    grey = transport(sigma_t[:1], sigma_s, world, axis)
    assert np.array_equal(grey[1], transport(sigma_t[0], sigma_s[1], world, axis)[0])


def test_a_mirrored_or_turned_grid_has_mirrored_or_turned_light() -> None:
    sigma_t = smooth((15, 16, 17))
    sigma_s = np.float32(0.7) * sigma_t
    axis = unit(0.3, -0.2, 0.9)
    vectors, weights = cone_rule(THETA, 16)
    directions = about(vectors, axis)
    world = AFFINES["cubes"]
    found = transport(sigma_t, sigma_s, world, axis, directions=directions)[0]

    def changed(matrix: Array, view: Callable[[Volume], Volume]) -> Volume:
        return volillum_native.cone_transport(
            np.ascontiguousarray(view(sigma_t))[None],
            np.ascontiguousarray(view(sigma_s))[None],
            world,
            matrix @ axis,
            np.ascontiguousarray(directions @ matrix.T),
            weights,
        )[0]

    # Lattices start from the middle of the grid and follow its axes: rounding only.
    mirrored = changed(np.diag([-1.0, 1, 1]), lambda a: a[::-1])
    np.testing.assert_allclose(mirrored[::-1], found, atol=2e-6)
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    turned = changed(turn, lambda a: np.rot90(a, 1, (0, 1)))
    np.testing.assert_allclose(np.rot90(turned, -1, (0, 1)), found, atol=1e-3)


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


def test_local_weights_that_are_the_same_everywhere_are_weights() -> None:
    sigma_t = smooth((14, 20, 18))[None]
    sigma_s = np.float32(0.8) * sigma_t
    axis = unit(-1, 2, 3)
    vectors, weights = cone_rule(THETA, 16)
    directions = about(vectors, axis)
    arguments = (sigma_t, sigma_s, AFFINES["sheared"], axis, directions)
    nodes = np.tile(weights[:, None, None, None].astype(np.float32), (1, 3, 4, 4))
    local = volillum_native.cone_transport(
        *arguments, nodes, node_spacing=7, lamp=1e3 * axis, threads=1
    )
    assert np.abs(local - volillum_native.cone_transport(*arguments, weights)).max() < ROUNDING
    threaded = volillum_native.cone_transport(
        *arguments, nodes, node_spacing=7, lamp=1e3 * axis, threads=3
    )
    assert np.array_equal(local, threaded)


@pytest.mark.parametrize("shape", [(1, 1, 1), (1, 1, 50), (2, 33, 1), (5, 3, 2)])
@pytest.mark.parametrize("axis", list(AXES.values()), ids=list(AXES))
def test_small_grids_and_any_number_of_threads(shape: tuple[int, int, int], axis: Array) -> None:
    sigma_t = np.random.default_rng(3).random(shape, dtype=np.float32)
    sigma_s = np.float32(0.9) * sigma_t
    one = transport(sigma_t, sigma_s, affine(4), axis, threads=1)
    assert np.all(np.isfinite(one))
    assert np.array_equal(one, transport(sigma_t, sigma_s, affine(4), axis, threads=3))


def test_threads_change_no_bit() -> None:
    sigma_t = smooth((40, 41, 42))
    sigma_s = np.float32(0.9) * sigma_t
    fields = [
        transport(sigma_t, sigma_s, AFFINES["sheared"], AXES["oblique"], threads=threads)
        for threads in (1, 2, 5)
    ]
    assert np.array_equal(fields[0], fields[1])
    assert np.array_equal(fields[0], fields[2])


def test_cancelling_stops_every_thread() -> None:
    sigma_t = np.full((1, 160, 160, 160), 0.01, np.float32)
    vectors, weights = cone_rule(THETA, 64)
    control = volillum_native.Control()
    caught: list[BaseException] = []

    def work() -> None:
        try:
            volillum_native.cone_transport(
                sigma_t, sigma_t, np.eye(4), Z, vectors, weights, threads=3, control=control
            )
        except volillum_native.Cancelled as error:
            caught.append(error)

    thread = threading.Thread(target=work)
    thread.start()
    while control.progress == 0 and thread.is_alive():
        time.sleep(0.001)
    control.cancel()
    thread.join(timeout=30)
    assert not thread.is_alive()
    assert caught


def test_bad_input_is_refused_in_plain_words() -> None:
    sigma = np.ones((1, 3, 3, 3), np.float32)
    good = {
        "sigma_t": sigma,
        "sigma_s": sigma,
        "index_to_world": np.eye(4),
        "axis": Z,
        "directions": Z[None],
        "weights": np.ones(1),
    }
    for change, message in [
        ({"sigma_s": sigma[:, :2].copy()}, "sigma_s has shape"),
        ({"sigma_t": np.ones((2, 3, 3, 3), np.float32)}, "sigma_t has shape"),
        ({"axis": 2 * Z}, "expected a unit vector"),
        ({"directions": -Z[None]}, "cosine"),
        ({"directions": 0.5 * Z[None]}, "direction 0 has length"),
        ({"weights": np.array([0.5])}, "weights sum to 0.5"),
        ({"weights": np.array([-1.0])}, "weight 0 is"),
        ({"spacing": 0.0}, "spacing is 0"),
        ({"weights": np.ones((1, 1, 2, 2), np.float32), "node_spacing": 2}, "nodes every 2"),
        ({"weights": np.ones((1, 3, 3, 3), np.float32), "node_spacing": 0}, "node_spacing is 0"),
        ({"lamp": np.zeros(2)}, "lamp has shape"),
        ({"index_to_world": np.zeros((4, 4))}, "invertible affine"),
        ({"out": sigma}, "out shares memory with sigma_t"),
        ({"out": sigma.copy()[:, 1:]}, "out has shape"),
    ]:
        with pytest.raises(ValueError, match=message):
            volillum_native.cone_transport(**{**good, **change})
    with pytest.raises(TypeError, match="sigma_t has another type"):
        volillum_native.cone_transport(**{**good, "sigma_t": sigma.astype(np.float64)})
