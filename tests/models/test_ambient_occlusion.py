"""Ambient occlusion: its closed forms, its bounds, bleeding, and the occlusion it approximates."""

from __future__ import annotations

import math

import numpy as np
import pytest
from media import smooth_random

import volillum_native
from volillum_addon.core.directions import sphere_rule
from volillum_addon.core.grid import Grid
from volillum_addon.core.lights import (
    AreaLight,
    DistantLight,
    EnvironmentLight,
    Light,
    PointLight,
    SpotLight,
)
from volillum_addon.core.medium import Medium
from volillum_addon.core.scene import Scene
from volillum_addon.models.ambient_occlusion import DEFAULT_RADIUS_VOXELS
from volillum_addon.models.exact import exact
from volillum_addon.models.illuminate import bake, relight
from volillum_addon.models.registry import get

MODEL = "ambient_occlusion"
# A world of this radiance has F / (4 pi) = 1.
SKY = EnvironmentLight(1.0)
# One rounding to float32, and of the transforms in float32, of values of about 1.
ROUNDING = 1e-6


def cube(sigma_t: float, voxels: int, spacing: float, albedo: object = 1.0) -> Medium:
    values = np.full((voxels,) * 3, sigma_t, np.float32)
    grid = Grid(values, np.diag([spacing, spacing, spacing, 1.0]), "cube")
    return Medium.from_density(grid, 1.0, albedo)  # type: ignore[arg-type]


