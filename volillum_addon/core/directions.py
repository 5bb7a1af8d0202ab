"""Quadrature over directions: cones, the sphere, and cones whose axis varies between voxels."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .errors import bad
from .native import native

# Successive rings of a cone rule are turned by the golden ratio of their step, so that an edge does
# not meet aligned directions of all rings. It matters little: RMS error on knife edges of all
# azimuths, theta = 30 degrees, 16 / 64 / 256 directions: 0.035 / 0.014 / 0.0047, against
# 0.035 / 0.014 / 0.0051 without.
GOLDEN = (math.sqrt(5) - 1) / 2
# Sub-directions of a cone when it is spread over the directions of an AngularLattice: 8 x 32
# change the weights by 0.5 % RMS against 64 x 256, at random from direction to direction, so that
# sums over a cone's directions change by far less.
SPREAD_RINGS, SPREAD_PER_RING = 8, 32


def frame(axis: NDArray[np.float64]) -> NDArray[np.float64]:
    """Right-handed orthonormal rows (u, v, axis) [3, 3]; axis is a unit vector."""
    helper = np.eye(3)[int(np.argmin(np.abs(axis)))]
    u = np.cross(helper, axis)
    u /= np.linalg.norm(u)
    return np.array([u, np.cross(axis, u), axis])


def cone_rule(theta: float, directions: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Gauss (cosine) x uniform (azimuth) rule for the cone of half angle theta about +z.

    Returns about `directions` unit vectors [d, 3] and their weights [d], which sum to 1 (uniform in
    solid angle).
    """
    rings = max(1, round(math.sqrt(directions / 4)))
    per_ring = max(1, round(directions / rings))
    node, weight = np.polynomial.legendre.leggauss(rings)
    # 1 - cos(theta), without the cancellation at small angles.
    drop = 2 * math.sin(theta / 2) ** 2
    below = drop * (1 - node) / 2
    cosine = 1 - below
    sine = np.sqrt(below * (2 - below))
    turn = (np.arange(rings) * GOLDEN) % 1
    azimuth = 2 * np.pi * (np.arange(per_ring)[None] + 0.5 + turn[:, None]) / per_ring
    vectors = np.stack(
        [sine[:, None] * np.cos(azimuth), sine[:, None] * np.sin(azimuth),
         np.broadcast_to(cosine[:, None], azimuth.shape)], axis=-1)  # fmt: skip
    weights = np.broadcast_to((weight / weight.sum() / per_ring)[:, None], azimuth.shape)
    return vectors.reshape(-1, 3), np.ascontiguousarray(weights).reshape(-1)


def sphere_rule(directions: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Gauss x uniform rule on the sphere in opposite pairs, turned off the axes.

    Returns about `directions` unit vectors [d, 3] and weights [d] that sum to 1.
    """
    half = max(1, round(math.sqrt(directions / 8)))
    rings = 2 * half
    per_ring = max(2, 2 * round(directions / rings / 2))
    node, weight = np.polynomial.legendre.leggauss(rings)
    azimuth = 2 * np.pi * (np.arange(per_ring) + 0.5) / per_ring
    sine = np.sqrt(1 - node**2)
    vectors = np.stack(
        [sine[:, None] * np.cos(azimuth), sine[:, None] * np.sin(azimuth),
         np.broadcast_to(node[:, None], (rings, per_ring))], axis=-1).reshape(-1, 3)  # fmt: skip
    weights = np.repeat(weight / 2 / per_ring, per_ring)
    # Any fixed turn that lays no direction along a voxel axis or diagonal; the rule's exactness for
    # polynomials does not depend on it.
    turned = vectors @ frame(np.array([0.48, 0.36, 0.8])).T
    return turned, weights


def about(vectors: NDArray[np.float64], axis: NDArray[np.float64]) -> NDArray[np.float64]:
    """Directions [d, 3] given about +z, turned to `axis`."""
    return np.asarray(vectors @ frame(axis))


@dataclass(frozen=True, eq=False)
class AngularLattice:
    """A fixed set of directions that serves cones about many axes.

    The directions are a square lattice in Lambert's equal-area map about `pole`, so each stands for
    the same solid angle; between them a function of direction is interpolated by cubics
    (Catmull-Rom). The cone integral of that interpolant is exact, so the weights of a cone vary
    continuously with its axis and the error is third order in the lattice's spacing.
    """

    pole: NDArray[np.float64]
    spacing: float
    directions: NDArray[np.float64]
    first: NDArray[np.int64]
    size: tuple[int, int]

    @classmethod
    def covering(cls, axes: NDArray[np.float64], theta: float, per_cone: int) -> AngularLattice:
        """The lattice for cones of half angle theta about unit axes [n, 3], with about `per_cone`
        directions in each cone."""
        mean = axes.mean(axis=0)
        length = float(np.linalg.norm(mean))
        if length < 0.05:
            raise bad("the spread of axes", "all around", "a common side (the eye outside)")
        pole = mean / length
        spacing = math.sqrt(2 * math.pi * (1 - math.cos(theta)) / per_cone)
        turned = axes @ frame(pole).T
        reach = float(np.arccos(np.clip(turned[:, 2], -1, 1)).max()) + theta
        radius = 2 * math.sin(min(reach, math.pi) / 2) + 2.5 * spacing
        limit = math.ceil(radius / spacing)
        lattice = np.arange(-limit, limit + 1)
        u, v = np.meshgrid(lattice * spacing, lattice * spacing, indexing="ij")
        rho = np.minimum(np.hypot(u, v), 2.0)
        scale = np.sqrt(np.maximum(0.0, 1 - rho**2 / 4)) * np.where(np.hypot(u, v) > 2, 0, 1)
        flat = np.stack([u * scale, v * scale, 1 - rho**2 / 2], axis=-1)
        flat[..., 2] = np.where(np.hypot(u, v) > 2, -1, flat[..., 2])
        vectors = (flat / np.linalg.norm(flat, axis=-1, keepdims=True)).reshape(-1, 3) @ frame(pole)
        return cls(pole, spacing, vectors, np.array([-limit, -limit]), (len(lattice), len(lattice)))

    def cone_weights(self, axes: NDArray[np.float64], theta: float) -> NDArray[np.float32]:
        """Weights [d, n] of the lattice's directions for the uniform cones about axes [n, 3]; they
        sum to 1 for each cone."""
        local, local_weights = cone_rule(theta, SPREAD_RINGS * SPREAD_PER_RING)
        turned = axes @ frame(self.pole).T
        return native.cone_weights(
            np.ascontiguousarray(turned),
            local,
            local_weights,
            spacing=self.spacing,
            first_u=int(self.first[0]),
            first_v=int(self.first[1]),
            size_u=self.size[0],
            size_v=self.size[1],
        )
