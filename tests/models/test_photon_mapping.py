"""Photon mapping: closed forms of the full equation, furnaces, and its bounds."""

from __future__ import annotations

import math

import numpy as np
import pytest
from media import SIDEWAYS, ball
from photon_runs import LIMIT, MEDIUM, MODEL, SKY, light_of, replicates

from volillum_addon.core.errors import InputError
from volillum_addon.core.grid import Grid
from volillum_addon.core.lights import DistantLight, PointLight
from volillum_addon.core.medium import Medium
from volillum_addon.core.scene import Scene
from volillum_addon.models import photon_state
from volillum_addon.models.illuminate import bake
from volillum_addon.models.registry import get


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


def test_opaque_voxels_are_bounded() -> None:
    values = np.zeros((8, 8, 8), np.float32)
    values[2:6, 2:6, 2:6] = 1e6
    medium = Medium.from_density(Grid(values, np.eye(4), "block"), 1.0, 0.9)
    value, error = light_of(bake(Scene(medium, (SKY,)), MODEL, photons=2000))
    assert np.all(np.isfinite(value))
    assert np.all(value <= 1 + 1e-5 + 6 * error)


@pytest.mark.parametrize(("seconds", "passes"), [(1.0, 2), (0.04, 3), (0.001, 64)])
def test_a_first_look_ends_by_time(
    monkeypatch: pytest.MonkeyPatch, seconds: float, passes: int
) -> None:
    """However long a pass takes: two are the least, and many hardly show."""
    clock, done = [0.0], [0]
    inner = photon_state.PhotonState._trace

    def slow(self: photon_state.PhotonState, *arguments: object) -> None:
        inner(self, *arguments)  # type: ignore[arg-type]
        clock[0] += seconds
        done[0] += 1

    monkeypatch.setattr(photon_state.PhotonState, "_trace", slow)
    monkeypatch.setattr(photon_state.time, "perf_counter", lambda: clock[0])
    grid = Grid(np.ones((6, 5, 4), np.float32), np.eye(4), "box")
    look = {**get(MODEL).first_look, "photons": 50}
    bake(Scene(Medium.from_density(grid, 0.1, 0.9), (SKY,)), MODEL, **look)
    assert done[0] == passes