def middle(grid: Grid) -> np.ndarray:
    return np.asarray(grid.values[tuple(n // 2 for n in grid.shape)])


@pytest.mark.parametrize("weight_p", [0, 1, 2])
def test_linear_sum_of_a_homogeneous_medium_is_its_optical_depth(weight_p: int) -> None:
    """Case G1: sigma 0.7, R 0.9; the printed integral 2 pi sigma R^2 over 2 pi R."""
    volume = bake(
        Scene(cube(0.7, 27, 0.1), (SKY,)), MODEL, radius=0.9, opacity="linear", weight_p=weight_p
    )
    assert middle(volume.channels["openness"]) == pytest.approx(1 - 0.63, abs=5 * ROUNDING)
    printed = (1 - middle(volume.channels["openness"])) * 2 * math.pi * 0.9
    assert printed == pytest.approx(3.562566069170826, rel=1e-5)


def test_bounded_sum_of_a_homogeneous_medium_is_its_opacity() -> None:
    volume = bake(Scene(cube(3.0, 27, 0.1), (SKY,)), MODEL, radius=0.9)
    assert middle(volume.in_scattered()) == pytest.approx([math.exp(-0.3)] * 3, abs=ROUNDING)


def test_a_plane_face() -> None:
    """Case G2 at the face itself, whose ramp of one voxel is odd about it: exact there but for the
    curvature of the sum, R^2 / 12 voxels squared at most."""
    radius, spacing = 0.9, 0.06
    values = np.zeros((33, 33, 40), np.float32)
    values[..., :20] = 0.7
    affine = np.diag([spacing, spacing, spacing, 1.0])
    medium = Medium(*(Grid(values, affine),) * 2)
    volume = bake(Scene(medium, (SKY,)), MODEL, radius=radius, opacity="linear")
    grid = volume.channels["openness"]
    # The face lies half a voxel beyond the last full one: the mean of its two neighbours.
    row = grid.values[grid.shape[0] // 2, grid.shape[1] // 2]
    at = grid.to_index(np.array([0, 0, 19 * spacing]))[2]
    face = (row[round(at)] + row[round(at) + 1]) / 2
    printed = (1 - face) * 2 * math.pi * radius
    assert printed == pytest.approx(1.7812830345854131, rel=(spacing / radius) ** 2)


def test_openness_stays_between_its_bounds() -> None:
    rng = np.random.default_rng(1)
    values = np.where(rng.random((20, 20, 20)) < 0.3, 1e6, 1e-6).astype(np.float32)
    grid = Grid(values, np.eye(4))
    openness = bake(Scene(Medium(grid, grid), (SKY,)), MODEL).channels["openness"].values
    assert openness.min() >= 0
    assert openness.max() <= 1


def test_more_matter_is_darker() -> None:
    thin = smooth_random((14, 12, 13), seed=2)
    dense = Medium(*(thin.sigma_t.with_values(thin.sigma_t.values * np.float32(1.5)),) * 2)
    light, dark = (
        bake(Scene(medium, (SKY,)), MODEL, radius=0.3).channels["openness"].values
        for medium in (thin, dense)
    )
    assert (dark <= light + ROUNDING).all()


def test_it_is_the_first_order_of_the_mean_occlusion() -> None:
    """Property 7: for p = 2, 0 <= T - AO <= <T^2> / 2, AO the mean of 1 - exp(-od) within R."""
    medium = smooth_random((14, 12, 13), seed=3, depth=3.0)
    radius = 0.35
    openness = bake(Scene(medium, (SKY,)), MODEL, radius=radius, weight_p=2, opacity="linear")
    grid = openness.channels["openness"]
    directions, weights = sphere_rule(512)
    near = max(grid.shape)
    planes = openness.medium.sigma_t.planes()[0]
    moments = np.zeros((3, *grid.shape))
    for direction, weight in zip(directions, weights, strict=True):
        depth = volillum_native.sweep(
            planes, grid.index_to_world, np.ascontiguousarray(direction[None]),
            np.ones((1, 1), np.float32), radius=radius, near_slices=near, quantity="optical_depth",
        )[0].astype(np.float64)  # fmt: skip
        moments += weight * np.stack([depth, -np.expm1(-depth), depth**2])
    depth, occlusion, square = moments
    first_order = 1 - grid.values
    # 512 directions on a smooth medium, but radii of 5 voxels end in cells with kinks.
    slack = 2e-3 * depth.max()
    assert np.abs(first_order - depth).max() < slack
    gap = first_order - occlusion
    assert (gap > -slack).all()
    assert (gap < square / 2 + slack).all()


def test_bleeding_of_one_albedo_is_the_occlusion_tinted() -> None:
    albedo = (0.9, 0.5, 0.2)
    volume = bake(Scene(cube(3.0, 27, 0.1, albedo), (SKY,)), MODEL, radius=0.9, bleeding=0.5)
    occlusion = 1 - math.exp(-0.3)
    expected = [1 - occlusion + 0.5 * occlusion * each for each in albedo]
    assert middle(volume.in_scattered()) == pytest.approx(expected, abs=2 * ROUNDING)


@pytest.mark.parametrize("opacity", ["bounded", "linear"])
def test_bleeding_of_varying_albedo_is_the_sum_of_the_neighbours_colour(opacity: str) -> None:
    """Against the occlusion of other media: bleeding is a sum over coloured matter alone."""
    medium = smooth_random((11, 12, 13), seed=4)
    red = np.zeros((*medium.sigma_t.shape, 3), np.float32)
    red[:6, ..., 0] = medium.sigma_t.values[:6] * np.float32(0.7)
    red[6:, ..., 2] = medium.sigma_t.values[6:]
    coloured = Medium(medium.sigma_t, medium.sigma_t.with_values(red))
    given = {"radius": 0.3, "opacity": opacity}
    found = bake(Scene(coloured, (SKY,)), MODEL, bleeding=1.0, **given).channels["bleeding"]
    half = medium.sigma_t.values.copy()
    half[6:] = 0
    trimmed = bake(Scene(medium, (SKY,)), MODEL, **given).medium.sigma_t
    offset = np.rint(medium.sigma_t.to_index(trimmed.to_world(np.zeros(3)))).astype(int)
    low = (int(offset[0]), int(offset[1]), int(offset[2]))
    high = tuple(a + n for a, n in zip(low, trimmed.shape, strict=True))
    part = medium.sigma_t.with_values(half).crop(low, high)  # type: ignore[arg-type]
    # A mark too faint to count keeps the crop's lattice.
    corners = part.values.copy()
    corners[0, 0, 0] = corners[-1, -1, -1] = 1e-20
    alone = bake(Scene(Medium(*(part.with_values(corners),) * 2), (SKY,)), MODEL, **given)
    occlusion = (
        1 - alone.channels["openness"].crop((2, 2, 2), tuple(n + 2 for n in part.shape)).values
    )  # type: ignore[arg-type]
    scale = max(1.0, float(occlusion.max()))
    assert np.allclose(found.values[..., 0], 0.7 * occlusion, rtol=0, atol=3 * ROUNDING * scale)
    assert not found.values[..., 1].any()


def test_bleeding_of_black_matter_is_not_computed() -> None:
    medium = cube(3.0, 9, 0.1, 0.0)
    volume = bake(Scene(medium, (SKY,)), MODEL, bleeding=1.0)
    assert list(volume.channels) == ["openness"]
    assert len(volume.radiance) == 1


def test_chromatic_extinction_has_an_openness_for_each_channel() -> None:
    medium = smooth_random((10, 9, 8), seed=5)
    scales = np.array([0.5, 1.0, 2.0], np.float32)
    wide = medium.sigma_t.with_values(medium.sigma_t.values[..., None] * scales)
    given = {"radius": 0.4, "opacity": "linear"}
    found = bake(Scene(Medium(wide, wide), (SKY,)), MODEL, **given).channels["openness"].values
    alone = bake(Scene(medium, (SKY,)), MODEL, **given).channels["openness"].values
    for channel, scale in enumerate(scales):
        assert np.allclose(1 - found[..., channel], (1 - alone) * scale, atol=5 * ROUNDING)


def test_the_default_radius_is_twelve_voxels_of_the_grid() -> None:
    medium = smooth_random((9, 10, 11), seed=6)
    sheared = np.array(medium.sigma_t.index_to_world)
    sheared[0, 1], sheared[1, 1] = 0.05, 0.2
    medium = Medium(*(Grid(medium.sigma_t.values, sheared),) * 2)
    scene = Scene(medium, (SKY,))
    voxel = abs(np.linalg.det(sheared[:3, :3])) ** (1 / 3)
    given = bake(scene, MODEL, radius=DEFAULT_RADIUS_VOXELS * voxel)
    default = bake(scene, MODEL)
    assert np.array_equal(given.channels["openness"].values, default.channels["openness"].values)
    row = get(MODEL).operator_in(scene, default.parameters)
    assert row.radius == pytest.approx(DEFAULT_RADIUS_VOXELS * voxel)
    assert row.reference_length == pytest.approx(voxel)


@pytest.mark.parametrize("opacity", ["bounded", "linear"])
@pytest.mark.parametrize("weight_p", [1, 2])
def test_the_open_half_is_what_the_judge_finds(opacity: str, weight_p: int) -> None:
    """Chromatic, sheared, with bleeding; at voxels with and without a gradient.

    In front of a voxel at distance r, its share of the half space is off by 0.01 for its shape and
    by p / 6 r^2 for the weight's fall (test_hemisphere.py). Such voxels are those along the plane,
    1 / R of all, and both errors change sign across it: far below a hundredth of the occlusion.
    """
    medium = smooth_random((14, 12, 13), seed=9, depth=3.0)
    affine = np.array(medium.sigma_t.index_to_world)
    affine[0, 1] = 0.3 * affine[0, 0]
    values = medium.sigma_t.values.copy()
    values[4:9, 4:9, 4:9] = values[6, 6, 6]
    grid = Grid(values[..., None] * np.array([1.0, 0.5, 2.0], np.float32), affine)
    sigma_s = grid.with_values(grid.values * np.array([0.9, 0.3, 0.5], np.float32))
    scene = Scene(Medium(grid, sigma_s), (SKY,))
    radius = 5 * float(medium.sigma_t.voxel_size.mean())
    given = {"radius": radius, "weight_p": weight_p, "opacity": opacity, "bleeding": 0.5}
    volume = bake(scene, MODEL, neighbourhood="hemisphere", **given)
    lattice = volume.medium.sigma_t
    index = np.random.default_rng(1).integers(2, np.array(lattice.shape) - 2, (200, 3))
    offset = np.rint(lattice.to_index(grid.to_world(np.array([6.0, 6, 6])))).astype(int)
    index[:8] = offset
    points = lattice.to_world(index.astype(np.float64))
    truth = exact(scene, MODEL, points, 4096, clamped=False, neighbourhood="hemisphere", **given)
    found = volume.in_scattered(clamped=False).values[tuple(index.T)]
    occlusion = np.abs(1 - truth.value).max()
    assert np.abs(found - truth.value).max() < 0.01 * occlusion + 7 * truth.standard_error.max()
    whole = bake(scene, MODEL, **given).in_scattered(clamped=False).values[tuple(index.T)]
    assert np.abs(whole - found)[8:].max() > 0.1 * occlusion
    assert np.allclose(whole[:8], found[:8], atol=2 * ROUNDING * occlusion)


@pytest.mark.parametrize(
    "light",
    [
        DistantLight((0, 0.6, 0.8), (1.0, 0.5, 0.2)),
        PointLight((5.0, 4.0, 3.0), (10.0, 20.0, 5.0)),
        SpotLight((0.5, 0.4, 4.0), (0.0, 0.0, -1.0), 3.0),
        AreaLight((0.5, 0.4, 4.0), (0.0, 0.0, -1.0), 3.0),
        SKY,
    ],
    ids=lambda light: light.kind,
)
def test_every_light_counts_by_its_fluence(light: Light) -> None:
    medium = smooth_random((8, 9, 10), seed=7)
    volume = bake(Scene(medium, (light,)), MODEL)
    expected = light.fluence(volume.medium.sigma_t.centre) / (4 * math.pi)
    assert expected.max() > 0
    openness = volume.channels["openness"].values[..., None]
    assert np.allclose(volume.in_scattered().values, openness * expected, rtol=1e-6)
    twice = relight(volume, (light, light)).in_scattered().values
    assert np.allclose(twice, 2 * volume.in_scattered().values, rtol=1e-6)


def test_opposite_units_give_the_same() -> None:
    """V(sigma_t, h) = V(sigma_t / s, s h)."""
    medium = smooth_random((9, 8, 10), seed=8)
    affine = medium.sigma_t.index_to_world @ np.diag([100.0, 100.0, 100.0, 1.0])
    wide = Medium(*(Grid(medium.sigma_t.values / np.float32(100), affine),) * 2)
    near, far = (
        bake(Scene(each, (SKY,)), MODEL, radius=radius, opacity="linear").channels["openness"]
        for each, radius in ((medium, 0.4), (wide, 40.0))
    )
    assert np.allclose(near.values, far.values, atol=5 * ROUNDING)
