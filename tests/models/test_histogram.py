"""Histograms of neighbourhoods: dot products with them are full bakes of ambient occlusion."""

from __future__ import annotations

import math

import numpy as np
import pytest
from media import smooth_random
from trilinear import affine

from volillum_addon.core.errors import InputError
from volillum_addon.core.grid import Grid
from volillum_addon.core.lights import DistantLight, EnvironmentLight
from volillum_addon.core.native import native
from volillum_addon.core.scene import Scene
from volillum_addon.core.transfer_function import TransferFunction
from volillum_addon.models.histogram import Histogram, bake_histogram
from volillum_addon.models.illuminate import VOID_MARGIN, bake
from volillum_addon.models.volume import IlluminationVolume

LIGHTS = (EnvironmentLight((0.3, 0.2, 0.1)), DistantLight((0, 0.6, 0.8), 2.0))
CENTRES = (0.1, 0.25, 0.5, 0.8, 0.9)
# The bins and the full bake are rounded to float32 (6e-8) after transforms in float64, and so are
# the weights; sums of five products add as many roundings again.
ROUNDING = 1e-6


def random_data(seed: int = 1) -> Grid:
    """Values from 0 to 1, smooth and with noise, on an oblique lattice."""
    random = np.random.default_rng(seed)
    smooth = smooth_random((14, 11, 12), seed=seed).sigma_t.values
    values = smooth / smooth.max() * 0.8 + 0.2 * random.random(smooth.shape)
    return Grid(values.astype(np.float32), affine(3), "data")


def random_transfer(seed: int, depth: float = 3.0, grey: bool = False) -> TransferFunction:
    """Points at the bins, the first without matter; albedo by value."""
    random = np.random.default_rng(seed)
    density = random.random(len(CENTRES))
    density[0] = 0.0
    albedo = random.random((len(CENTRES), 1 if grey else 3)) * np.ones(3)
    return TransferFunction(CENTRES, density, albedo, per_voxel=depth)


def histogram(data: Grid, products: bool = True, weight_p: int = 1) -> Histogram:
    radius = 3.4 * float(data.voxel_size.mean())
    return bake_histogram(data, CENTRES, radius, weight_p, products=products)


def full(histogram: Histogram, transfer: TransferFunction, **given: object) -> IlluminationVolume:
    """The same by a bake of the medium, whose lattice is a box of the data's."""
    scene = Scene(transfer.medium(histogram.data), LIGHTS)
    chosen = {"radius": histogram.radius, "weight_p": histogram.weight_p, **given}
    return bake(scene, "ambient_occlusion", **chosen)


def shared(found: IlluminationVolume, expected: IlluminationVolume, name: str) -> np.ndarray:
    """The channel of `found` at the voxels of `expected`."""
    grid, lattice = found.channels[name], expected.medium.sigma_t
    low = np.rint(grid.to_index(lattice.to_world(np.zeros(3)))).astype(int)
    box = tuple(slice(a, a + n) for a, n in zip(low, lattice.shape, strict=True))
    return np.asarray(grid.values[box])


@pytest.mark.parametrize("weight_p", [0, 1, 2])
def test_dot_products_are_full_bakes(weight_p: int) -> None:
    """The linear law, for several transfer functions from one histogram."""
    bins = histogram(random_data(), weight_p=weight_p)
    for seed in range(3):
        transfer = random_transfer(seed)
        found = bins.illumination(transfer, LIGHTS, opacity="linear", bleeding=0.5)
        expected = full(bins, transfer, opacity="linear", bleeding=0.5)
        for name in ("openness", "bleeding"):
            truth = expected.channels[name].values
            scale = max(1.0, float(np.abs(truth).max()))
            assert np.allclose(shared(found, expected, name), truth, rtol=0, atol=ROUNDING * scale)
        assert found.radiance == expected.radiance
        assert found.notes == ()


