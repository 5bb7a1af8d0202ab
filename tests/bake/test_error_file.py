"""Errors in the field against full scattering: their sign, unit and noise, and the reference."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from media import smooth_random

from volillum_addon.bake.error_file import ERROR, REFERENCE, error_file, measure, reference_file
from volillum_addon.bake.grids import read_grid
from volillum_addon.bake.run import bake_file, baked_volume
from volillum_addon.core.camera import Camera
from volillum_addon.core.colour import LUMINANCE
from volillum_addon.core.control import Control
from volillum_addon.core.errors import InputError
from volillum_addon.core.lights import DistantLight, EnvironmentLight
from volillum_addon.core.medium import Medium
from volillum_addon.core.scene import Scene
from volillum_addon.models.exact import exact
from volillum_addon.models.illuminate import bake
from volillum_addon.models.volume import STANDARD_ERROR, RadianceTerm

# Fine enough for the mean over a voxel to be the value at its middle, within some per mille.
SHAPE = (22, 20, 18)


@pytest.fixture(scope="module")
def scene() -> Scene:
    density = smooth_random(SHAPE, 3, 3.0).sigma_t
    colours = density.values[..., None] * np.array([0.9, 0.7, 0.5], np.float32)
    medium = Medium(density, density.with_values(colours))
    lights = (DistantLight((1, 2, 3), (3.0, 2.0, 1.0)), EnvironmentLight((0.2, 0.3, 0.5)))
    return Scene(medium, lights, Camera((5, -6, 4), (0, 0, 0)))


@pytest.fixture(scope="module")
def reference(scene: Scene, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("reference")
    return reference_file(scene, folder, "smooth", 0.01, 60, 1, Control())


def test_the_reference_is_full_scattering_within_its_noise(scene: Scene, reference: Path) -> None:
    volume = baked_volume(scene, reference)
    noise = volume.relative_standard_error()
    assert noise is not None
    assert noise < 0.01
    index = np.random.default_rng(5).integers(2, np.array(volume.medium.sigma_t.shape) - 2, (48, 3))
    where = volume.medium.sigma_t.to_world(index.astype(np.float64))
    truth = exact(scene, REFERENCE, where, samples=2048)
    found = volume.in_scattered().values[tuple(index.T)].astype(np.float64)
    spread = np.hypot(truth.standard_error, volume.channels[STANDARD_ERROR].values[tuple(index.T)]
                      .reshape(len(index), -1))  # fmt: skip
    score = (found - truth.value) / np.hypot(spread, 0.002 * truth.value)
    # The mean of 48 squares, of three colours that share their paths: 1 with a deviation of 0.2.
    assert np.mean(score**2) < 2
    assert np.abs(score.mean()) < 4 / np.sqrt(len(index))


def test_errors_are_signed_in_units_of_full_scattering(scene: Scene, reference: Path) -> None:
    full = baked_volume(scene, reference)
    matter = full.medium.sigma_t.values > 0
    luminance = full.in_scattered().values.astype(np.float64) @ LUMINANCE
    unit = np.sqrt(np.mean(luminance[matter] ** 2))
    exact_full = replace(full, channels={
        name: grid if name != STANDARD_ERROR else grid.with_values(0 * grid.values)
        for name, grid in full.channels.items()
    })  # fmt: skip
    for factor in (1.5, 0.25, 1.0):
        terms = tuple(
            RadianceTerm(term.factors, tuple(factor * w for w in term.weight), term.angular)
            for term in exact_full.radiance
        )
        error, figures = measure(exact_full.with_radiance(terms), exact_full, scene)
        wanted = (factor - 1) * luminance / unit
        np.testing.assert_allclose(error[matter], wanted[matter], rtol=1e-4, atol=1e-6)
        assert figures["mean"] == pytest.approx(wanted[matter].mean(), rel=1e-4, abs=1e-6)
        assert figures["rms"] == pytest.approx(abs(factor - 1), rel=1e-4, abs=1e-6)
        assert figures["noise"] == 0


def test_noise_is_no_error(scene: Scene, reference: Path, tmp_path: Path) -> None:
    """Other photons of the same equation: what is left when their noise is taken off."""
    own = bake_file(
        scene, REFERENCE, tmp_path, "smooth", {"passes": 16, "noise_seed": 0, "directions": 1024}
    )
    found = error_file(scene, own.path, reference)
    noise = [baked_volume(scene, path).relative_standard_error() for path in (own.path, reference)]
    assert found.noise == pytest.approx(np.hypot(*noise), rel=0.3)  # luminance against colours
    assert found.rms < 0.6 * found.noise
    assert abs(found.mean) < found.noise


def test_the_file_is_found_again_and_follows_the_lights(
    scene: Scene, reference: Path, tmp_path: Path
) -> None:
    own = bake_file(scene, "spherical_harmonics", tmp_path, "smooth", {"directions": 8})
    found = error_file(scene, own.path, reference)
    state = found.path.stat()
    assert error_file(scene, own.path, reference) == found
    assert found.path.stat() == state
    grid = read_grid(found.path, ERROR)
    volume, full = (baked_volume(scene, path) for path in (own.path, reference))
    difference = (volume.in_scattered().values - full.in_scattered().values) @ LUMINANCE
    assert np.corrcoef(grid.values.ravel(), difference.ravel())[0, 1] > 0.999
    dim = replace(scene, lights=(scene.lights[0],))
    other = error_file(dim, own.path, reference)
    assert other.path != found.path
    assert other.rms != found.rms


def test_what_cannot_be_compared_is_refused(scene: Scene, reference: Path) -> None:
    full = baked_volume(scene, reference)
    small = bake(Scene(smooth_random((8, 8, 8), 1), scene.lights), "spherical_harmonics")
    with pytest.raises(InputError, match="the reference's voxels"):
        measure(full, small, scene)
    dark = full.with_radiance(())
    with pytest.raises(InputError, match="0 everywhere"):
        measure(full, dark, scene)
