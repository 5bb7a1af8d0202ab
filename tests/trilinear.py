"""The trilinear medium and integrals along rays through it, in numpy: truth for the native code.

A ray is cut where any index coordinate is an integer (sorted, no stepping), and each piece is
integrated by Gauss-Legendre quadrature of a higher order than its polynomial needs.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def affine(seed: int, mirrored: bool = False) -> Array:
    """A rotated, sheared, oblong, translated map of either handedness."""
    rng = np.random.default_rng(seed)
    rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    shear = np.eye(3) + np.triu(rng.uniform(-0.6, 0.6, (3, 3)), 1)
    linear = rotation @ shear @ np.diag([0.5, 0.8, 1.3])
    if (np.linalg.det(linear) < 0) != mirrored:
        linear[:, 0] *= -1
    result = np.eye(4)
    result[:3, :3], result[:3, 3] = linear, rng.normal(size=3)
    return result


def interpolate(values: NDArray[np.float32], index: Array) -> Array:
    """Values of grids [..., nx, ny, nz] at continuous indices [*points, 3], as [..., *points].

    Zero outside the grid.
    """
    shape = np.array(values.shape[-3:])
    grids = values.reshape(-1, *shape).astype(np.float64)
    padded = np.pad(grids, [(0, 0), (2, 2), (2, 2), (2, 2)])
    points = np.clip(index.reshape(-1, 3), -1.5, shape + 0.5) + 2
    low = np.floor(points).astype(int)
    fraction = points - low
    result = np.zeros((len(grids), len(points)))
    for corner in np.ndindex(2, 2, 2):
        weight = np.prod(np.where(corner, fraction, 1 - fraction), axis=-1)
        i, j, k = (low + corner).T
        result += weight * padded[:, i, j, k]
    return result.reshape(values.shape[:-3] + index.shape[:-1])


class Ray:
    """A world ray through a lattice, cut into pieces inside single cells."""

    def __init__(
        self,
        shape: tuple[int, ...],
        index_to_world: Array,
        origin: Array,
        direction: Array,
        radius: float = np.inf,
    ) -> None:
        inverse = np.linalg.inv(index_to_world)
        self.origin = inverse[:3, :3] @ origin + inverse[:3, 3]
        self.direction = inverse[:3, :3] @ direction
        begin, end = 0.0, radius
        cuts = []
        for axis in range(3):
            slope, start = self.direction[axis], self.origin[axis]
            if slope == 0:
                if not -1 < start < shape[axis]:
                    end = -1.0
                continue
            planes = np.sort((np.arange(-1, shape[axis] + 1) - start) / slope)
            begin, end = max(begin, planes[0]), min(end, planes[-1])
            cuts.append(planes)
        inside = np.concatenate(cuts)
        inside = inside[(inside > begin) & (inside < end)]
        ends = [begin, end] if begin < end else []
        self.cuts = np.unique(np.concatenate([inside, ends]))

    def at(self, t: Array) -> Array:
        """Continuous indices [..., 3] at world distances t."""
        return self.origin + t[..., None] * self.direction

    def nodes(self, order: int, halvings: int = 0) -> tuple[Array, Array, Array]:
        """Starts [n], abscissae [n, order] and weights [n, order] of the pieces."""
        cuts = self.cuts
        if halvings and len(cuts):
            steps = np.linspace(0, 1, 2**halvings, endpoint=False)
            fine = cuts[:-1, None] + steps * np.diff(cuts)[:, None]
            cuts = np.append(fine.ravel(), cuts[-1])
        x, w = np.polynomial.legendre.leggauss(order)
        size = np.diff(cuts)[:, None]
        return cuts[:-1], cuts[:-1, None] + size * (x + 1) / 2, size * w / 2

    def optical_depth(self, sigma_t: NDArray[np.float32]) -> float:
        """Exact: cubic pieces, and 3 points integrate degree 5."""
        _, t, weight = self.nodes(3)
        return float((weight * interpolate(sigma_t, self.at(t))).sum())


def camera(
    centre: Array, size: float, seed: int, pixels: tuple[int, int], perspective: bool
) -> Array:
    """Rays [6, 3] of a camera at distance 2 `size` that sees about `size` around `centre`."""
    width, height = pixels
    rng = np.random.default_rng(seed)
    forward, right, down = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    corner = -(right + down) * size / 2
    across, along = right * size / width, down * size / height
    eye = centre - 2 * size * forward
    zero = np.zeros(3)
    if perspective:
        return np.array([eye, zero, zero, 2 * size * forward + corner, across, along])
    return np.array([eye + corner, across, along, 3 * forward, zero, zero])


def camera_ray(rays: Array, u: float, v: float) -> tuple[Array, Array]:
    """Origin and unit direction through image position (u, v)."""
    toward = rays[3] + u * rays[4] + v * rays[5]
    return rays[0] + u * rays[1] + v * rays[2], toward / np.linalg.norm(toward)
