"""The sweep as a user would write it with numpy or scipy: light that walks from slice to slice.

Optical depth is shifted by the direction's slope at every slice, so that it is interpolated again
and again; the sweep interpolates it once. One thread, as these libraries work.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

Plane = NDArray[np.float32]
Shift = Callable[[Plane, float, float], Plane]


def shift_by_numpy(plane: Plane, rows: float, columns: float) -> Plane:
    """plane[b + rows, c + columns], bilinear, zero outside; shifts within [-1, 1]."""
    row, column = int(np.floor(rows)), int(np.floor(columns))
    f, g = np.float32(rows - row), np.float32(columns - column)
    size_b, size_c = plane.shape
    padded = np.pad(plane, ((1, 2), (1, 2)))
    across = (1 - g) * padded[:, 1 + column : 1 + column + size_c]
    across += g * padded[:, 2 + column : 2 + column + size_c]
    shifted = (1 - f) * across[1 + row : 1 + row + size_b]
    shifted += f * across[2 + row : 2 + row + size_b]
    return np.asarray(shifted, np.float32)


def shift_by_scipy(plane: Plane, rows: float, columns: float) -> Plane:
    """The same by scipy.ndimage.shift."""
    return np.asarray(ndimage.shift(plane, (-rows, -columns), order=1, mode="grid-constant"))


def march(
    sigma_t: NDArray[np.float32],
    direction: NDArray[np.float64],
    shift: Shift,
    out: NDArray[np.float32],
) -> None:
    """Writes the transmittance from every voxel along a direction, for voxels of side 1."""
    axis = int(np.argmax(np.abs(direction)))
    forward = direction[axis] > 0
    length = 1 / abs(direction[axis])
    rows, columns = np.delete(direction, axis) * length
    medium = np.moveaxis(sigma_t, axis, 0)[:: -1 if forward else 1]
    result = np.moveaxis(out, axis, 0)[:: -1 if forward else 1]
    # Half a step behind the slice: the trapezoid rule, from the first slice's half step on.
    depth = np.zeros_like(medium[0])
    half_step = np.float32(0.5 * length)
    for sample, written in zip(medium, result, strict=True):
        half = half_step * sample
        depth = shift(depth, rows, columns) + half
        np.exp(-depth, out=written)
        depth += half
