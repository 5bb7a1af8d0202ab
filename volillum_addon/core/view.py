"""Which part of a grid a camera sees."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from .camera import Camera
from .errors import bad
from .grid import Grid, Region, triple

# Half spaces that meet at a smaller determinant than this, as unit normals, have no corner.
PARALLEL = 1e-9
# A corner lies in the half spaces that make it up to rounding, in voxels.
SLACK = 1e-6


def seen_region(camera: Camera, grid: Grid, margin: int) -> Region:
    """The smallest index box [low, high) that holds every voxel within `margin` voxels of what the
    camera's view and the grid share; what lies behind matter counts as seen.

    Raises InputError where they share nothing, or the camera does not know its image's shape.
    """
    size = np.array(grid.shape, np.float64)
    # Interpolation reaches one voxel beyond the grid's border.
    box = np.concatenate([np.eye(3), -np.eye(3)])
    offsets = np.concatenate([np.ones(3), size])
    normals, constants = _in_index_space(_view(camera), grid)
    corners = _corners(np.concatenate([box, normals]), np.concatenate([offsets, constants]))
    if not len(corners):
        raise bad("what the camera sees of the volume", "nothing", "some of it in view")
    low = np.maximum(np.floor(corners.min(axis=0)) - margin, 0).astype(int)
    high = np.minimum(np.ceil(corners.max(axis=0)) + margin + 1, size).astype(int)
    return triple(np.minimum(low, high)), triple(high)


def _view(camera: Camera) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Half spaces n . x + c >= 0 in world space, [p, 3] and [p]: before the eye, and between the
    image's four sides."""
    if camera.aspect is None:
        raise bad("the shape of the camera's image", "not known", "an aspect")
    origin, origin_right, origin_down, ray, right, down = camera.rays(camera.aspect, 1.0)
    forward = camera.forward
    normals, points = [], []
    if not camera.orthographic:
        normals.append(forward)
        points.append(origin)
    wide, high = camera.aspect, 1.0
    for (u, v), (other_u, other_v) in zip(
        [(0, 0), (wide, 0), (wide, high), (0, high)],
        [(wide, 0), (wide, high), (0, high), (0, 0)],
        strict=True,
    ):
        point = origin + u * origin_right + v * origin_down
        across = (other_u - u) * (right + origin_right) + (other_v - v) * (down + origin_down)
        normals.append(np.cross(ray + u * right + v * down, across))
        points.append(point)
    unit = np.array(normals) / np.linalg.norm(normals, axis=1, keepdims=True)
    # The middle of the image is inside, one step before the eye.
    middle = (
        origin + wide / 2 * origin_right + high / 2 * origin_down
        + ray + wide / 2 * right + high / 2 * down
    )  # fmt: skip
    constants = -np.einsum("pi,pi->p", unit, np.array(points))
    sign = np.where(unit @ middle + constants < 0, -1.0, 1.0)
    return unit * sign[:, None], constants * sign


def _in_index_space(
    half_spaces: tuple[NDArray[np.float64], NDArray[np.float64]], grid: Grid
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    normals, constants = half_spaces
    linear, origin = grid.index_to_world[:3, :3], grid.index_to_world[:3, 3]
    turned, moved = normals @ linear, constants + normals @ origin
    length = np.linalg.norm(turned, axis=1)
    return turned / length[:, None], moved / length


def _corners(normals: NDArray[np.float64], constants: NDArray[np.float64]) -> NDArray[np.float64]:
    """Corners [n, 3] of the convex body between half spaces n . x + c >= 0."""
    found = []
    for three in combinations(range(len(normals)), 3):
        matrix = normals[list(three)]
        if abs(np.linalg.det(matrix)) < PARALLEL:
            continue
        corner = np.linalg.solve(matrix, -constants[list(three)])
        if np.all(normals @ corner + constants > -SLACK * (1 + np.abs(corner).max())):
            found.append(corner)
    return np.array(found).reshape(-1, 3)
