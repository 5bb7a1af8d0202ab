"""Photon mapping under every kind of light."""

from __future__ import annotations

import math

import numpy as np
import pytest
from photon_runs import MEDIUM, MODEL, SKY, light_of, replicates, same_mean, sun_in_a_map

from volillum_addon.core.coarse import refined
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


def test_half_a_sky_in_two_pixels_has_as_many_directions() -> None:
    """The first moment of a hemisphere of radiance 1 is pi; of one direction it would be 2 pi."""
    light = EnvironmentLight(np.array([[[1.0] * 3, [0.0] * 3]]))
    directions, weights = image_rule(light, 128)
    assert len(directions) >= 64
    assert np.allclose(weights.sum(axis=0), 2 * math.pi)
    # Rectangles of 1 / 64 of a hemisphere or less, up to twice as long as wide, 0.44 by 0.22: for
    # each stands a unit vector, and its own mean is shorter by (0.44^2 + 0.22^2) / 24, 1 %.
    assert np.allclose(weights[:, 0] @ directions, (0, math.pi, 0), atol=0.02 * math.pi)


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
    """Two spots that fill half of space each are one point."""
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


@pytest.mark.parametrize("place", [(0.0, 0.0), (0.5, 0.5), (0.9, 0.2)])
def test_a_sun_in_a_map_neither_flickers_nor_has_a_bias(place: tuple[float, float]) -> None:
    """Wherever it stands between pixels and however the map is turned: seeds differ by no more than
    the standard error that they state, and their mean is the judge's.

    On half the spacing, so that means over voxels differ from their centres by a quarter.
    """
    turn = np.linalg.qr(np.random.default_rng(round(10 * sum(place))).normal(size=(3, 3)))[0]
    scene = refined(Scene(MEDIUM, (EnvironmentLight(sun_in_a_map(*place), turn),)))
    seeds = 4
    volumes = [
        bake(scene, MODEL, near=16, directions=128, photons=4000, noise_seed=seed)
        for seed in range(seeds)
    ]
    grid = volumes[0].medium.sigma_t
    index = np.argwhere(grid.values > 0)
    index = index[np.random.default_rng(1).permutation(len(index))[:200]]
    values, errors = (
        np.array([part[tuple(index.T)] for part in parts], np.float64)
        for parts in zip(*map(light_of, volumes), strict=True)
    )
    # The variance between 4 seeds is that of their own standard errors. Voxels share photons: as if
    # a twentieth of them were independent.
    ratio = values.var(0, ddof=1).sum() / (errors**2).mean(0).sum()
    assert ratio < 1 + 4 * math.sqrt(2 / (seeds - 1) / (len(index) / 20))
    truth = exact(scene, MODEL, grid.to_world(index.astype(np.float64)), samples=1024)
    means = values.mean((1, 2))
    noise = math.hypot(
        means.std(ddof=1) / math.sqrt(seeds),
        math.sqrt((truth.standard_error.sum(1) ** 2).sum()) / truth.value.size,
    )
    assert noise < 5e-3 * truth.value.mean()
    # t with 3 degrees of freedom: one in 1000. Means over voxels and 128 directions: 0.2 %.
    assert abs(means.mean() - truth.value.mean()) < 13 * noise + 2e-3 * truth.value.mean()


def test_a_sun_moves_through_a_map_without_a_jump() -> None:
    """From pixel to pixel in quarters: the volume's light follows a line as the sun does."""
    found = []
    for step in range(5):
        light = EnvironmentLight(sun_in_a_map(step / 4, 0.0))
        lit = replicates(Scene(MEDIUM, (light,)), 2, photons=8000, directions=128)
        found.append(lit.mean((1, 2, 3, 4)))
    frames = np.array(found)  # [frames, seeds]
    noise = math.sqrt(frames.var(1, ddof=1).mean() / 2)
    line = np.polyval(np.polyfit(np.arange(5), frames.mean(1), 1), np.arange(5))
    # Five residuals; noise with 5 degrees of freedom: 7 standard errors are one in 1000.
    assert np.all(np.abs(frames.mean(1) - line) < 7 * noise)
    assert noise < 3e-3 * frames.mean()
