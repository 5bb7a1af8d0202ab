"""Half angle: its Volterra equation in a half space, and what it becomes in its limits."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from media import half_space, smooth_random, value_at
from numpy.typing import NDArray
from scipy.special import expn

from volillum_addon.core.control import Cancelled, Control
from volillum_addon.core.errors import InputError
from volillum_addon.core.lights import DistantLight, EnvironmentLight, PointLight
from volillum_addon.core.medium import Medium
from volillum_addon.core.scene import Scene
from volillum_addon.models.exact import exact
from volillum_addon.models.illuminate import bake

MODEL = "half_angle"


def unit_sun(direction: tuple[float, float, float]) -> DistantLight:
    """An ideal sun whose unoccluded L_i = F / (4 pi) is 1."""
    return DistantLight(direction, 4 * math.pi)


def with_albedo(medium: Medium, albedo: float | tuple[float, float, float]) -> Medium:
    """The medium with a constant albedo, RGB if three are given."""
    values = medium.sigma_t.values
    if isinstance(albedo, tuple):
        scattering = values[..., None] * np.array(albedo, np.float32)
    else:
        scattering = values * np.float32(albedo)
    return replace(medium, sigma_s=medium.sigma_t.with_values(scattering))


def in_half_space(depth: float, albedo: float, degrees: float, slices: int = 64) -> float:
    medium, point = half_space(depth, slices)
    volume = bake(
        Scene(with_albedo(medium, albedo), (unit_sun((0, 0, 1)),)),
        MODEL,
        theta=math.radians(degrees),
        directions=64,
        spacing=1.0,
    )
    return float(value_at(volume.in_scattered(), point)[0])


@pytest.mark.parametrize(
    ("albedo", "degrees", "expected"),
    [
        (0.9, 30, (0.9477534142, 0.898264571, 0.8069449955, 0.6512612281)),
        (0.9, 60, (0.9337674356, 0.8728157913, 0.7635947852, 0.5852932619)),
        (0.99, 30, (0.9946482485, 0.9893280927, 0.9787774348, 0.9580182931)),
    ],
)
def test_half_space(albedo: float, degrees: float, expected: tuple[float, ...]) -> None:
    """Case D1: the Volterra equation of the half space, by Laplace transform."""
    for depth, value in zip((0.5, 1.0, 2.0, 4.0), expected, strict=True):
        # 64 slices: second order in steps of 1 / 16 at most.
        assert in_half_space(depth, albedo, degrees) == pytest.approx(value, rel=1e-4)


@pytest.mark.parametrize("degrees", [15, 30, 60])
@pytest.mark.parametrize("depth", [0.5, 2.0])
def test_without_scattering_it_is_cone_visibility(degrees: float, depth: float) -> None:
    """Case C1: (E2(t) - c E2(t / c)) / (1 - c), c = cos(theta)."""
    c = math.cos(math.radians(degrees))
    truth = (expn(2, depth) - c * expn(2, depth / c)) / (1 - c)
    assert in_half_space(depth, 0.0, degrees) == pytest.approx(truth, rel=1e-4)


def test_without_scattering_it_is_multidirectional_occlusion() -> None:
    """Property 1: the same equation, the same rule, the same transmittance."""
    medium = with_albedo(smooth_random((14, 16, 18), seed=2), 0.0)
    scene = Scene(medium, (unit_sun((0.48, -0.6, 0.64)),))
    here = bake(scene, MODEL, directions=16)
    there = bake(scene, "multidirectional_occlusion", theta=math.radians(30), directions=16)
    # Below 1e-5 the lattice does not say what share of the light is lost.
    assert np.allclose(here.in_scattered().values, there.in_scattered().values, atol=2e-5)


@pytest.mark.parametrize("direction", [(0, 0, 1), (-1, 2, -3), (1, 1, 0)])
def test_white_media_are_lit_evenly(direction: tuple[float, float, float]) -> None:
    """The furnace: albedo 1 leaves F / (4 pi) at any optical depth."""
    medium = smooth_random((12, 13, 14), seed=3, depth=500)
    found = bake(Scene(medium, (unit_sun(direction),)), MODEL).in_scattered().values
    # Rounding of float32 in some 30 steps.
    assert np.allclose(found, 1, atol=3e-6)


def test_a_narrow_cone_leaves_the_absorption() -> None:
    """Theta -> 0: exp(-integral of sigma_a) (property 3)."""
    truth = math.exp(-0.1 * 2.0)
    # 1 degree lengthens paths by less than 1 / cos(1 degree) - 1 = 1.5e-4.
    assert in_half_space(2.0, 0.9, 1.0) == pytest.approx(truth, rel=2e-4)


def test_every_colour_has_its_own_albedo() -> None:
    medium = smooth_random((10, 11, 12), seed=4)
    albedo = (0.95, 0.7, 0.2)
    scene = Scene(with_albedo(medium, albedo), (unit_sun((1, 2, 3)),))
    coloured = bake(scene, MODEL).in_scattered().values
    for channel, own in enumerate(albedo):
        grey = replace(scene, medium=with_albedo(medium, own))
        alone = bake(grey, MODEL).in_scattered().values[..., channel]
        assert np.array_equal(coloured[..., channel], alone)
    assert np.all(coloured[..., 0] >= coloured[..., 2])


def test_suns_add_up() -> None:
    medium = with_albedo(smooth_random((12, 10, 11), seed=5), 0.9)
    suns = (
        DistantLight((1, 2, 3), (1.0, 0.5, 0.2), angle=0.4),
        DistantLight((-1, 0, 0.2), (0.3, 0.6, 0.9)),
    )
    both = bake(Scene(medium, suns), MODEL).in_scattered().values
    apart = sum(bake(Scene(medium, (sun,)), MODEL).in_scattered().values for sun in suns)
    assert np.allclose(both, apart, rtol=1e-6)


def lamp_at(position: NDArray[np.float64], centre: NDArray[np.float64]) -> PointLight:
    """A point light whose unoccluded L_i at the centre is 1."""
    return PointLight(tuple(position), 4 * math.pi * float(np.sum((position - centre) ** 2)))


def lamp_scene(albedo: float, distance: float, depth: float = 4.0) -> Scene:
    """A medium of a side of about 1 under a point light at a distance from its centre."""
    medium = with_albedo(smooth_random((24, 28, 20), seed=23, depth=depth), albedo)
    centre = medium.sigma_t.centre
    return Scene(medium, (lamp_at(centre + distance * np.array([0.48, 0.36, 0.8]), centre),))


# From afar; and so near that many rays end inside the medium.
@pytest.mark.parametrize("distance", [3.0, 1.3])
def test_a_point_light_agrees_with_the_exact_solution(distance: float) -> None:
    scene = lamp_scene(0.8, distance)
    volume = bake(scene, MODEL)
    lattice = volume.medium.sigma_t
    rng = np.random.default_rng(24)
    index = np.stack([rng.integers(0, n, 300) for n in lattice.shape], axis=-1)
    truth = exact(scene, MODEL, lattice.to_world(index.astype(float)), 4096)
    error = volume.in_scattered().values[tuple(index.T)] - truth.value
    # The specification's goal on smooth fields is 1 %.
    assert math.sqrt((error**2).sum() / (truth.value**2).sum()) < 0.01
    assert abs(error.sum() / truth.value.sum()) < 0.003


@pytest.mark.parametrize("distance", [3.0, 1.3])
def test_white_media_keep_a_point_lights_own_brightness(distance: float) -> None:
    """The furnace: albedo 1 leaves F(x) / (4 pi) at any optical depth."""
    scene = lamp_scene(1.0, distance, depth=500)
    found = bake(scene, MODEL).in_scattered()
    rng = np.random.default_rng(25)
    index = np.stack([rng.integers(0, n, 200) for n in found.shape], axis=-1)
    places = found.to_world(index.astype(float))
    truth = [scene.lights[0].fluence(place) / (4 * math.pi) for place in places]
    assert np.allclose(found.values[tuple(index.T)], truth, rtol=5e-6)


def test_a_point_light_without_scattering_is_multidirectional_occlusion() -> None:
    scene = lamp_scene(0.0, 1.3)
    here = bake(scene, MODEL, directions=16).in_scattered().values
    there = bake(scene, "multidirectional_occlusion", theta=math.radians(30), directions=16)
    # Below 1e-5 the lattice does not say what share of the light is lost.
    assert np.allclose(here, there.in_scattered().values, atol=4e-5)


def test_a_far_point_light_is_a_sun() -> None:
    medium = with_albedo(smooth_random((14, 16, 12), seed=25), 0.8)
    toward, centre = np.array([0.36, 0.48, 0.8]), medium.sigma_t.centre
    far = bake(Scene(medium, (lamp_at(centre + 1e5 * toward, centre),)), MODEL, directions=256)
    sun = bake(Scene(medium, (unit_sun(tuple(toward)),)), MODEL, directions=256)
    difference = far.in_scattered().values - sun.in_scattered().values
    # Two direction rules; 0.0038, 0.0012 and 0.0005 with 16, 64 and 256 directions.
    assert np.sqrt(np.mean(difference**2)) < 1e-3


def test_a_point_light_that_cannot_be_followed_is_refused() -> None:
    medium = smooth_random((8, 8, 8), seed=1)
    centre = medium.sigma_t.centre
    inside = Scene(medium, (PointLight(tuple(centre), 1.0),))
    for algorithm in ("equation", "published"):
        with pytest.raises(InputError, match=r"a point light is .*too fast .*move the light out"):
            bake(inside, MODEL, algorithm=algorithm)
    beside = Scene(medium, (PointLight(tuple(centre + np.array([0, 0, 1.6])), 1.0),))
    with pytest.raises(InputError, match=r"cones of half angle 70 degrees .* narrow theta"):
        bake(beside, MODEL, theta=math.radians(70))


def test_cancelling_stops_it() -> None:
    control = Control()
    control.cancel()
    scene = Scene(smooth_random((8, 8, 8), seed=6), (unit_sun((0, 0, 1)),))
    with pytest.raises(Cancelled):
        bake(scene, MODEL, control)


def test_a_scene_without_a_sun_is_refused() -> None:
    scene = Scene(smooth_random((8, 8, 8), seed=1), (EnvironmentLight(1.0),))
    with pytest.raises(InputError, match="kinds distant, point; the scene has environment"):
        bake(scene, MODEL)
