"""All versions of the kernels that this machine can run agree but for rounding."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import pytest
from numpy.typing import NDArray

import volillum_native

IDENTITY = np.eye(4)
BEST = volillum_native.instruction_set()
LESSER = {"x86-64-v4": ["x86-64-v3", "baseline"], "x86-64-v3": ["baseline"], "baseline": []}
# Fused multiply-adds round once where others round twice, in sums of some hundred terms.
ROUNDING = 3e-6

Results = NDArray[np.float32]


def medium() -> Results:
    return np.random.default_rng(5).random((19, 23, 37)).astype(np.float32) ** 8 * 3


def directions(count: int) -> NDArray[np.float64]:
    found = np.random.default_rng(6).normal(size=(count, 3))
    return found / np.linalg.norm(found, axis=1, keepdims=True)


def sweep(channels: int, radius: float) -> Results:
    out = volillum_native.sweep(
        medium(),
        IDENTITY,
        directions(7),
        np.random.default_rng(7).random((7, channels)).astype(np.float32),
        near_slices=2,
        radius=radius,
    )
    return np.asarray(out)


def cone() -> Results:
    axis = np.array([0.3, 0.2, 0.93])
    near = axis + 0.2 * directions(5)
    near /= np.linalg.norm(near, axis=1, keepdims=True)
    sigma_t = medium()
    out = volillum_native.cone_transport(
        np.stack([sigma_t, 0.5 * sigma_t, sigma_t]),
        0.7 * np.stack([sigma_t, 0.4 * sigma_t, sigma_t]),
        IDENTITY,
        axis / np.linalg.norm(axis),
        near,
        np.full(5, 0.2),
    )
    return np.asarray(out)


KERNELS: dict[str, Callable[[], Results]] = {
    "sweep": lambda: sweep(1, np.inf),
    "sweep, channels": lambda: sweep(6, np.inf),
    "sweep, radius": lambda: sweep(1, 6.5),
    "cone transport": cone,
    "convolution": lambda: np.asarray(
        volillum_native.convolve(medium()[None], IDENTITY, radius=5.0)
    ),
    "half balls": lambda: np.asarray(
        volillum_native.hemisphere_sums(medium()[None], medium()[None], IDENTITY, radius=4.0)
    ),
}


@pytest.fixture(autouse=True)
def unlimited() -> Iterator[None]:
    yield
    volillum_native.limit_instruction_set("x86-64-v4")


@pytest.mark.parametrize("kernel", KERNELS)
def test_versions_agree(kernel: str) -> None:
    expected = KERNELS[kernel]()
    assert np.abs(expected).max() > 0
    for level in LESSER[BEST]:
        volillum_native.limit_instruction_set(level)
        assert volillum_native.instruction_set() == level
        found = KERNELS[kernel]()
        assert np.abs(found - expected).max() < ROUNDING * np.abs(expected).max()


def test_an_unknown_level_is_refused() -> None:
    with pytest.raises(ValueError, match="most is 'sse2'; expected 'x86-64-v4', 'x86-64-v3' or"):
        volillum_native.limit_instruction_set("sse2")
