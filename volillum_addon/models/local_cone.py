"""Cones whose axis points, from every voxel, to one place: an eye, or a lamp.

No fixed set of directions is the cone of every voxel. Visibility along a fixed lattice of
directions is weighted, voxel by voxel, by weights that are interpolated between nodes
(core/directions.py, AngularLattice).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..core.control import Control
from ..core.directions import AngularLattice
from ..core.errors import InputError
from ..core.grid import Grid, Region
from ..core.native import native

# The weights are interpolated between nodes whose axes differ by at most this share of the angular
# lattice's spacing (measured on a smooth field of 64 voxels: 0.03 % RMS, of 0.19 % in all).
AXIS_STEP = 0.4
WIDEST_NODE_SPACING = 16
# The place must keep this many node spacings away from the voxels, or the axis turns too fast.
CLOSEST = 1.0
# Voxels from the box of the centres that are rounding.
ON_VOXEL = 1e-6


@dataclass(frozen=True, eq=False)
class LocalCones:
    """Directions [d, 3] and their weights [d, a, b, c] at nodes every `spacing` voxels, for the
    cones of a grid's voxels toward `place`."""

    place: NDArray[np.float64]
    directions: NDArray[np.float64]
    weights: NDArray[np.float32]
    spacing: int


def node_spacing(
    grid: Grid, place: NDArray[np.float64], theta: float, count: int, name: str, advice: str
) -> int:
    """Voxels between the nodes of the weights.

    Raises InputError, about `name` and with `advice`, when the place is so near that the cone's
    axis is not smooth between voxels.
    """
    nearest = np.clip(grid.to_index(place), 0, np.array(grid.shape) - 1)
    distance = float(np.linalg.norm(place - grid.to_world(nearest)))
    angle = math.sqrt(2 * math.pi * (1 - math.cos(theta)) / count)
    voxel = float(grid.voxel_size.max())
    spacing = min(WIDEST_NODE_SPACING, int(AXIS_STEP * angle * distance / voxel))
    if spacing < 1 or distance < CLOSEST * spacing * voxel:
        inside = distance < ON_VOXEL * voxel
        where = "inside the volume" if inside else f"{distance:.4g} from the volume"
        raise InputError(
            f"{name} is {where}, whose voxels are {voxel:.4g}; expected at "
            f"least {voxel / (AXIS_STEP * angle):.4g} from them: the cone toward it turns too fast "
            f"there ({advice})"
        )
    return spacing


def local_cones(
    grid: Grid,
    place: NDArray[np.float64],
    theta: float,
    count: int,
    name: str,
    advice: str,
    covered: bool = False,
    beta: float = 0.0,
) -> LocalCones:
    """Cones of half angle theta toward `place`, about `count` directions in each; may raise what
    `node_spacing` does. `covered`: weights that are not negative, and fewer directions beyond the
    cones, in place of those that are exact for cubics. `beta`: Phong's lobe instead of an even
    cone."""
    spacing = node_spacing(grid, place, theta, count, name, advice)
    nodes = [np.arange(math.ceil((n - 1) / spacing) + 1) * spacing for n in grid.shape]
    index = np.stack(np.meshgrid(*nodes, indexing="ij"), axis=-1).astype(np.float64)
    axes = place - grid.to_world(index.reshape(-1, 3))
    axes /= np.linalg.norm(axes, axis=-1, keepdims=True)
    lattice = AngularLattice.covering(axes, theta, count)
    each = (axes, theta)
    weights = lattice.covered(*each) if covered else lattice.cone_weights(*each, beta)
    used = np.abs(weights).max(axis=1) > 0
    field = np.ascontiguousarray(weights[used].reshape(-1, *(len(n) for n in nodes)))
    return LocalCones(place, np.ascontiguousarray(lattice.directions[used]), field, spacing)


def visibility(
    sigma_t: Grid,
    cones: LocalCones,
    near: int,
    control: Control,
    to_lamp: bool = False,
    wanted: Region | None = None,
) -> NDArray[np.float32]:
    """Mean transmittance over each voxel's cone, [extinction channels, i, j, k]; 0 where it is not
    wanted.

    Rays run to the border, or, `to_lamp`, to where they are nearest to the place: all that have one
    direction end on the plane through the place across it, so that what lies beyond is left out of
    the medium for that direction.
    """
    planes = np.zeros((sigma_t.channels, *sigma_t.shape), np.float32)
    for plane in range(sigma_t.channels):
        with control.stage(plane / sigma_t.channels, (plane + 1) / sigma_t.channels, "sweeping"):
            for part in parts(sigma_t, cones, control, to_lamp):
                native.sweep_weighted(
                    part.before_lamp(sigma_t, sigma_t.planes()[plane]), sigma_t.index_to_world,
                    part.directions, part.weights, cones.spacing, near_slices=near, wanted=wanted,
                    control=control.native, out=planes[plane], add=True,
                )  # fmt: skip
    # Cubic weights have negative lobes: at edges they may leave a visibility's range by 1e-3.
    return np.clip(planes, 0, 1, out=planes)


@dataclass(frozen=True, eq=False)
class Part:
    """Directions [d, 3] that see the same medium, and their weights [d, a, b, c]."""

    directions: NDArray[np.float64]
    weights: NDArray[np.float32]
    lamp: NDArray[np.float64] | None

    def before_lamp(self, grid: Grid, plane: NDArray[np.float32]) -> NDArray[np.float32]:
        """The values [..., i, j, k] that the rays see."""
        if self.lamp is None:
            return plane
        return _before_plane(grid, plane, self.lamp, self.directions[0])


def parts(grid: Grid, cones: LocalCones, control: Control, to_lamp: bool) -> Iterator[Part]:
    """All directions whose rays run to the border, and each of the others, which end at the place;
    each is a stage of the work."""
    ends = _ended(grid, cones) if to_lamp else np.zeros(len(cones.directions), bool)
    done, total = 0, len(cones.directions)
    for part in (np.flatnonzero(~ends), *np.flatnonzero(ends)[:, None]):
        if not len(part):
            continue
        with control.stage(done / total, (done + len(part)) / total, "sweeping"):
            yield Part(
                np.ascontiguousarray(cones.directions[part]),
                np.ascontiguousarray(cones.weights[part]),
                cones.place if ends[part[0]] else None,
            )
        done += len(part)


def _ended(grid: Grid, cones: LocalCones) -> NDArray[np.bool_]:
    """Which directions' end planes cut the support of the grid."""
    beyond = (grid.corners() - cones.place) @ cones.directions.T
    return np.asarray(beyond.max(axis=0) > 0)


def _before_plane(
    grid: Grid,
    plane: NDArray[np.float32],
    place: NDArray[np.float64],
    direction: NDArray[np.float64],
) -> NDArray[np.float32]:
    """The values on the near side of the plane through `place` across `direction`.

    They fall to zero over one step of the sweep's rays, half of it on either side: the trapezoid
    rule then integrates a smooth field up to the plane, to second order.
    """
    slope = direction @ grid.index_to_world[:3, :3]
    start = float(direction @ (grid.index_to_world[:3, 3] - place))
    along = np.linalg.solve(grid.index_to_world[:3, :3], direction)
    step = 1 / float(np.abs(along).max())
    i, j, k = (np.arange(n) * s for n, s in zip(grid.shape, slope, strict=True))
    distance = (start + i)[:, None, None] + j[:, None] + k
    share = np.clip(0.5 - distance / step, 0, 1).astype(np.float32)
    return np.ascontiguousarray(plane * share)
