"""The photon engine: furnaces, exact energy, closed forms of slabs, colours, errors."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from photon_passes import Run, random_medium, z_scores

from volillum_native import PhotonSource

# z of t distributions with 23 degrees of freedom: 6.5 is one in a million, and below 2000 voxels
# are tested at a time; the mean over all voxels at 4.5: one in 6000.
REPLICATES, EACH, MEAN = 24, 6.5, 4.5


@pytest.mark.parametrize("g", [0.0, 0.95, -0.95])
@pytest.mark.parametrize("albedo", [1.0, 0.6, 0.0])
def test_furnace(albedo: float, g: float) -> None:
    """Sky 1 and emission sigma_a: radiance is 1 everywhere, whatever the medium."""
    sigma_t = random_medium()
    sigma_s = sigma_t * np.float32(albedo)
    total = Run(sigma_t, sigma_s, PhotonSource.environment(), g=g).replicates(REPLICATES)
    if albedo < 1:
        glow = PhotonSource.emission(sigma_t - sigma_s)
        total += Run(sigma_t, sigma_s, glow, g=g).replicates(REPLICATES, 2)
    assert np.abs(z_scores(total, 1.0)).max() < EACH
    assert abs(z_scores(total.mean(axis=1), 1.0)) < MEAN


def test_furnace_without_matter_beside_matter() -> None:
    """Void voxels, empty macrocells and a grid of one voxel see the same radiance."""
    for shape in ((1, 1, 1), (20, 3, 18), (1, 1, 33)):
        sigma_t = np.zeros((1, *shape), np.float32)
        sigma_t[0, 0, 0, 0] = 30.0
        total = Run(sigma_t, sigma_t, PhotonSource.environment()).replicates(REPLICATES)
        assert np.abs(z_scores(total, 1.0)).max() < EACH


@pytest.mark.parametrize("kind", ["grey", "coloured", "chromatic"])
def test_power_is_conserved_exactly(kind: str) -> None:
    sigma_t = random_medium(channels=3 if kind == "chromatic" else 1)
    albedo = np.array([0.9, 0.5, 0.0], np.float32)[:, None, None, None]
    sigma_s = sigma_t * (np.float32(0.7) if kind == "grey" else albedo)
    run = Run(sigma_t, sigma_s, PhotonSource.environment(), g=0.3).add(0)
    tally = run.tallies[0]
    for colour in range(len(tally["emitted"])):
        spent = sum(tally[name][colour] for name in ("missed", "absorbed", "roulette", "given_up"))
        spent += sum(face[colour] for face in tally["escaped"])
        assert tally["emitted"][colour] == spent
        assert tally["absorbed"][colour] > 0
    if kind == "grey":
        # Roulette is fair: each of at most 5 plays a photon moves the sum by at most its weight.
        noise = math.sqrt(5 * run.photons)
        assert abs(tally["roulette"][0] * 2.0**-32) < 5 * noise


def slab(depth: float, albedo: float, slices: int = 4) -> tuple[NDArray, NDArray, NDArray]:
    """sigma_t, sigma_s and affine of a wide slab of this optical depth between z = 0 and 1: its
    linear ramps at both faces only stretch the depth, which is all that R and T depend on."""
    sigma_t = np.full((1, 5, 5, slices), depth, np.float32)
    affine = np.diag([1e5, 1e5, 1 / slices, 1.0])
    affine[:3, 3] = [-2e5, -2e5, 0.0]
    return sigma_t, sigma_t * np.float32(albedo), affine


def reflected_and_transmitted(
    depth: float, albedo: float, g: float, cosine: float = 1.0, passes: int = 32
) -> NDArray[np.float64]:
    """Shares of a pencil beam's power through the top and the bottom [passes, 2]."""
    sigma_t, sigma_s, affine = slab(depth, albedo)
    # From far enough that the beam's own width, 1e-6 rad, is no matter.
    sine = math.sqrt(1 - cosine**2)
    down = np.array([-sine, 0.0, -cosine])
    beam = PhotonSource.spot(-10 * down, down, math.cos(1e-3), 0.0)
    run = Run(sigma_t, sigma_s, beam, g=g, affine=affine).add(*range(passes))
    return np.array(
        [[t["escaped"][5][0] / t["emitted"][0], t["escaped"][4][0] / t["emitted"][0]]
         for t in run.tallies]
    )  # fmt: skip


