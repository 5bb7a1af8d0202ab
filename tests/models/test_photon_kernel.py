"""The progressive kernel estimate: its radii, the exponents of its noise and bias, its agreement
with the track-length estimate."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from media import smooth_random
from numpy.typing import NDArray

from volillum_addon.core.lights import DistantLight, EnvironmentLight
from volillum_addon.core.medium import Medium
from volillum_addon.core.scene import Scene
from volillum_addon.models.illuminate import bake
from volillum_addon.models.photon_kernel import OPTIMAL_ALPHA, radius
from volillum_addon.models.progressive import photon_state, refine
from volillum_native import Photons, PhotonSource

MODEL = "photon_mapping"
SMOOTH = smooth_random((9, 8, 10), 3, depth=3.0)
SKY = EnvironmentLight(1.0)
SIZE, FIRST = 17, 2.0
LAMP = np.array([8.03, 7.96, 8.01])
BLOCKS = [(2**n, 2 ** (n + 1)) for n in range(2, 6)]  # passes (4, 8] to (32, 64]


@pytest.mark.parametrize(
    ("alpha", "smallest", "variance", "squares"),
    [
        (4 / 7, 0.538118655116401, 0.04533172273228238, 0.39502606025813697),
        (2 / 3, 0.6200527058370665, 0.031725823610549306, 0.48574836471071775),
    ],
)
def test_radii_have_a_closed_form(
    alpha: float, smallest: float, variance: float, squares: float
) -> None:
    """Cases K2 to K4, 100 passes: r_N / r_1, sum of (r_1 / r_i)^3 / N^2, mean (r_i / r_1)^2."""
    found = [radius(1.0, alpha, index) for index in range(100)]
    assert found[0] == pytest.approx(1)
    for i in range(1, 100):
        assert found[i] ** 3 == pytest.approx(found[i - 1] ** 3 * (i + alpha) / (i + 1), rel=1e-12)
    assert found[-1] == pytest.approx(smallest, rel=1e-10)
    assert np.sum(np.power(found, -3.0)) / 100**2 == pytest.approx(variance, rel=1e-10)
    assert np.mean(np.square(found)) == pytest.approx(squares, rel=1e-10)
    assert pytest.approx(4 / (3 + 4)) == OPTIMAL_ALPHA
    assert radius(2.0, 1.0, 10**6) == pytest.approx(2.0)


def blocks_of(majorant: float, photons: int, replicates: int, alpha: float) -> NDArray[np.float64]:
    """In-scattered radiance round a lamp of intensity 1 in the void, the mean of each block's
    passes, [replicates, blocks, i, j, k]. Truth: 1 / (4 pi d^2)."""
    void = np.zeros((1, SIZE, SIZE, SIZE), np.float32)
    engine = Photons(void, void, np.eye(4), 0.0, majorant)
    lamp = PhotonSource.point(LAMP)
    unit = engine.deposit_unit(lamp, True) / photons
    result = np.zeros((replicates, len(BLOCKS), SIZE, SIZE, SIZE))
    deviations = np.zeros((SIZE**3, 1), np.float32)
    for seed in range(replicates):
        for block, (begin, end) in enumerate(BLOCKS):
            sums = np.zeros((SIZE**3, 1), np.float32)
            for index in range(begin, end):
                engine.run(lamp, sums, deviations, seed=seed, pass_index=index, photons=photons,
                           unscattered=True, radius=radius(FIRST, alpha, index))  # fmt: skip
            result[seed, block] = sums.reshape(SIZE, SIZE, SIZE) * (unit / (end - begin))
    return result


def slope(values: NDArray[np.float64]) -> float:
    """Exponent of N in values of the blocks."""
    return float(np.polyfit(np.log([begin for begin, _ in BLOCKS]), np.log(values), 1)[0])


def jackknife(statistic: NDArray[np.float64], count: int) -> float:
    """Standard error from the leave-one-out values of a statistic of `count` replicates."""
    return float(np.sqrt((count - 1) / count * ((statistic - statistic.mean()) ** 2).sum()))


def shell() -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
    """Voxels at a distance of 4 to 6 from the lamp, and the truth there."""
    index = np.stack(np.meshgrid(*[np.arange(SIZE)] * 3, indexing="ij"), -1)
    distance = np.linalg.norm(index - LAMP, axis=-1)
    inside = (distance >= 4) & (distance <= 6)
    return inside, 1 / (4 * math.pi * distance[inside] ** 2)


@pytest.mark.parametrize("alpha", [OPTIMAL_ALPHA, 0.3])
def test_noise_falls_with_the_power_alpha(alpha: float) -> None:
    """The variance of the mean of passes N to 2 N, and with it that of the first N, goes as
    N^-alpha; blocks of passes have no memory of the first radii. Few possible collisions, 0.02 a
    voxel: those of one photon in one ball would correlate."""
    inside, _ = shell()
    found = blocks_of(0.02, 3000, 40, alpha)[..., inside]
    count = len(found)
    measured = slope(found.var(axis=0, ddof=1).mean(axis=-1))
    left_out = np.array(
        [slope(np.delete(found, i, 0).var(axis=0, ddof=1).mean(axis=-1)) for i in range(count)]
    )
    error = jackknife(left_out, count)
    assert error < 0.05
    # Gamma(N + alpha) / Gamma(N + 1) is N^(alpha - 1) but for alpha (1 - alpha) / (2 N), at most
    # 3 % in the first block; pairs in a ball add another 3 % there: 0.03 / log(8) each.
    assert abs(measured + alpha) < 4 * error + 0.03


@pytest.mark.parametrize("alpha", [OPTIMAL_ALPHA, 0.3])
def test_bias_falls_with_the_square_of_the_radius(alpha: float) -> None:
    """r^2 / 10 times the Laplacian 2 / d^4 of 1 / d^2: (r / d)^2 / 5 of the truth, N^(-2 (1 -
    alpha) / 3)."""
    inside, truth = shell()
    found = (blocks_of(1.0, 8000, 10, alpha)[..., inside] / truth - 1).mean(axis=-1)
    count = len(found)
    total = found.sum(axis=0)
    measured = slope(total / count)
    error = jackknife(np.array([slope((total - x) / (count - 1)) for x in found]), count)
    assert error < 0.06
    # The next order is 0.43 (r / d)^2 of the first, r / d < 0.35: at most 5 % where blocks begin,
    # 0.05 / log(8) in the exponent; the radii's own next order 0.01.
    assert abs(measured + 2 * (1 - alpha) / 3) < 4 * error + 0.035
    # And its size: within the two orders and noise.
    begin = BLOCKS[0][0]
    radii = np.mean([radius(FIRST, alpha, i) ** 2 for i in range(begin, 2 * begin)])
    first = radii / 5 * (truth * 4 * math.pi).mean()
    noise = found[:, 0].std(ddof=1) / math.sqrt(count)
    assert abs(total[0] / count - first) < 4.8 * noise + 0.1 * first


@pytest.mark.parametrize("kind", ["grey", "chromatic"])
def test_it_agrees_with_track_lengths(kind: str) -> None:
    """Grey under a sky and a sun; three extinctions, forward scattering and emission."""
    sigma_t = SMOOTH.sigma_t
    if kind == "grey":
        medium = Medium.from_density(sigma_t, 1.0, 0.9)
        lights = (SKY, DistantLight((0.6, 0, 0.8), 3.0))
    else:
        colours = sigma_t.with_values(sigma_t.values[..., None] * np.float32([0.4, 1.0, 1.6]))
        albedo = np.array([0.9, 0.8, 0.5], np.float32)
        medium = Medium(colours, colours.with_values(colours.values * albedo), sigma_t, 0.5)
        lights = (DistantLight((0.6, 0, 0.8), 3.0),)
    scene = Scene(medium, lights)
    settings = {"photons": 4000, "passes": 8, "near": 16}
    kernel = {"estimate": "kernel", "radius": 0.7}
    one, two = (
        np.array([bake(scene, MODEL, noise_seed=seed, **settings, **extra)
                  .in_scattered(view=(0, 0.6, 0.8)).values for seed in range(8)], np.float64)
        for extra in ({}, kernel)
    )  # fmt: skip
    difference = two - one
    error = difference.std(axis=0, ddof=1) / math.sqrt(8)
    # A ball's mean and a box's differ by second differences (0.7^2 / 10 - 1 / 24 = 0.7 % of them).
    allowed = 0.02 * one.mean(axis=0)
    # t with 7 degrees of freedom, thousands of voxels; two of the rim may be of few photons.
    assert np.mean(np.abs(difference.mean(axis=0)) > 14 * error + allowed) < 1e-3
    whole = difference.reshape(8, -1).mean(axis=1)
    assert abs(whole.mean()) < 5.4 * whole.std(ddof=1) / math.sqrt(8) + 3e-3 * one.mean()


def test_it_is_continued_and_knows_its_error(tmp_path: Path) -> None:
    scene = Scene(replace(SMOOTH, sigma_s=SMOOTH.sigma_t), (SKY,))
    settings = {"photons": 1500, "estimate": "kernel"}
    whole = refine(photon_state(scene, settings), 16)
    first = photon_state(scene, settings)
    first.refine(5)
    first.save(tmp_path / "run.npz")
    second = photon_state(scene, settings)
    second.load(tmp_path / "run.npz")
    again = refine(second, 11)
    for name, grid in whole.channels.items():
        assert np.array_equal(grid.values, again.channels[name].values)
    halves = []
    for seed in range(8):
        volume = refine(photon_state(scene, {**settings, "noise_seed": 7 + seed}), 16)
        error = volume.channels["standard_error"].values
        other = whole.channels["standard_error"].values
        z = (volume.in_scattered().values - whole.in_scattered().values)[..., 0]
        halves.append(np.mean(z**2) / np.mean(error**2 + other**2))
    # Passes of different radii have different bias: their spread makes the error a little too
    # large, by less than (bias of a pass / its noise)^2. All eight share `whole`'s own noise.
    assert abs(np.mean(halves) - 1) < 0.2
