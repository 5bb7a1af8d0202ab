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

# A Phong lobe is cut where it is exp(-LOBE_TAIL) of its peak, and represented by this many points
# and four more for each that is asked for: exact to rounding for smooth weights.
LOBE_TAIL, LOBE_POINTS = 60.0, 64


# Of the axes in `frame`: unequal, so that the directions about which frames turn endlessly fast lie
# beside the diagonals and not on them, along which lights are often set.
AXIS_WEIGHTS = np.array([1.0, 0.9, 0.8])


def frame(axis: NDArray[np.float64]) -> NDArray[np.float64]:
    """Right-handed orthonormal rows (u, v, axis) [3, 3]; axis is a unit vector.

    u and v follow the world's axes as far as those are perpendicular to `axis`, and but for quarter
    turns they never jump when it turns: u is one of the four fourth roots of the sum of the fourth
    powers, as complex numbers, of the axes' parts perpendicular to it.
    """
    helper = np.eye(3)[int(np.argmin(np.abs(axis)))]
    u = np.cross(helper, axis)
    u /= np.linalg.norm(u)
    v = np.cross(axis, u)
    turn = np.angle(AXIS_WEIGHTS @ (u + 1j * v) ** 4) / 4
    u = math.cos(turn) * u + math.sin(turn) * v
    return np.array([u, np.cross(axis, u), axis])


def cone_rule(
    theta: float, directions: int, beta: float = 0.0
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Gauss x uniform (azimuth) rule for the cone of half angle theta about +z, theta <= 90 degrees
    where beta is not 0.

    Returns about `directions` unit vectors [d, 3], a multiple of four on each ring, and their
    weights [d], which sum to 1: uniform in
    solid angle, or Phong's lobe (beta + 1) / (2 pi (1 - cos^(beta+1) theta)) cos^beta.
    """
    rings = max(1, round(math.sqrt(directions / 4)))
    # Quarter turns change nothing (`frame`).
    per_ring = 4 * max(1, round(directions / rings / 4))
    below, weight = _phong_gauss(theta, beta, rings)
    cosine = 1 - below
    sine = np.sqrt(below * (2 - below))
    turn = (np.arange(rings) * GOLDEN) % 1
    azimuth = 2 * np.pi * (np.arange(per_ring)[None] + 0.5 + turn[:, None]) / per_ring
    vectors = np.stack(
        [sine[:, None] * np.cos(azimuth), sine[:, None] * np.sin(azimuth),
         np.broadcast_to(cosine[:, None], azimuth.shape)], axis=-1)  # fmt: skip
    weights = np.broadcast_to((weight / per_ring)[:, None], azimuth.shape)
    return vectors.reshape(-1, 3), np.ascontiguousarray(weights).reshape(-1)


def _phong_gauss(
    theta: float, beta: float, points: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Gauss's rule in x = 1 - cosine of the weight (1 - x)^beta from 0 to 1 - cos(theta).

    Exact for polynomials in the cosine up to the degree 2 `points` - 1. Weights sum to 1.
    """
    # 1 - cos(theta), without the cancellation at small angles.
    end = 2 * math.sin(theta / 2) ** 2
    if beta == 0:
        node, weight = np.polynomial.legendre.leggauss(points)
        return end * (1 - node) / 2, weight / 2
    node, weight = np.polynomial.legendre.leggauss(4 * points + LOBE_POINTS)
    x = min(end, LOBE_TAIL / beta) * (1 + node) / 2
    weight = weight * np.exp(beta * np.log1p(-x))
    # Lanczos: the Jacobi matrix of this weight's orthogonal polynomials (Golub and Welsch 1969),
    # in units of the end, orthogonalised anew at each step.
    scale = float(x.max())
    basis = [np.sqrt(weight / weight.sum())]
    matrix = np.zeros((points, points))
    for row in range(points):
        rest = x / scale * basis[row]
        matrix[row, row] = rest @ basis[row]
        for _ in range(2):
            rest = rest - np.sum([(rest @ vector) * vector for vector in basis], axis=0)
        norm = float(np.linalg.norm(rest))
        if row + 1 < points:
            matrix[row, row + 1] = matrix[row + 1, row] = norm
            basis.append(rest / norm)
    value, vectors = np.linalg.eigh(matrix)
    return value * scale, vectors[0] ** 2


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
    pole, across = np.array([0.48, 0.36, 0.8]), np.array([5.0, 0.0, -3.0]) / math.sqrt(34)
    turned = vectors @ np.array([across, np.cross(pole, across), pole]).T
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

    def cone_weights(
        self, axes: NDArray[np.float64], theta: float, beta: float = 0.0
    ) -> NDArray[np.float32]:
        """Weights [d, n] of the lattice's directions for the cones about axes [n, 3], uniform or
        with Phong's lobe as in `cone_rule`; they sum to 1 for each cone."""
        local, local_weights = cone_rule(theta, SPREAD_RINGS * SPREAD_PER_RING, beta)
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

    def covered(self, axes: NDArray[np.float64], theta: float) -> NDArray[np.float32]:
        """Weights like `cone_weights` that are not negative and end half a cell beyond the cone:
        the share of each direction's cell, taken as round, that lies inside. First order in the
        lattice's spacing at edges, second in the mean over them."""
        cosine = np.clip(self.directions @ axes.T, -1, 1)
        inside = np.clip((theta - np.arccos(cosine)) / self.spacing + 0.5, 0, 1)
        return np.asarray(inside / inside.sum(axis=0), np.float32)