@pytest.mark.parametrize(
    ("depth", "albedo", "g", "cosine", "reflected", "transmitted"),
    [
        (1.0, 0.9, 0.0, 1.0, 0.2674103351, 0.5916250896),  # H1
        (1.0, 0.5, 0.0, 1.0, 0.09911918554, 0.4460583899),
        (1.0, 1.0, 0.0, 1.0, 0.3413287598, 0.6586712402),
        (4.0, 0.9, 0.0, 1.0, 0.4081422058, 0.128523697),
        # H3, DISORT 1a and 1c: diffuse fluxes over the incident pi, and the direct beam.
        (0.03125, 0.2, 0.0, 0.1, 0.07987185984 / math.pi,
         0.07935860072 / math.pi + math.exp(-0.3125)),
        (0.03125, 0.99, 0.0, 0.1, 0.4183356859 / math.pi,
         0.4157715351 / math.pi + math.exp(-0.3125)),
        (2.0, 0.9, 0.75, 1.0, 0.0973946391, 0.6609576998),  # I1, van de Hulst
        (1.0, 0.9, 0.5, 1.0, 0.129793280, 0.739091121),  # I3
        (2.0, 0.99, 0.8, 1.0, 0.120110721, 0.851870827),
    ],
)  # fmt: skip
def test_slab_reflects_and_transmits(
    depth: float, albedo: float, g: float, cosine: float, reflected: float, transmitted: float
) -> None:
    found = reflected_and_transmitted(depth, albedo, g, cosine)
    assert np.abs(z_scores(found, np.array([reflected, transmitted]))).max() < MEAN
    # 320,000 photons: sqrt(0.25 / 320,000) = 9e-4.
    assert found.std(axis=0, ddof=1).max() / math.sqrt(len(found)) < 1e-3


@pytest.mark.parametrize("g", [0.95, -0.95])
def test_strong_anisotropy_has_the_mean_cosine_g(g: float) -> None:
    """Single scattering of a thin slab: the share scattered forward follows from g alone."""
    found = reflected_and_transmitted(0.02, 1.0, g, passes=64)
    # Backward share of Henyey-Greenstein, (1 - g) / (2 g) ((1 + g) / sqrt(1 + g^2) - 1), of the
    # collided 1 - e^-0.02. The second order is 1 % of it, within the noise below.
    backward = (1 - g) / (2 * g) * ((1 + g) / math.sqrt(1 + g * g) - 1)
    expected = (1 - math.exp(-0.02)) * backward
    mean, error = found[:, 0].mean(), found[:, 0].std(ddof=1) / math.sqrt(len(found))
    assert abs(mean - expected) < MEAN * error + 0.02 * expected


def test_each_colour_is_the_run_of_its_own_channel() -> None:
    """Three extinctions along one path have the means of three grey runs."""
    sigma_t = random_medium(6, 3) * np.array([0.2, 1.0, 4.0], np.float32)[:, None, None, None]
    sigma_s = sigma_t * np.array([0.9, 0.5, 0.99], np.float32)[:, None, None, None]
    sun = PhotonSource.distant(np.array([0.6, 0.0, 0.8]), 1.0)
    for g, unscattered in ((0.0, True), (0.7, False)):
        settings = {"g": g, "unscattered": unscattered}
        together = Run(sigma_t, sigma_s, sun, **settings).replicates(REPLICATES)
        for colour in range(3):
            one = slice(colour, colour + 1)
            alone = Run(sigma_t[one], sigma_s[one], sun, **settings).replicates(REPLICATES, seed=5)
            difference = together[..., colour] - alone[..., 0]
            assert np.abs(z_scores(difference, 0.0)).max() < EACH
            assert abs(z_scores(difference.mean(axis=1), 0.0)) < MEAN


