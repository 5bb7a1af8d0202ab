"""Cameras: rays."""

from __future__ import annotations

import math

import numpy as np
import pytest

from volillum_addon.core.camera import Camera
from volillum_addon.core.errors import InputError


def test_perspective_rays_span_the_angle_of_view() -> None:
    camera = Camera((1, 2, 3), (1, 7, 3), fov=0.8)
    rays = camera.rays(40, 20)

    def ray(u: float, v: float) -> np.ndarray:
        direction = rays[3] + u * rays[4] + v * rays[5]
        return direction / np.linalg.norm(direction)

    assert np.allclose(rays[0], (1, 2, 3))
    assert np.allclose(ray(20, 10), (0, 1, 0))
    assert math.acos(ray(20, 0) @ ray(20, 20)) == pytest.approx(0.8, rel=1e-12)
    assert ray(20, 0)[2] > 0  # row 0 is up
    assert ray(40, 10)[0] > 0  # columns run to the right of a camera that looks along +y


def test_orthographic_rays_are_parallel() -> None:
    camera = Camera((0, 0, 5), (0, 0, 0), up=(0, 1, 0), orthographic=True, height=4.0)
    rays = camera.rays(8, 4)
    assert np.allclose(rays[3], (0, 0, -1))
    assert not rays[4:].any()
    assert np.allclose(rays[0], (-4, 2, 5))
    assert np.allclose(rays[1:3], [(1, 0, 0), (0, -1, 0)])


def test_shift_moves_by_shares_of_the_height() -> None:
    plain = Camera((0, 0, 5), (0, 0, 0), up=(0, 1, 0), orthographic=True, height=4.0)
    moved = Camera((0, 0, 5), (0, 0, 0), (0, 1, 0), 0.7, True, 4.0, shift=(0.5, 0.25))
    assert np.allclose(moved.rays(8, 4)[0] - plain.rays(8, 4)[0], (2, 1, 0))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (((0, 0, 0), (0, 0, 0)), "zero vector"),
        (((0, 0, 0), (0, 0, 1)), "camera up"),
        (((0, 0, np.nan), (0, 0, 1)), "three finite numbers"),
        (((0, 0, 0), (0, 1, 0), (0, 0, 1), 4.0), "camera fov is 4"),
    ],
)
def test_what_cannot_be_a_camera_is_refused(arguments: tuple, message: str) -> None:
    with pytest.raises(InputError, match=message):
        Camera(*arguments)
