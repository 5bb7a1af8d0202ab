"""The image of a baked volume by the core's own line integral."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..core.camera import Camera
from ..core.control import Control
from ..core.grid import Grid
from ..core.native import native
from .volume import IlluminationVolume


def line_integral(
    volume: IlluminationVolume,
    camera: Camera,
    width: int,
    height: int,
    subpixels: int = 4,
    control: Control | None = None,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Radiance [h, w, 3] and transmittance [h, w, 3], without background, top row first.

    What the display material shows, integrated to quadrature precision: averages of
    `subpixels` x `subpixels` rays a pixel.
    """
    medium = volume.medium
    emission = medium.emission if volume.image_emission else None
    planes, terms, angular = volume.planes()
    radiance, transmittance = native.line_integral(
        medium.sigma_t.planes(),
        medium.sigma_s.planes(),
        None if emission is None else _three(emission),
        medium.sigma_t.index_to_world,
        planes,
        terms,
        camera.rays(width, height),
        width,
        height,
        angular=angular,
        subpixels=subpixels,
        control=control.native if control else None,
    )
    return radiance, transmittance


def _three(grid: Grid) -> NDArray[np.float32]:
    """RGB planes, also of a grid of one channel."""
    planes = grid.planes()
    return np.ascontiguousarray(np.broadcast_to(planes, (3, *planes.shape[1:])))