def test_opacities_are_interpolated_between_the_bins() -> None:
    """Too low by at most delta^2 / 8 of the mean, and exact where nothing lies between bins."""
    data = random_data()
    bins = histogram(data)
    for seed, depth in ((1, 0.3), (2, 1.0)):
        transfer = random_transfer(seed, depth)
        expected = full(bins, transfer)
        found = shared(bins.illumination(transfer, LIGHTS), expected, "openness")
        excess = found - expected.channels["openness"].values
        delta = np.diff(np.asarray(transfer.density)) * transfer.per_length(data)
        # Alpha's reference length is the cube root of a voxel's volume.
        delta = delta * abs(np.linalg.det(data.index_to_world[:3, :3])) ** (1 / 3)
        # Single precision of a full bake of opacities.
        assert excess.min() > -ROUNDING
        assert 1e-4 < excess.max() < (delta**2).max() / 8 + ROUNDING
    labels = np.random.default_rng(4).choice(CENTRES, data.shape).astype(np.float32)
    bins = histogram(data.with_values(labels))
    transfer = random_transfer(3)
    expected = full(bins, transfer, bleeding=1.0)
    found_volume = bins.illumination(transfer, LIGHTS, bleeding=1.0)
    for name in ("openness", "bleeding"):
        truth = expected.channels[name].values
        assert np.allclose(shared(found_volume, expected, name), truth, rtol=0, atol=ROUNDING)


def test_grey_albedo_bleeds_grey() -> None:
    bins = histogram(random_data())
    transfer = random_transfer(5, grey=True)
    found = bins.illumination(transfer, LIGHTS, opacity="linear", bleeding=1.0)
    expected = full(bins, transfer, opacity="linear", bleeding=1.0)
    truth = expected.channels["bleeding"].values
    assert truth.ndim == 3
    tolerance = ROUNDING * float(truth.max())
    assert np.allclose(shared(found, expected, "bleeding"), truth, rtol=0, atol=tolerance)


def test_a_new_transfer_function_needs_no_convolution(monkeypatch: pytest.MonkeyPatch) -> None:
    bins = histogram(random_data())

    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("convolved")

    monkeypatch.setattr(native, "convolve", refuse)
    one, two = (
        bins.illumination(random_transfer(seed), LIGHTS, bleeding=1.0).in_scattered().values
        for seed in (6, 7)
    )
    assert np.abs(one - two).max() > 0.01


def test_the_bins_of_a_neighbourhood_inside_the_data_sum_to_one() -> None:
    data = random_data()
    bins = bake_histogram(data, CENTRES, 1.2 * float(data.voxel_size.max()))
    # The kernel's cubature; how much of the sphere lies in the data is the mean of a field of 1.
    whole = np.ones(data.shape, np.float32)
    inside = native.convolve(
        np.pad(whole, VOID_MARGIN)[None], data.index_to_world, radius=bins.radius
    )[0]
    assert np.allclose(bins.bins.sum(axis=0), inside, atol=ROUNDING)
    assert inside.max() == pytest.approx(1, abs=3e-6)
    mean = bins.occlusion(np.ones(len(CENTRES)))
    assert np.allclose(mean.values, inside, atol=ROUNDING)
    assert np.allclose(mean.to_world(np.full(3, 2.0)), data.to_world(np.zeros(3)))


def test_what_the_bins_cannot_represent_is_said() -> None:
    data = random_data()
    bins = histogram(data)
    exact = TransferFunction(CENTRES[1:4], (0.0, 1.0, 0.5), np.full((3, 3), 0.5), 1.0)
    assert bins.illumination(exact, LIGHTS).notes == ()
    bent = TransferFunction((0.1, 0.4, 0.9), (0.0, 1.0, 0.5), np.full((3, 3), 0.5), 1.0)
    (note,) = bins.illumination(bent, LIGHTS).notes
    assert note == "Occlusion is linear between the histogram's bins, not at: 0.4"


def test_bad_input_is_named() -> None:
    data = random_data()
    with pytest.raises(InputError, match="strictly ascending"):
        bake_histogram(data, (0.0, 0.5, 0.5), 1.0)
    with pytest.raises(InputError, match="radius is 0"):
        bake_histogram(data, CENTRES, 0.0)
    with pytest.raises(InputError, match="channels is 3"):
        bake_histogram(Grid(np.ones((2, 2, 2, 3)), np.eye(4)), CENTRES, 1.0)
    bins = histogram(data, products=False)
    with pytest.raises(InputError, match="albedo varies"):
        bins.illumination(random_transfer(8), LIGHTS, bleeding=1.0)
    with pytest.raises(InputError, match="values' shape"):
        bins.occlusion(np.ones(3))
    assert math.isfinite(bins.illumination(random_transfer(8), LIGHTS).in_scattered().values.sum())
