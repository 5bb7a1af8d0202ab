"""Grids: geometry, cropping, and what they refuse."""

from __future__ import annotations

import numpy as np
import pytest

from volillum_addon.core.errors import InputError
from volillum_addon.core.grid import Grid, active_box

SHEARED = np.array(
    [[0.5, 0.2, 0.0, 1.0], [0.0, 2.0, 0.1, -3.0], [0.3, 0.0, -0.7, 5.0], [0, 0, 0, 1.0]]
)


def grid(values: np.ndarray, affine: np.ndarray = SHEARED) -> Grid:
    return Grid(values.astype(np.float32), affine, "density")


def test_index_and_world_are_inverse() -> None:
    index = np.random.default_rng(1).uniform(-5, 9, (20, 3))
    there = grid(np.ones((2, 3, 4)))
    # float64 with coordinates below 40: rounding stays far below 1e-12 relative.
    assert np.allclose(there.to_index(there.to_world(index)), index, atol=1e-11)
    assert np.allclose(there.to_world(np.array([1.0, 0, 0])), SHEARED[:3, 0] + SHEARED[:3, 3])


def test_crop_keeps_every_voxel_where_it_was() -> None:
    values = np.arange(2 * 3 * 4).reshape(2, 3, 4)
    whole = grid(values)
    part = whole.crop((-1, 1, 2), (2, 3, 7))
    assert part.shape == (3, 2, 5)
    assert np.array_equal(part.values[1:, :, :2], values[:, 1:, 2:])
    assert part.values.sum() == values[:, 1:, 2:].sum()
    assert np.allclose(part.to_world(np.array([1.0, 0, 0])), whole.to_world(np.array([0.0, 1, 2])))


def test_active_box_is_tight_and_grows_by_the_margin() -> None:
    values = np.zeros((5, 6, 7))
    values[1, 2, 3] = values[3, 2, 4] = 1
    assert active_box(grid(values)) == ((1, 2, 3), (4, 3, 5))
    assert active_box(grid(values), margin=2) == ((-1, 0, 1), (6, 5, 7))
    assert active_box(grid(values * 0)) is None


def test_planes_of_a_vector_grid_are_its_channels() -> None:
    values = np.random.default_rng(2).random((2, 3, 4, 3))
    planes = grid(values).planes()
    assert planes.shape == (3, 2, 3, 4)
    assert planes.flags.c_contiguous
    assert np.array_equal(planes[1], values[..., 1].astype(np.float32))


@pytest.mark.parametrize("channels", [1, 3])
def test_planes_become_a_grid_without_a_copy(channels: int) -> None:
    planes = np.random.default_rng(3).random((channels, 2, 3, 4), dtype=np.float32)
    found = grid(np.ones((2, 3, 4))).with_planes(planes, "light")
    assert found.name == "light"
    assert found.shape == (2, 3, 4)
    assert found.channels == channels
    assert np.array_equal(found.values[1, 2, 3], planes[:, 1, 2, 3].squeeze())
    assert np.shares_memory(found.values, planes)
    assert np.shares_memory(found.planes(), planes)


def test_a_crop_of_colours_lies_in_planes() -> None:
    values = np.random.default_rng(4).random((4, 3, 5, 3))
    part = grid(values).crop((1, -1, 0), (3, 4, 5))
    assert np.array_equal(part.values[:, 1:4], values[1:3].astype(np.float32))
    assert not part.values[:, [0, 4]].any()
    assert np.shares_memory(part.planes(), part.values)


@pytest.mark.parametrize(
    ("values", "affine", "message"),
    [
        (np.ones((64, 64)), np.eye(4), r"density's shape is \(64, 64\); expected \(i, j, k\)"),
        (np.ones((2, 2, 0)), np.eye(4), "at least one voxel"),
        (np.ones((2, 2, 2, 2)), np.eye(4), r"expected \(i, j, k\) or \(i, j, k, 3\)"),
        (np.full((2, 2, 2), np.nan), np.eye(4), r"8 NaN voxels, first at \(0, 0, 0\)"),
        (np.full((1, 1, 1), np.inf), np.eye(4), "1 infinite voxel, first"),
        (np.ones((2, 2, 2)), np.diag([1.0, 0, 1, 1]), "expected an invertible matrix"),
        (np.ones((2, 2, 2)), np.full((4, 4), np.nan), "expected a finite 4 x 4 matrix"),
        (np.ones((2, 2, 2)), np.eye(3), "expected a finite 4 x 4 matrix"),
        (np.ones((2, 2, 2)), np.diag([1.0, 1, 1, 2]), "last row"),
    ],
)
def test_what_cannot_be_a_grid_is_refused(
    values: np.ndarray, affine: np.ndarray, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        grid(values, affine)
