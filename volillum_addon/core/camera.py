"""The camera: where the eye is and which ray belongs to an image position."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .errors import bad, number, unit_vector, vector


@dataclass(frozen=True, eq=False)
class Camera:
    """A perspective or orthographic camera.

    `fov` is the full vertical angle of view in radians (perspective), `height` the world height of
    the view (orthographic); `shift` moves the image by shares of its height (right, up); `aspect`
    is the image's width over its height, where that is known.
    """

    position: ArrayLike
    look_at: ArrayLike
    up: ArrayLike = (0.0, 0.0, 1.0)
    fov: float = 0.7
    orthographic: bool = False
    height: float = 1.0
    shift: tuple[float, float] = (0.0, 0.0)
    aspect: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "position", vector("camera position", self.position))
        object.__setattr__(self, "look_at", vector("camera target", self.look_at))
        object.__setattr__(self, "up", unit_vector("camera up", self.up))
        object.__setattr__(self, "fov", number("camera fov", self.fov, 1e-4, math.pi - 1e-3))
        object.__setattr__(self, "height", number("camera height", self.height, 1e-12, 1e12))
        if self.aspect is not None:
            object.__setattr__(self, "aspect", number("camera aspect", self.aspect, 1e-6, 1e6))
        unit_vector("camera view", np.asarray(self.look_at) - np.asarray(self.position))
        if np.linalg.norm(np.cross(self.forward, np.asarray(self.up))) < 1e-9:
            raise bad("camera up", np.asarray(self.up).tolist(), "not along the view direction")

    @property
    def eye(self) -> NDArray[np.float64]:
        """World position of the eye (of the image's middle, for an orthographic camera)."""
        return np.asarray(self.position)

    @property
    def forward(self) -> NDArray[np.float64]:
        """Unit vector in which the camera looks."""
        return unit_vector("view", np.asarray(self.look_at) - np.asarray(self.position))

    def rays(self, width: float, height: float) -> NDArray[np.float64]:
        """[6, 3]: origin, its change per pixel right and down, the same for the direction.

        The ray through the image position (u, v), in pixels from the top left corner, starts at
        r[0] + u r[1] + v r[2] in the direction of r[3] + u r[4] + v r[5].
        """
        forward = self.forward
        right = np.cross(forward, np.asarray(self.up))
        right /= np.linalg.norm(right)
        up = np.cross(right, forward)
        span = self.height if self.orthographic else 2 * math.tan(self.fov / 2)
        step = span / height
        corner = (
            right * step * (-width / 2 + self.shift[0] * height)
            + up * step * (height / 2 + self.shift[1] * height)
        )  # fmt: skip
        zero = np.zeros(3)
        if self.orthographic:
            parts = [self.eye + corner, right * step, -up * step, forward, zero, zero]
        else:
            parts = [self.eye, zero, zero, forward + corner, right * step, -up * step]
        return np.array(parts)
