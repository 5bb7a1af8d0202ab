"""What a camera sees of a grid, against voxels projected one by one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from volillum_addon.core.camera import Camera
from volillum_addon.core.errors import InputError
from volillum_addon.core.grid import Grid
from volillum_addon.core.view import seen_region

SHAPE = (30, 24, 18)
AFFINE = np.array([[0.9, 0.2, 0, -3], [0, 1.1, 0.1, 2], [0.1, 0, 1.3, 1], [0, 0, 0, 1]])
GRID = Grid(np.ones(SHAPE, np.float32), AFFINE, "grid")
FAR = Camera((10, -90, 20), GRID.centre, fov=0.2, aspect=1.6)
CAMERAS = {
    "close": Camera((10, -20, 20), GRID.centre, fov=0.3, aspect=1.6),
    "narrow": replace(FAR, fov=0.05, aspect=0.4),
    "shifted": replace(FAR, fov=0.1, shift=(0.3, -0.4)),
    "tilted": replace(FAR, fov=0.1, up=(0.5, 0, 0.9)),
    "from within": Camera(GRID.centre, (30, 40, 12), fov=0.9, aspect=1.0),
    "orthographic": Camera((10, -20, 20), (8, 9, 9), orthographic=True, height=6, aspect=1.5),
    "along an axis": Camera((7, 12, -50), (7, 12, 9), (0, 1, 0), fov=0.1, aspect=1.0),
}


def projected(camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """How far all voxels lie inside of the image, in shares of its height, and before the eye."""
    assert camera.aspect is not None
    index = np.stack(np.meshgrid(*map(np.arange, SHAPE), indexing="ij"), -1).reshape(-1, 3)
    away = GRID.to_world(index.astype(float)) - camera.eye
    right = np.cross(camera.forward, np.asarray(camera.up))
    right /= np.linalg.norm(right)
    up = np.cross(right, camera.forward)
    depth = away @ camera.forward
    span = camera.height if camera.orthographic else 2 * np.tan(camera.fov / 2) * depth
    with np.errstate(divide="ignore"):
        x, y = (away @ right) / span, (away @ up) / span
    x, y = x - camera.shift[0], y - camera.shift[1]
    inside = np.minimum(camera.aspect / 2 - np.abs(x), 0.5 - np.abs(y))
    front = np.ones(len(depth), bool) if camera.orthographic else depth > 0
    return (inside > 0) & front, index


@pytest.mark.parametrize("name", CAMERAS)
def test_every_seen_voxel_and_hardly_more(name: str) -> None:
    seen, index = projected(CAMERAS[name])
    low, high = index[seen].min(axis=0), index[seen].max(axis=0) + 1
    for margin in (0, 2):
        found_low, found_high = (
            np.array(each) for each in seen_region(CAMERAS[name], GRID, margin)
        )
        assert np.all(found_low <= np.maximum(low - margin, 0))
        assert np.all(found_high >= np.minimum(high + margin, SHAPE))
        # Voxels of the border count a voxel further out, and the body's corners lie between voxels.
        slack = margin + 4
        assert np.all(found_low >= np.maximum(low - slack, 0))
        assert np.all(found_high <= np.minimum(high + slack, SHAPE))


def test_all_of_what_is_in_view() -> None:
    assert seen_region(replace(FAR, fov=1.0), GRID, 2) == ((0, 0, 0), SHAPE)


def test_the_other_way_there_is_nothing() -> None:
    away = replace(FAR, look_at=2 * FAR.eye - GRID.centre)
    with pytest.raises(InputError, match="sees of the volume is nothing"):
        seen_region(away, GRID, 2)


def test_the_images_shape_must_be_known() -> None:
    with pytest.raises(InputError, match="shape of the camera's image"):
        seen_region(replace(FAR, aspect=None), GRID, 2)
