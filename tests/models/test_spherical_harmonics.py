"""Spherical harmonic lighting: cases F1 to F7, local visibility, relighting."""

from __future__ import annotations

import math

import numpy as np
import pytest
from media import ENDLESS, ball, half_space, smooth_random, value_at
from photon_runs import MEDIUM, sun_in_a_map
from scipy.special import expn

from volillum_addon.core import harmonics
from volillum_addon.core.grid import Grid
from volillum_addon.core.lights import DistantLight, EnvironmentLight, latitude_longitude
from volillum_addon.core.medium import Medium
from volillum_addon.core.scene import Scene
from volillum_addon.models.exact import exact
from volillum_addon.models.illuminate import bake, relight
from volillum_addon.models.volume import IlluminationVolume

MODEL = "spherical_harmonics"
SKY = EnvironmentLight(1.0)


def coefficients(volume: IlluminationVolume, point: np.ndarray) -> np.ndarray:
    """V_lm [16] at a voxel centre."""
    packs = [value_at(grid, point).reshape(-1) for grid in volume.channels.values()]
    return np.concatenate(packs)[: harmonics.COUNT]


def opaque_half_space() -> tuple[Medium, np.ndarray]:
    """An opaque medium below z = 0 (the end of its support), and the voxel centre at z = 0."""
    affine = np.diag([1e4, 1e4, 1.0, 1.0])
    affine[2, 3] = -4
    grid = Grid(np.full((3, 3, 4), 1e9, np.float32), affine, "opaque")
    return Medium(grid, grid), np.array([1e4, 1e4, 0.0])


def test_f1_coefficients_of_an_opaque_half_space() -> None:
    medium, point = opaque_half_space()
    volume = bake(Scene(medium, (SKY,)), MODEL, directions=4096, window="none")
    zonal = coefficients(volume, point)[[0, 2, 6, 12]]
    expected = [math.sqrt(math.pi), math.sqrt(3 * math.pi) / 2, 0.0, -0.5861840124793437]
    # A step integrated by 4,096 directions: about one ring of 90 of 4,096 weights 4 pi / 4096 on
    # the wrong side at random, sqrt(90) * 0.003 * |Y| <= 0.03 * 0.75.
    assert zonal == pytest.approx(expected, abs=0.02)


def test_f4_outward_directions_on_both_sides() -> None:
    """Environment 1 + omega_z / 2 over an opaque half space: 0.625; the printed sign: 0.375."""
    medium, point = opaque_half_space()
    directions, _ = latitude_longitude(256, 512)
    sky = EnvironmentLight(np.repeat((1 + directions[..., 2:] / 2), 3, axis=-1))
    volume = bake(Scene(medium, (sky,)), MODEL, directions=4096, window="none")
    assert value_at(volume.in_scattered(), point) == pytest.approx([0.625] * 3, abs=0.005)


@pytest.mark.parametrize(
    ("depth", "zonal"),
    [
        (0.25, [0.9176527528, 0.9967738133, 0.3565005515, -0.1716843049]),
        (1.0, [0.2632014328, 0.3367521590, 0.2173725840, 0.0543868226]),
    ],
)
def test_f5_uniform_environment_in_a_half_space(depth: float, zonal: list[float]) -> None:
    medium, point = half_space(depth, below=ENDLESS)
    for order in (0, 3):
        volume = bake(Scene(medium, (SKY,)), MODEL, order=order, directions=4096, window="none")
        value = value_at(volume.in_scattered(), point)
        # Exact for every order. 45 Gauss rings about a turned pole: exp(-t / mu) ends at the
        # horizon with all derivatives zero, 2e-3 is left at t = 0.25.
        assert value == pytest.approx([expn(2, depth) / 2] * 3, rel=3e-3)
    assert coefficients(volume, point)[[0, 2, 6, 12]] == pytest.approx(zonal, abs=3e-3)


@pytest.mark.parametrize(
    ("order", "expected"),
    [(0, 0.005908448482581), (1, 0.01900196258033), (2, 0.02991322432845), (3, 0.03314341315922)],
)
def test_f6_zenith_light_is_truncated(order: int, expected: float) -> None:
    medium, point = half_space(1.0, below=ENDLESS)
    scene = Scene(medium, (DistantLight((0, 0, 1), 1.0),))
    volume = bake(scene, MODEL, order=order, directions=4096, window="none")
    assert value_at(volume.in_scattered(), point) == pytest.approx([expected] * 3, rel=3e-3)


@pytest.mark.parametrize(("offset", "expected"), [(0.0, 0.22313016014843), (0.5, 0.27835951000879)])
def test_f7_mean_visibility_in_a_ball(offset: float, expected: float) -> None:
    volume = bake(Scene(ball(24, 1.5), (SKY,)), MODEL, order=0, directions=512)
    value = value_at(volume.in_scattered(), np.array([0.0, offset, 0.0]))
    # The surface, blurred over a voxel, changes optical depths by its curvature: (1 / 24)^2.
    assert value == pytest.approx([expected] * 3, rel=2e-3)


