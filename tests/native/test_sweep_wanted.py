"""Sweeps of which a part is wanted: the same there, nothing elsewhere."""

from __future__ import annotations

import numpy as np
import pytest

import volillum_native

SHAPE = (21, 37, 70)
RANDOM = np.random.default_rng(4)
SIGMA_T = RANDOM.random(SHAPE, np.float32) * np.float32(0.3)
AFFINE = np.array([[1.0, 0.2, 0, 0], [0, 0.8, 0, 0], [0.1, 0, 1.3, 0], [0, 0, 0, 1]])
DIRECTIONS = RANDOM.normal(size=(14, 3))
DIRECTIONS[:6] = np.vstack([np.eye(3), -np.eye(3)])
DIRECTIONS /= np.linalg.norm(DIRECTIONS, axis=1, keepdims=True)
BOXES = {
    "corner": ((0, 0, 0), (9, 5, 11)),
    "middle": ((7, 10, 20), (13, 30, 52)),
    "far corner": ((20, 36, 69), (21, 37, 70)),
    "plate": ((0, 17, 0), (21, 18, 70)),
    "reaching out": ((-5, 30, 60), (8, 99, 99)),
    "everything": ((0, 0, 0), SHAPE),
    "nothing": ((4, 4, 4), (4, 9, 9)),
}
# Where rows end decides which voxels are taken by whole vectors: a rounding of each sum.
ROUNDING = {"rtol": 3e-7, "atol": 1e-6}
Box = tuple[tuple[int, int, int], tuple[int, int, int]]


def inside(box: Box) -> np.ndarray:
    mask = np.zeros(SHAPE, bool)
    mask[tuple(slice(max(a, 0), max(b, 0)) for a, b in zip(*box, strict=True))] = True
    return mask


@pytest.mark.parametrize("channels", [1, 5])
@pytest.mark.parametrize("near", [0, 3])
@pytest.mark.parametrize("radius", [np.inf, 6.5])
@pytest.mark.parametrize("box", BOXES)
def test_the_same_where_it_is_wanted(box: str, radius: float, near: int, channels: int) -> None:
    weights = RANDOM.random((len(DIRECTIONS), channels), np.float32)

    def sweep(**more: object) -> np.ndarray:
        return volillum_native.sweep(
            SIGMA_T, AFFINE, DIRECTIONS, weights, radius=radius, near_slices=near, **more
        )

    everywhere, wanted = sweep(), inside(BOXES[box])
    found = sweep(wanted=BOXES[box])
    assert np.allclose(found[:, wanted], everywhere[:, wanted], **ROUNDING)
    assert not found[:, ~wanted].any()
    before = np.full_like(found, 7)
    sweep(wanted=BOXES[box], out=before, threads=3)
    assert np.array_equal(before[:, wanted], found[:, wanted])
    assert np.all(before[:, ~wanted] == 7)


@pytest.mark.parametrize("box", BOXES)
def test_the_same_with_weights_that_vary(box: str) -> None:
    nodes = [-(-(size - 1) // 8) + 1 for size in SHAPE]
    weights = RANDOM.random((len(DIRECTIONS), *nodes), np.float32)
    weights[RANDOM.random(weights.shape) < 0.7] = 0
    everywhere = volillum_native.sweep_weighted(SIGMA_T, AFFINE, DIRECTIONS, weights, 8)
    found = volillum_native.sweep_weighted(
        SIGMA_T, AFFINE, DIRECTIONS, weights, 8, wanted=BOXES[box]
    )
    wanted = inside(BOXES[box])
    assert np.allclose(found[wanted], everywhere[wanted], **ROUNDING)
    assert not found[~wanted].any()


def test_emptiness_in_the_wanted_part() -> None:
    """Where nothing lies along any direction the sums are of the weights alone."""
    clear = np.zeros(SHAPE, np.float32)
    weights = np.ones((len(DIRECTIONS), 1), np.float32)
    found = volillum_native.sweep(clear, AFFINE, DIRECTIONS, weights, wanted=BOXES["middle"])
    wanted = inside(BOXES["middle"])
    assert np.all(found[0][wanted] == len(DIRECTIONS))
    assert not found[0][~wanted].any()
