"""Photon mapping: closed forms of the full equation, every light, and what its errors say."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from media import SIDEWAYS, ball, smooth_random
from numpy.typing import NDArray

from volillum_addon.core.errors import InputError
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
from volillum_addon.models.exact import exact
from volillum_addon.models.illuminate import bake, relight
from volillum_addon.models.photon_lights import image_rule
from volillum_addon.models.progressive import photon_state, refine
from volillum_addon.models.volume import IlluminationVolume

MODEL = "photon_mapping"
MEDIUM = replace(
    smooth := smooth_random((11, 10, 12), 3, depth=4.0),
    sigma_s=smooth.sigma_t.with_values(smooth.sigma_t.values * np.float32(0.9)),
)
SKY = EnvironmentLight(1.0)
# 4.5 standard errors of 16 passes (t with 15 degrees of freedom): one in 2000.
LIMIT = 4.5


def light_of(volume: IlluminationVolume) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """In-scattered radiance and its standard error, [i, j, k, 3]."""
    error = volume.channels["standard_error"].values.astype(np.float64)
    return volume.in_scattered().values.astype(np.float64), (
        error if error.ndim == 4 else error[..., None]
    )


def replicates(scene: Scene, count: int, **parameters: object) -> NDArray[np.float64]:
    """Whole bakes with different seeds: independent, whatever voxels share.

    16 slices near each voxel integrated exactly: nearly all of this small medium.
    """
    parameters = {"near": 16, "photons": 4000, **parameters}
    return np.array(
        [bake(scene, MODEL, noise_seed=seed, **parameters).in_scattered().values
         for seed in range(count)], np.float64
    )  # fmt: skip


def same_mean(first: NDArray[np.float64], second: NDArray[np.float64], slack: float = 0.0) -> None:
    """Two sets of replicates [r, ...] of fields agree: their mean over voxels, and each voxel.

    `slack` is what quadrature of unscattered light may add, a share of the mean.
    """
    for average in (True, False):
        a, b = ((x.reshape(len(x), -1).mean(1, keepdims=True) if average else x)
                for x in (first, second))  # fmt: skip
        error = np.sqrt(a.var(0, ddof=1) / len(a) + b.var(0, ddof=1) / len(b))
        allowed = slack * b.mean() + (LIMIT if average else 8.0) * error
        # 8: voxels are thousands, degrees of freedom about 14.
        assert np.all(np.abs(a.mean(0) - b.mean(0)) <= allowed)


@pytest.mark.parametrize(
    ("albedo", "depth", "top", "middle", "bottom"),
    [
        (0.9, 1.0, 0.12710151858, 0.11768640672, 0.06583271741),
        (0.5, 2.0, 0.09929185090, 0.05215567650, 0.01856152379),
        (1.0, 4.0, 0.18879084570, 0.18849215842, 0.04210537478),
    ],
)
def test_slab_under_a_sun(
    albedo: float, depth: float, top: float, middle: float, bottom: float
) -> None:
    """Case H1: J of a slab for the irradiance 1, at both faces and in the middle.

    31 slices: the mean of J over the middle one differs from its centre by h^2 J'' / 24 < 1e-4 J.
    The voxels two beyond the slab are void and hold J of its faces.
    """
    slices = 31
    step = depth / slices
    grid = Grid(
        np.ones((3, 3, slices), np.float32), np.diag([SIDEWAYS, SIDEWAYS, step, 1.0]), "slab"
    )
    medium = Medium.from_density(grid, 1.0, albedo)
    volume = bake(Scene(medium, (DistantLight((0, 0, 1), 1.0),)), MODEL, photons=60_000)
    value, error = light_of(volume)
    middle_column = (3, 3)  # index 1 of the slab, after the margin of 2
    for k, truth in ((slices + 3, top), (2 + slices // 2, middle), (0, bottom)):
        place = (*middle_column, k)
        assert abs(value[place][0] - truth) < LIMIT * error[place][0] + 1e-4 * truth
        # In the void beyond a face lengths go as 1 / cosine: their variance has a long tail.
        assert error[place][0] < 0.02 * truth


@pytest.mark.parametrize(
    ("albedo", "optical", "centre", "halfway"),
    [(0.9, 2.0, 0.7163032038, 0.754497651), (0.5, 1.0, 0.5608345735, 0.6040005551)],
)
def test_sphere_under_an_even_sky(
    albedo: float, optical: float, centre: float, halfway: float
) -> None:
    """Case H8. The ball's surface is blurred over a voxel, 1 / 12 of its radius: that changes its
    optical radius by second order, (1 / 12)^2 / 6 of it, and J by less than 0.3 %."""
    radius = 12.0
    medium = ball(radius, optical)
    medium = Medium.from_density(medium.sigma_t, 1.0, albedo)
    volume = bake(Scene(medium, (SKY,)), MODEL, photons=60_000)
    value, _ = light_of(volume)
    lattice = volume.medium.sigma_t
    index = np.stack(np.meshgrid(*map(np.arange, lattice.shape), indexing="ij"), -1)
    distance = np.linalg.norm(lattice.to_world(index.astype(np.float64)), axis=-1)
    seeds = replicates(Scene(medium, (SKY,)), 6, photons=20_000)[..., 0]
    for low, high, truth in ((0.0, 0.09, centre), (0.47, 0.53, halfway)):
        shell = (distance >= low) & (distance < high)
        noise = seeds[:, shell].mean(axis=1).std(ddof=1) / math.sqrt(5)  # 5 x the photons
        # 5 degrees of freedom: 5 standard errors is one in 200, of four.
        assert abs(value[shell].mean() - truth) < 5 * noise + 3e-3 * truth


def test_point_source_in_an_endless_medium() -> None:
    """Case H6, albedo 0.9: fluence 4 pi J of a lamp of power 1 at distances 1, 2 and 4.

    The cube reaches 8 mean free paths from the lamp; what comes back from further out is below
    exp(-2 (8 - 4) 0.525) / 8 of the light there, 0.2 % (0.525: the diffusion length's inverse).
    """
    half, step = 16, 0.5
    affine = np.diag([step, step, step, 1.0])
    affine[:3, 3] = -half * step
    grid = Grid(np.ones((2 * half + 1,) * 3, np.float32), affine, "endless")
    medium = Medium.from_density(grid, 1.0, 0.9)
    lamp = PointLight((0, 0, 0), 1 / (4 * math.pi))
    volume = bake(Scene(medium, (lamp,)), MODEL, photons=60_000)
    value, error = light_of(volume)
    middle = half + 2
    for distance, truth in ((1, 0.1432838615), (2, 0.03712639932), (4, 0.006194053037)):
        shift = round(distance / step)
        found, noise = [], []
        for axis in range(3):
            for side in (-1, 1):
                place = [middle] * 3
                place[axis] += side * shift
                found.append(4 * math.pi * value[(*place, 0)])
                noise.append(4 * math.pi * error[(*place, 0)])
        # Scattered light near the lamp is about c / r, whose Laplacian is 0: its mean over a voxel
        # is its value but for h^2 / 24 J'' / J < 1 %, at distance 1.
        allowed = LIMIT * np.sqrt(np.mean(np.square(noise)) / 6) + truth * (
            0.01 / distance**2 + 2e-3
        )
        assert abs(np.mean(found) - truth) < allowed


def test_thermal_furnace() -> None:
    """Sky 1 and an emission of sigma_a times 1: J = 1 everywhere, in colour too."""
    sigma_t = MEDIUM.sigma_t.values
    albedo = np.array([0.9, 0.5, 0.0], np.float32)
    sigma_s = MEDIUM.sigma_t.with_values(sigma_t[..., None] * albedo)
    emission = MEDIUM.sigma_t.with_values(sigma_t[..., None] * (1 - albedo))
    medium = Medium(MEDIUM.sigma_t, sigma_s, emission)
    found = replicates(Scene(medium, (SKY,)), 8, photons=8000)
    # Photons tell the mean over a voxel's box, unscattered light its centre: by second order they
    # differ by 1 / 24 of the second differences (here of unscattered light, which all other light
    # completes to 1; twice that for what the coarse grid hides). 256 directions: 0.1 %.
    black = Medium(MEDIUM.sigma_t, MEDIUM.sigma_t.with_values(0 * sigma_t))
    direct = bake(Scene(black, (SKY,)), MODEL, near=16).in_scattered().values.astype(np.float64)
    wide = np.pad(direct, ((1, 1), (1, 1), (1, 1), (0, 0)), mode="edge")
    inner = [slice(1, -1)] * 3
    second = np.zeros_like(direct)
    for axis in range(3):
        along = [slice(None) if a == axis else inner[a] for a in range(3)]
        second += np.abs(np.diff(wide[tuple(along)], 2, axis))
    error = found.std(axis=0, ddof=1) / math.sqrt(len(found))
    # t with 7 degrees of freedom, 10,000 voxels.
    assert np.all(np.abs(found.mean(axis=0) - 1) <= second / 12 + 1e-3 + 14 * error)
    assert abs(found.mean() - 1) < 2e-3 + second.mean() / 24
    assert error.mean() < 0.01


def test_emission_alone_needs_no_light() -> None:
    medium = Medium(MEDIUM.sigma_t, MEDIUM.sigma_s, MEDIUM.sigma_t)
    volume = bake(Scene(medium, ()), MODEL)
    assert set(volume.channels) == {"light_emitted", "standard_error"}
    assert volume.in_scattered().values.min() > 0
    with pytest.raises(InputError, match="knows only lights of the kinds"):
        bake(Scene(medium, ()), "spherical_harmonics")


def test_without_scattering_only_unscattered_light_is_left() -> None:
    """Albedo 0: exp(-depth) of a sun, without noise."""
    black = Medium.from_density(MEDIUM.sigma_t, 1.0, 0.0)
    sun = DistantLight((0, 0, 1), 4 * math.pi)
    value, error = light_of(bake(Scene(black, (sun,)), MODEL))
    assert not error.any()
    middle = value[7, 7, :, 0]
    column = np.concatenate([np.zeros(2), MEDIUM.sigma_t.values[5, 5], np.zeros(3)])
    step = MEDIUM.sigma_t.voxel_size[2]
    depth = step * np.cumsum(((column[1:] + column[:-1]) / 2)[::-1])[::-1]
    assert np.allclose(middle, np.exp(-depth), rtol=1e-4)


def test_a_sun_in_an_image_is_that_sun() -> None:
    """One pixel of 70,000 in a dim sky, against a disc of its fluence and the sky apart."""
    height, width, row, column = 90, 180, 22, 31
    image = np.full((height, width, 3), (0.2, 0.3, 0.5))
    image[row, column] = (70_000.0, 65_000.0, 55_000.0)
    light = EnvironmentLight(image)
    elevation = math.pi * (0.5 - (row + 0.5) / height)
    azimuth = 2 * math.pi * (0.5 - (column + 0.5) / width)
    toward = np.array([math.cos(elevation) * math.cos(azimuth),
                       math.cos(elevation) * math.sin(azimuth), math.sin(elevation)])  # fmt: skip
    dim = np.array([0.2, 0.3, 0.5])
    fluence = light.fluence(np.zeros(3)) - 4 * math.pi * dim
    apart = (DistantLight(toward, fluence, 0.02), EnvironmentLight(dim))
    one = replicates(Scene(MEDIUM, (light,)), 8)
    two = replicates(Scene(MEDIUM, apart), 8)
    # A pixel 2 degrees wide against a disc: the shadows of a smooth medium differ by 0.2 %.
    same_mean(one, two, 3e-3)
    # No flicker: the image's noise is that of the lights apart (the sky's own photons are few).
    noise = [x.std(0, ddof=1).mean() for x in (one, two)]
    assert noise[0] < 1.5 * noise[1]


def test_the_directions_of_an_image_sum_to_its_light() -> None:
    random = np.random.default_rng(5)
    image = random.random((32, 64, 3)) ** 6
    image[7, 50] = 70_000
    turn = np.linalg.qr(random.normal(size=(3, 3)))[0]
    light = EnvironmentLight(image, turn)
    directions, weights = image_rule(light, 128)
    assert len(directions) == 128
    assert np.allclose(np.linalg.norm(directions, axis=1), 1)
    assert np.allclose(weights.sum(axis=0), light.fluence(np.zeros(3)))
    # The bright pixel is one of them by itself.
    brightest = weights.max(axis=0)
    elevation = math.pi * (0.5 - 7.5 / 32)
    azimuth = 2 * math.pi * (0.5 - 50.5 / 64)
    toward = np.array([math.cos(elevation) * math.cos(azimuth),
                       math.cos(elevation) * math.sin(azimuth), math.sin(elevation)])  # fmt: skip
    toward = toward @ turn
    assert np.allclose(directions[weights[:, 0].argmax()], toward, atol=1e-9)
    assert np.all(brightest > 0.9 * 70_000 * (math.pi / 32) ** 2 * math.cos(elevation))


FAR = np.array([400.0, 300.0, 500.0])


@pytest.mark.parametrize("kind", ["point", "spot", "area"])
def test_a_lamp_far_away_is_a_sun(kind: str) -> None:
    """At 700 times the medium's size: its direction turns by 0.1 degrees, 1 / d^2 by 0.3 %."""
    centre = MEDIUM.sigma_t.centre
    toward = FAR / np.linalg.norm(FAR)
    squared = float(FAR @ FAR)
    lamps: dict[str, Light] = {
        "point": PointLight(centre + FAR, (4.0, 5.0, 6.0)),
        "spot": SpotLight(centre + FAR, -toward, (4.0, 5.0, 6.0), 0.3, 0.2),
        "area": AreaLight(centre + FAR, -toward, (4.0, 5.0, 6.0)),
    }
    sun = DistantLight(toward, np.array([4.0, 5.0, 6.0]) / squared)
    one = replicates(Scene(MEDIUM, (lamps[kind],)), 8)
    two = replicates(Scene(MEDIUM, (sun,)), 8)
    same_mean(one, two, 4e-3)


@pytest.mark.parametrize("ellipse", [False, True])
def test_an_area_light_has_a_size(ellipse: bool) -> None:
    """As wide as the medium, close to it: unscattered light alone, and all, against the judge."""
    grid = MEDIUM.sigma_t
    half = np.linalg.norm(grid.corners() - grid.centre, axis=1).max()
    toward = np.array([0.48, 0.6, 0.64])
    place = grid.centre + 1.6 * half * toward
    light = AreaLight(place, -toward, (1, 2, 4), (2 * half, half), ellipse, (0.8, 0, -0.6))
    far = np.asarray(light.intensity) / (1.6 * half) ** 2
    assert np.all(light.fluence(grid.centre) < 0.9 * far)
    for albedo in (0.0, 0.9):
        sigma_s = grid.with_values(grid.values * np.float32(albedo))
        scene = Scene(Medium(grid, sigma_s), (light,))
        found = replicates(scene, 8, directions=1024)
        lattice = bake(scene, MODEL, photons=100).medium.sigma_t
        index = np.argwhere(np.ones(lattice.shape))[:: lattice.values.size // 40]
        truth = exact(scene, MODEL, lattice.to_world(index.astype(np.float64)), samples=8192)
        values = found[(slice(None), *index.T)]
        noise = np.hypot(values.std(0, ddof=1) / math.sqrt(8), truth.standard_error)
        # Photons tell the mean over a box: 1 % of what they bring; points of the light: 0.3 %.
        allowed = 7 * noise + (3e-3 + 0.01 * (albedo > 0)) * truth.value
        assert np.all(np.abs(values.mean(0) - truth.value) < allowed)


def test_a_lamp_inside_is_the_same_from_every_side() -> None:
    """Eight spots of a quarter of the sphere... in sum: two half-space spots are one point."""
    place = MEDIUM.sigma_t.centre + 0.013
    point = PointLight(place, 1.0)
    halves = tuple(
        SpotLight(place, axis, 1.0, math.pi, 0.0) for axis in ((0.6, 0, 0.8), (-0.6, 0, -0.8))
    )
    one = replicates(Scene(MEDIUM, (point,)), 8)
    two = replicates(Scene(MEDIUM, halves), 8)
    assert np.all(np.isfinite(one))
    same_mean(one, two, 1e-5)


def test_brightness_is_a_weight_and_lights_add_up() -> None:
    lights = (DistantLight((0.3, 0.2, 0.9), (1.0, 2.0, 3.0)), PointLight((2, 2, 2), 1.0), SKY)
    volume = bake(Scene(MEDIUM, lights), MODEL)
    other = (DistantLight((0.3, 0.2, 0.9), 5.0), PointLight((2, 2, 2), (0, 1, 0)),
             EnvironmentLight(0.1))  # fmt: skip
    again = bake(Scene(MEDIUM, other), MODEL)
    assert np.allclose(relight(volume, other).in_scattered().values,
                       again.in_scattered().values, rtol=1e-5)  # fmt: skip


def test_a_continued_run_is_the_uninterrupted_one(tmp_path: Path) -> None:
    medium = replace(MEDIUM, emission=MEDIUM.sigma_t)
    scene = Scene(medium, (DistantLight((0.3, 0.2, 0.9), 1.0, 0.1), SKY))
    settings = {"photons": 3000, "noise_seed": 7}
    whole = refine(photon_state(scene, settings), 6)
    first = photon_state(scene, settings)
    first.refine(2)
    first.save(tmp_path / "run.npz")
    second = photon_state(scene, settings)
    second.load(tmp_path / "run.npz")
    parts = refine(second, 4)
    assert [path.name for path in tmp_path.iterdir()] == ["run.npz"]
    for name, grid in whole.channels.items():
        assert np.array_equal(grid.values, parts.channels[name].values)
    assert np.array_equal(bake(scene, MODEL, passes=6, **settings).channels["light_emitted"].values,
                          whole.channels["light_emitted"].values)  # fmt: skip
    other = photon_state(scene, {"photons": 3000, "noise_seed": 8})
    with pytest.raises(InputError, match="inputs is others; expected this scene, photons, seed"):
        other.load(tmp_path / "run.npz")
    (tmp_path / "no.npz").write_bytes(b"nothing")
    with pytest.raises(InputError, match="cannot be read"):
        other.load(tmp_path / "no.npz")


def test_it_stops_at_the_requested_error() -> None:
    scene = Scene(MEDIUM, (SKY,))
    many = bake(scene, MODEL, photons=2000, passes=500, error=0.05)
    error = many.cost.error_estimate
    assert error is not None
    # Looked at after every eighth more passes: at most a sixteenth below, and the estimate's noise.
    assert 0.9 * 0.05 < error <= 0.05
    state = photon_state(scene, {"photons": 2000})
    state.refine(8)
    assert state.relative_error() == pytest.approx(
        refine(state, 0).cost.error_estimate, rel=1e-5
    )  # fmt: skip


def test_it_stops_in_time_but_has_an_error() -> None:
    volume = bake(Scene(MEDIUM, (SKY,)), MODEL, photons=100, passes=1000, seconds=1e-3)
    assert volume.channels["standard_error"].values.max() > 0
    state = photon_state(Scene(MEDIUM, (SKY,)))
    with pytest.raises(InputError, match="passes so far is 0; expected at least 2"):
        state.channels()


def test_standard_errors_cover_the_truth() -> None:
    """Two lights of different colour: z between independent halves has variance 1."""
    scene = Scene(MEDIUM, (DistantLight((0.3, 0.2, 0.9), (3, 1, 0)), EnvironmentLight((0, 1, 2))))
    pairs = []
    for seed in range(12):
        (a, ea), (b, eb) = (
            light_of(bake(scene, MODEL, photons=1000, passes=24, noise_seed=2 * seed + k))
            for k in (0, 1)
        )
        known = ea + eb > 0  # no photon has come to some of the rim
        assert known.mean() > 0.99
        pairs.append(((a - b)[known] / np.hypot(ea, eb)[known]) ** 2)
    # Student's t with about 46 degrees of freedom: variance 46 / 44. Replicates agree within:
    spread = np.array([pair.mean() for pair in pairs])
    assert abs(spread.mean() - 46 / 44) < 5 * spread.std(ddof=1) / math.sqrt(len(spread))
    assert spread.std(ddof=1) / math.sqrt(len(spread)) < 0.05


@pytest.mark.parametrize(
    "estimate", [{}, {"estimate": "kernel", "radius": 0.7}], ids=["track_length", "kernel"]
)
def test_the_actual_error_is_the_reported_one(estimate: dict[str, object]) -> None:
    """From 16 passes on: squared distances to the judge over squared standard errors sum to 1.

    Voxels of one run are correlated, so each run counts as one number. So few photons that noise
    (10 % and more) is far above the mean over a box or ball (below 1 %) and the judge's own noise,
    which is taken off.
    """
    scene = Scene(MEDIUM, (DistantLight((0.3, 0.2, 0.9), 3.0), SKY))
    lattice = bake(scene, MODEL, photons=10).medium.sigma_t
    matter = np.argwhere(lattice.values > 0)
    index = matter[:: len(matter) // 50]
    truth = exact(scene, MODEL, lattice.to_world(index.astype(np.float64)), samples=4096)
    for passes in (16, 48):
        ratios = []
        for seed in range(12):
            value, error = light_of(
                bake(scene, MODEL, photons=150, passes=passes, near=16, noise_seed=seed, **estimate)
            )
            far = (value[tuple(index.T)] - truth.value)[:, 0] ** 2 - truth.standard_error[:, 0] ** 2
            ratios.append(far.sum() / (error[tuple(index.T)][:, 0] ** 2).sum())
        spread = np.std(ratios, ddof=1) / math.sqrt(len(ratios))
        assert spread < 0.15
        # t with 11 degrees of freedom: one in 1000. The judge's noise is common to all runs.
        assert abs(np.mean(ratios) - 1) < 4.4 * spread + 0.05


def test_opaque_voxels_are_bounded() -> None:
    values = np.zeros((8, 8, 8), np.float32)
    values[2:6, 2:6, 2:6] = 1e6
    medium = Medium.from_density(Grid(values, np.eye(4), "block"), 1.0, 0.9)
    value, error = light_of(bake(Scene(medium, (SKY,)), MODEL, photons=2000))
    assert np.all(np.isfinite(value))
    assert np.all(value <= 1 + 1e-5 + 6 * error)


VIEWS = (np.array([0.0, 0.0, 1.0]), np.array([0.6, 0.0, 0.8]), np.array([-0.48, 0.64, -0.6]))


@pytest.mark.parametrize("g", [0.96, -0.99])
def test_a_sharper_phase_function_is_refused(g: float) -> None:
    scene = Scene(replace(MEDIUM, g=g), (SKY,))
    for refuses in (lambda: bake(scene, MODEL), lambda: photon_state(scene)):
        with pytest.raises(InputError, match=f"from -0.95 to 0.95; the scene's has {g}"):
            refuses()
    sun = replace(scene, lights=(DistantLight((0, 0, 1), 1.0),))
    assert bake(sun, "half_angle").in_scattered().values.max() > 0


@pytest.mark.parametrize("g", [0.9, -0.5])
def test_anisotropic_furnace_from_every_side(g: float) -> None:
    """Albedo 1 under an even sky: 1 toward every eye."""
    white = Medium(MEDIUM.sigma_t, MEDIUM.sigma_t, None, g)
    volumes = [
        bake(Scene(white, (SKY,)), MODEL, photons=3000, near=16, noise_seed=seed)
        for seed in range(8)
    ]
    for view in VIEWS:
        found = np.array([v.in_scattered(view=view).values.mean() for v in volumes], np.float64)
        # Means over boxes against centres, as in the thermal furnace: 0.2 % on average.
        error = found.std(ddof=1) / math.sqrt(len(found))
        assert abs(found.mean() - 1) < 5.4 * error + 3e-3  # t with 7 degrees of freedom


@pytest.mark.parametrize("g", [0.7, -0.95])
@pytest.mark.parametrize("kind", ["distant", "point"])
def test_a_thin_medium_shows_the_phase_function(g: float, kind: str) -> None:
    """Optical depth 1e-5: F / (4 pi) times 4 pi p of the angle, nothing else."""
    thin = Medium.from_density(MEDIUM.sigma_t, 1e-6, 0.9)
    thin = replace(thin, g=g)
    toward = np.array([0.48, 0.6, 0.64])
    place = thin.sigma_t.centre + 5 * toward
    lamp: Light = PointLight(place, (1, 2, 3)) if kind == "point" else DistantLight(toward, 1.0)
    volume = bake(Scene(thin, (lamp,)), MODEL, photons=1000)
    lattice = volume.medium.sigma_t
    for view in VIEWS:
        found = volume.in_scattered(view=view).values
        for index in ((2, 3, 4), (9, 9, 9)):
            point = lattice.to_world(np.array(index, np.float64))
            omega = place - point if kind == "point" else toward
            cosine = -float(omega @ view) / float(np.linalg.norm(omega))
            phase = (1 - g * g) / (1 + g * g - 2 * g * cosine) ** 1.5
            truth = lamp.fluence(point) / (4 * math.pi) * phase
            # Scattered light is 1e-5 of the unscattered; its noise is a hundred times that of few
            # photons, and forward g = -0.95 has phases down to 0.01.
            assert np.allclose(found[index], truth, rtol=1e-4, atol=1e-4 * truth.max() / phase)


def test_net_flux_is_the_same_at_every_depth() -> None:
    """A white slab, g = 0.6: sun and first moment together carry one flux, which is what the light
    below the slab carries."""
    slices = 16
    affine = np.diag([SIDEWAYS, SIDEWAYS, 2 / slices, 1.0])
    white = Medium.from_density(Grid(np.ones((3, 3, slices), np.float32), affine, "slab"))
    sun = DistantLight((0, 0, 1), 4 * math.pi)
    fluxes = []
    for seed in range(8):
        volume = bake(Scene(replace(white, g=0.6), (sun,)), MODEL, photons=20_000, noise_seed=seed)
        # Moment 2 is sqrt(3) z of outward directions.
        column = volume.channels["moments_0_0"].values[3, 3, :, 2].astype(np.float64)
        fluxes.append(volume.channels["direct_0"].values[3, 3] + column / math.sqrt(3))
    found = np.array(fluxes)
    difference = found - found[:, :1]
    error = difference[:, 1:].std(axis=0, ddof=1) / math.sqrt(len(found))
    # The mean of exp(-depth) over a slice against its centre: (1 / 8)^2 / 24 = 7e-4 of it.
    assert np.all(np.abs(difference[:, 1:].mean(axis=0)) < 7 * error + 1e-3)
    assert 0.4 < found.mean() < 1.0
    assert any("the others are estimated at" in note for note in volume.notes)


def test_coloured_anisotropic_media_store_colours() -> None:
    albedo = np.array([0.9, 0.5, 0.2], np.float32)
    coloured = MEDIUM.sigma_t.with_values(MEDIUM.sigma_t.values[..., None] * albedo)
    medium = Medium(MEDIUM.sigma_t, coloured, MEDIUM.sigma_t, 0.4)
    image = EnvironmentLight(np.random.default_rng(2).random((4, 8, 3)))
    volume = bake(Scene(medium, (DistantLight((0, 0, 1), 1.0), image)), MODEL, photons=500)
    names = {f"moment_{m}{end}" for m in range(9) for end in ("_0", "_1", "_emitted")}
    assert set(volume.channels) == {"direct_0", "standard_error", *names}
    assert np.all(np.isfinite(volume.in_scattered(view=VIEWS[1]).values))
    assert volume.cost.error_estimate is not None
