"""Photon mapping in anisotropic media: from every side, and what is not stored."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from media import SIDEWAYS
from numpy.typing import NDArray
from photon_runs import MEDIUM, MODEL, SKY, VIEWS

from volillum_addon.core.errors import InputError
from volillum_addon.core.grid import Grid
from volillum_addon.core.lights import DistantLight, EnvironmentLight, Light, PointLight
from volillum_addon.core.medium import Medium
from volillum_addon.core.scene import Scene
from volillum_addon.models.exact import exact
from volillum_addon.models.illuminate import bake
from volillum_addon.models.progressive import photon_state


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


def about(axis: NDArray[np.float64], g: float, count: int) -> tuple[NDArray, NDArray]:
    """Directions [n, 3], half of them even, half about `axis` as Henyey and Greenstein's function
    of g has them, and their weights, whose mean is 1; stratified."""
    random = np.random.default_rng(0)
    u = (np.arange(count) + random.random(count)) / count
    even, peaked = 2 * u - 1, (1 + g * g - ((1 - g * g) / (1 - g + 2 * g * u)) ** 2) / (2 * g)
    cosine = np.concatenate([even, peaked])
    phi = 2 * math.pi * random.random(2 * count)
    across = np.cross(axis, [1.0, 0.0, 0.0])
    across /= np.linalg.norm(across)
    up, sine = np.cross(axis, across), np.sqrt(1 - cosine**2)
    directions = cosine[:, None] * axis + sine[:, None] * (
        np.cos(phi)[:, None] * across + np.sin(phi)[:, None] * up
    )
    return directions, 2 / (1 + (1 - g * g) / (1 + g * g - 2 * g * cosine) ** 1.5)


@pytest.mark.parametrize(("g", "peak"), [(0.95, 0.85), (-0.8, -0.6)])
def test_the_remainder_is_as_large_as_reported(g: float, peak: float) -> None:
    """What the bands above 2 would add, over all views, against the judge: within a factor of 2.

    Two bands do not tell a series; a factor of 2 tells a tenth of the light from half of it.
    """
    toward = np.array([0.3, 0.2, 0.9]) / np.linalg.norm([0.3, 0.2, 0.9])
    scene = Scene(replace(MEDIUM, g=g), (DistantLight(toward, 3.0),))
    volume = bake(scene, MODEL, photons=20_000, near=16)
    (note,) = [note for note in volume.notes if "the others are estimated at" in note]
    reported = float(note.split("estimated at ")[1].split(" %")[0]) / 100
    matter = np.argwhere(volume.medium.sigma_t.values > 0)
    views, weights = about(-toward, peak, 30)
    index = matter[np.random.default_rng(1).integers(0, len(matter), 12 * len(views))]
    points = volume.medium.sigma_t.to_world(index.astype(np.float64))
    truth = exact(scene, MODEL, points, samples=512, view=np.repeat(views, 12, axis=0))
    seen = np.concatenate([
        volume.in_scattered(view=view).values[tuple(some.T)]
        for view, some in zip(views, index.reshape(-1, 12, 3), strict=True)
    ])  # fmt: skip
    squares = ((seen - truth.value) ** 2 - truth.standard_error**2)[:, 0]
    mean = volume.mean_over_views().values[tuple(matter.T)].astype(np.float64)
    actual = math.sqrt(float(np.mean(np.repeat(weights, 12) * squares)) / float((mean**2).mean()))
    assert actual / 2 < reported < actual * 2, (actual, reported)