def test_f7_mean_visibility_on_the_surface_of_a_ball() -> None:
    """The blurred surface costs h log h there: the limit of three resolutions is asserted."""
    voxels = np.array([8.0, 16.0, 32.0])
    values = []
    for radius in voxels:
        volume = bake(Scene(ball(radius, 1.5), (SKY,)), MODEL, order=0, directions=512)
        values.append(value_at(volume.in_scattered(), np.array([0.0, 1.0, 0.0]))[0])
    h = 1 / voxels
    limit, *_ = np.linalg.solve(np.stack([np.ones(3), h, h * np.log(h)], axis=1), values)
    # Next term h^2 at h = 1/8 to 1/32, and the rule's 512 directions across the horizon.
    assert limit == pytest.approx(0.6583688219, rel=4e-3)


@pytest.mark.parametrize("radius", [0.1, 1.0, 3.0])
def test_local_visibility_in_an_endless_medium(radius: float) -> None:
    sigma = 0.8
    grid = Grid(np.full((41, 41, 41), sigma, np.float32), np.diag([0.25, 0.25, 0.25, 1]), "even")
    scene = Scene(Medium(grid, grid), (SKY,))
    volume = bake(scene, MODEL, radius=radius, directions=64)
    middle = volume.in_scattered().values[22, 22, 22]  # 20 voxels of 0.25 from the border
    # Optical depth sigma R in every direction; float32 prefix differences over 40 slices.
    assert middle == pytest.approx([math.exp(-sigma * radius)] * 3, rel=1e-5)


def test_relighting_equals_a_new_bake() -> None:
    medium = smooth_random((12, 13, 14), seed=31)
    first = (SKY,)
    second = (
        DistantLight((1, 1, 2), (3.0, 2.0, 1.0), angle=0.3),
        EnvironmentLight((0.1, 0.2, 0.4)),
    )
    old = bake(Scene(medium, first), MODEL)
    new = bake(Scene(medium, second), MODEL)
    assert np.array_equal(relight(old, second).in_scattered().values, new.in_scattered().values)
    assert not np.allclose(old.in_scattered().values, new.in_scattered().values)


def test_chromatic_extinction_equals_three_grey_bakes() -> None:
    medium = smooth_random((9, 10, 11), seed=32)
    factors = np.array([1.0, 0.5, 2.0], np.float32)
    rgb = medium.sigma_t.with_values(medium.sigma_t.values[..., None] * factors)
    lights = (DistantLight((0, 1, 1), 2.0), SKY)
    wide = bake(Scene(Medium(rgb, rgb), lights), MODEL).in_scattered().values
    for channel, factor in enumerate(factors):
        grey = medium.sigma_t.with_values(medium.sigma_t.values * factor)
        narrow = bake(Scene(Medium(grey, grey), lights), MODEL).in_scattered().values
        assert np.allclose(wide[..., channel], narrow[..., channel], rtol=1e-6, atol=1e-7)


def test_windows_lower_the_clamped_share() -> None:
    medium, _ = half_space(1.0, below=ENDLESS)
    sun = DistantLight((0, 0, -1), 1.0)  # from below: hidden, the truncated light rings negative
    shares = {}
    for window in harmonics.WINDOWS:
        volume = bake(Scene(medium, (sun,)), MODEL, window=window)
        total = sum(
            np.multiply.outer(volume.component(term.factors[0])[..., 0], np.asarray(term.weight))
            for term in volume.radiance
        )
        shares[window] = np.minimum(total, 0).sum()
    assert shares["none"] < shares["hanning"] <= 0
    assert shares["none"] < shares["lanczos"] <= 0


def test_what_bands_lose_on_a_sun_in_a_map_is_model_error() -> None:
    """A sun of 70,000 in a dim map: exact solutions of the truncated and of the whole light differ
    by as much as the page on the mathematics says, with the window by more than without.

    Points in matter share the difference: from 100 points to 400 it moves by less than a tenth.
    """
    black = Medium.from_density(MEDIUM.sigma_t, 1.0, 0.0)
    scene = Scene(black, (EnvironmentLight(sun_in_a_map(0.5, 0.5)),))
    matter = np.argwhere(MEDIUM.sigma_t.values > 0)
    index = matter[np.random.default_rng(1).permutation(len(matter))[:200]]
    points = MEDIUM.sigma_t.to_world(index.astype(np.float64))
    truth = exact(scene, "photon_mapping", points, samples=4096)
    lost = {}
    for window in ("none", "hanning"):
        found = exact(scene, MODEL, points, samples=1024, window=window)
        squares = (found.value - truth.value) ** 2
        squares -= found.standard_error**2 + truth.standard_error**2
        lost[window] = math.sqrt(squares.sum() / (truth.value**2).sum())
    assert lost["none"] == pytest.approx(0.040, rel=0.15)
    assert lost["hanning"] == pytest.approx(0.047, rel=0.15)
    assert lost["none"] < lost["hanning"]