def test_coloured_albedo_is_the_run_of_its_own_channel() -> None:
    sigma_t = random_medium(6)
    albedo = np.array([0.95, 0.5, 0.1], np.float32)[:, None, None, None]
    sky = PhotonSource.environment()
    together = Run(sigma_t, sigma_t * albedo, sky).replicates(REPLICATES)
    for colour in range(3):
        alone = Run(sigma_t, sigma_t * albedo[colour], sky).replicates(REPLICATES, seed=5)
        difference = together[..., colour] - alone[..., 0]
        assert np.abs(z_scores(difference, 0.0)).max() < EACH


def test_moments_of_an_uneven_sky() -> None:
    """In a vacuum the moments are those of the image: sqrt(4 pi) Y_lm of outward directions."""
    from volillum_addon.core import harmonics
    from volillum_addon.core.lights import EnvironmentLight

    image = np.random.default_rng(3).random((4, 8, 3)) ** 3
    turn = np.linalg.qr(np.random.default_rng(4).normal(size=(3, 3)))[0]
    light = EnvironmentLight(image, turn)
    empty = np.zeros((1, 3, 4, 2), np.float32)
    source = PhotonSource.image(image, turn)
    found = Run(empty, empty, source, moments=9).replicates(REPLICATES)
    truth = light.harmonics()[: harmonics.count(2)] / math.sqrt(4 * math.pi)
    # `harmonics` takes each pixel's centre, photons its whole area; the mean of Y_1 and Y_2 over
    # pixels 45 degrees wide lies up to 6 and 18 % lower, so band 0 is tested here exactly and the
    # others against sub-pixels.
    fine = EnvironmentLight(np.repeat(np.repeat(image, 32, 0), 32, 1), turn)
    exact = fine.harmonics()[: harmonics.count(2)] / math.sqrt(4 * math.pi)
    assert np.allclose(exact[0], truth[0], rtol=1e-3)
    # The fine image's rows have other solid angles than the coarse pixel, the light within the
    # pixel is uniform in solid angle: both agree to the square of 1.4 degrees.
    z = z_scores(found.mean(axis=1), exact)
    assert np.abs(z).max() < MEAN


def test_standard_errors_are_calibrated() -> None:
    """The variance that 8 passes tell is the variance between 400 runs, voxel by voxel."""
    sigma_t = random_medium(3)
    runs, passes = 400, 8
    means, variances = [], []
    for seed in range(runs):
        run = Run(sigma_t, sigma_t * np.float32(0.8), PhotonSource.environment(), photons=300)
        run.add(*range(passes), seed=seed)
        mean = run.sums[:, 0].astype(np.float64) / passes
        means.append(mean)
        variances.append(run.deviations[:, 0].astype(np.float64) / passes / (passes - 1))
    ratio = np.mean(variances, axis=0) / np.var(means, axis=0, ddof=1)
    # Relative standard deviation of a variance from 400 nearly normal means: sqrt(2 / 399) = 0.07.
    # 60 voxels: 4.5 of them; their mean, were they one, at most as far.
    assert np.abs(ratio - 1).max() < 4.5 * 0.071
    assert abs(ratio.mean() - 1) < 3 * 0.071


def test_an_opaque_medium_is_bounded() -> None:
    """Optical depth 1e6 a voxel: nothing but the surface is lit, and no voxel beyond the sky."""
    sigma_t = np.full((1, 6, 6, 6), 1e7, np.float32)
    sigma_t[:, :2] = 0
    found = Run(sigma_t, sigma_t * np.float32(0.9), PhotonSource.environment()).replicates(8)
    assert np.all(np.isfinite(found))
    assert found.mean(axis=0).max() < 1.1
    assert found[:, -1].max() == 0  # a voxel of the far corner is dark: its border box is inside
