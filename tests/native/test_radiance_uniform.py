"""The mean hue in a medium of one colour: optical depth alone must tell what radiance does."""

from __future__ import annotations

import math

import numpy as np
import pytest
from radiance_truth import REC_709
from trilinear import affine

import volillum_native as native

# Along each axis, and obliquely.
DIRECTIONS = np.array(
    [[0.3, 0.5, 0.8], [0.8, -0.4, 0.2], [-0.1, -0.9, 0.3], [0.6, 0.6, -0.6], [0, 0, 1]]
)
DIRECTIONS /= np.linalg.norm(DIRECTIONS, axis=1)[:, None]
TINT = np.array([1.2, 1.0, (1 - 0.2126 * 1.2 - 0.7152) / 0.0722])
SOURCE = np.array([0.9, 0.3, 0.1]) * TINT
COLOURED, GREY, CLEAR_IN_BLUE = (0.3, 1.0, 0.7), (1.0, 1.0, 1.0), (1.0, 0.5, 0.0)
WEIGHTS = np.array([0.1, 0.3, 0.2, 0.25, 0.15], np.float32)


def rough(shape: tuple[int, int, int], seed: int, density: float = 1.0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    values = density * rng.uniform(0, 1, shape) * (rng.uniform(size=shape) < 0.4)
    return values.astype(np.float32)


def smooth(n: int) -> np.ndarray:
    """A bump of optical depth 3 on about n voxels a side of a box of extent 1."""
    axes = ((np.arange(m) + 0.5) / m for m in (n, n + n // 4, n - n // 4))
    x, y, z = np.meshgrid(*axes, indexing="ij")
    bump = (np.sin(np.pi * x) * np.sin(np.pi * y) * np.sin(np.pi * z)) ** 2
    return (8 * bump * (1 + 0.5 * np.sin(5 * x + 3 * y) * np.cos(4 * z - 2 * x))).astype(np.float32)


def truth(
    sigma_t: np.ndarray, index_to_world: np.ndarray, extinction: np.ndarray, source: np.ndarray
) -> np.ndarray:
    """The closed form with optical depths of the exact evaluation."""
    indices = np.argwhere(np.ones(sigma_t.shape)).astype(float)
    places = indices @ index_to_world[:3, :3].T + index_to_world[:3, 3]
    mean = np.zeros((len(places), 3))
    for direction, weight in zip(DIRECTIONS, WEIGHTS, strict=True):
        toward = np.repeat(direction[None], len(places), 0)
        depth = native.exact_optical_depth(sigma_t[None], index_to_world, places, toward)
        through = np.exp(-np.asarray(depth) * extinction)
        light = TINT * through + source * (1 - through)
        total = (light @ REC_709)[:, None]
        mean += weight * np.where(total >= 1e-6, light / np.maximum(total, 1e-6), TINT)
    return np.asarray(mean.T.reshape(3, *sigma_t.shape))


@pytest.mark.parametrize("extinction", [COLOURED, GREY, CLEAR_IN_BLUE])
@pytest.mark.parametrize("shape", [(9, 11, 10), (1, 1, 40), (3, 70, 1), (1, 1, 1)])
def test_all_in_the_near_field(
    shape: tuple[int, int, int], extinction: tuple[float, float, float]
) -> None:
    """Exact: directions along all three axes, a sheared lattice, rows that are no whole vectors."""
    sigma_t, index_to_world, rgb = rough(shape, 1), affine(5, True), np.array(extinction)
    out = native.mean_hue_uniform(
        sigma_t, index_to_world, DIRECTIONS, WEIGHTS, TINT, rgb, SOURCE, near_slices=99
    )
    # Float32 depths of up to 10 err by 1e-6, and so does the light that they leave.
    assert np.allclose(out, truth(sigma_t, index_to_world, rgb, SOURCE), rtol=5e-6)


def test_an_absorber_keeps_the_lights_hue_in_the_dark() -> None:
    """Where less than 1e-6 of the light arrives; several tiles of which some hold nothing."""
    sigma_t = rough((40, 90, 70), 2, density=3.0)
    sigma_t[:, 30:60] = 0
    rgb, black = np.array(COLOURED), np.zeros(3)
    out = native.mean_hue_uniform(
        sigma_t, np.eye(4), DIRECTIONS, WEIGHTS, TINT, rgb, black, near_slices=99
    )
    expected = truth(sigma_t, np.eye(4), rgb, black)
    # Voxels whose luminance is 1e-6 to rounding fall on either side.
    assert np.isclose(out, expected, rtol=5e-5).mean() > 0.9995
    assert np.isclose(expected, TINT[:, None, None, None], rtol=1e-6).all(0).any()


@pytest.mark.parametrize("extinction", [COLOURED, GREY])
def test_agrees_with_the_radiance_sweep(extinction: tuple[float, float, float]) -> None:
    """Radiance and optical depth are interpolated differently; both converge to the same."""
    rgb = np.array(extinction)
    differences = []
    for n in (12, 24, 48):
        sigma_t = smooth(n)
        index_to_world = np.diag([*(1 / np.array(sigma_t.shape)), 1.0])
        planes = rgb.astype(np.float32)[:, None, None, None] * sigma_t
        source = SOURCE.astype(np.float32)[:, None, None, None] * planes
        lobe = (index_to_world, DIRECTIONS, WEIGHTS, TINT)
        if extinction == GREY:
            planes = sigma_t[None]
        radiance = native.mean_hue(planes, source, *lobe, near_slices=1)
        uniform = native.mean_hue_uniform(sigma_t, *lobe, rgb, SOURCE, near_slices=1)
        differences.append(math.sqrt(np.mean((radiance - uniform) ** 2)))
    # Two doublings: 16 for second order, 4 for first.
    assert differences[0] / differences[2] > 8
    assert differences[2] < 5e-4


def test_any_number_of_threads() -> None:
    sigma_t = rough((30, 50, 40), 3)
    one, three = (
        native.mean_hue_uniform(
            sigma_t, affine(9), DIRECTIONS, WEIGHTS, TINT, np.array(COLOURED), SOURCE,
            threads=threads,
        )
        for threads in (1, 3)
    )  # fmt: skip
    assert np.array_equal(one, three)


def test_vacuum_and_extremes() -> None:
    zeros = np.zeros((5, 6, 7), np.float32)
    for density in (0.0, 1e-30, 1e30):
        for source in (0 * SOURCE, 1e-30 * SOURCE, SOURCE):
            for extinction in (COLOURED, GREY, CLEAR_IN_BLUE):
                out = native.mean_hue_uniform(
                    zeros + np.float32(density), np.eye(4), DIRECTIONS, WEIGHTS, TINT,
                    np.array(extinction), source,
                )  # fmt: skip
                assert np.isfinite(out).all()
                if density < 1:
                    assert np.allclose(out, TINT[:, None, None, None], rtol=2e-6)


def test_refusals() -> None:
    rgb = np.array(COLOURED)
    good = (rough((4, 5, 6), 4), np.eye(4), DIRECTIONS, WEIGHTS, TINT, rgb, SOURCE)

    def call(position: int, value: object, **settings: object) -> None:
        arguments = list(good)
        arguments[position] = value
        native.mean_hue_uniform(*arguments, **settings)

    with pytest.raises(ValueError, match="sigma_t has shape"):
        call(0, good[0][None])
    with pytest.raises(ValueError, match="unit vectors"):
        call(2, 2 * DIRECTIONS)
    with pytest.raises(ValueError, match="one for each direction"):
        call(3, WEIGHTS[:2].copy())
    with pytest.raises(ValueError, match="extinction has shape"):
        call(5, np.ones(1))
    with pytest.raises(ValueError, match="source_function has shape"):
        call(6, np.ones(1))
    with pytest.raises(ValueError, match="near_slices"):
        call(6, SOURCE, near_slices=-1)
    control = native.Control()
    control.cancel()
    with pytest.raises(native.Cancelled):
        call(6, SOURCE, control=control)
