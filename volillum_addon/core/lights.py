"""Lights, in radiometric units that agree with Cycles (docs/mathematics.md, brightness).

The fluence F of a light at a point is the integral of its radiance over directions (RGB). Where
nothing occludes, every model's in-scattered radiance is the sum of F / (4 pi) over the lights that
it represents.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import harmonics
from .errors import bad, colour, number, unit_vector, vector

Rgb = NDArray[np.float64]
# Pixels of 3 degrees, whose centres stand for them to 1e-3 in band 3.
HARMONIC_PIXELS = 64 * 128


class Light(Protocol):
    """What every light can tell."""

    kind: ClassVar[str]

    def fluence(self, point: NDArray[np.float64]) -> Rgb:
        """RGB fluence at a world point, unoccluded."""


@dataclass(frozen=True, eq=False)
class DistantLight:
    """A sun. `direction` is the unit vector toward it, `irradiance` RGB on a surface that faces it,
    `angle` its full angular diameter in radians (0: ideal)."""

    kind: ClassVar[str] = "distant"
    direction: ArrayLike
    irradiance: ArrayLike | float
    angle: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "direction", unit_vector("sun direction", self.direction))
        object.__setattr__(self, "irradiance", colour("sun irradiance", self.irradiance))
        object.__setattr__(self, "angle", number("sun angle", self.angle, 0.0, math.pi, "radians"))

    def fluence(self, point: NDArray[np.float64]) -> Rgb:
        # Uniform radiance L over a disc of half angle a: E = pi sin^2(a) L and
        # F = 2 pi (1 - cos a) L.
        return np.asarray(self.irradiance) * 2 / (1 + math.cos(self.angle / 2))

    def harmonics(self) -> NDArray[np.float64]:
        """Coefficients [16, 3] of its radiance: a disc attenuates band l by its mean P_l."""
        bands = harmonics.cap_attenuation(self.angle / 2)
        basis = harmonics.evaluate(np.asarray(self.direction)[None])[0]
        return np.outer(basis * harmonics.per_coefficient(bands), self.fluence(np.zeros(3)))


@dataclass(frozen=True, eq=False)
class PointLight:
    """A point source of radiant intensity `intensity` (RGB, W/sr) at a world position."""

    kind: ClassVar[str] = "point"
    position: ArrayLike
    intensity: ArrayLike | float

    def __post_init__(self) -> None:
        object.__setattr__(self, "position", vector("light position", self.position))
        object.__setattr__(self, "intensity", colour("light intensity", self.intensity))

    def fluence(self, point: NDArray[np.float64]) -> Rgb:
        return np.asarray(self.intensity) / _distance_squared(self.position, point)


@dataclass(frozen=True, eq=False)
class SpotLight:
    """A point source that shines into a cone: full intensity inside, smooth to zero over the blend.

    `direction` is where it shines, `angle` the full cone angle (radians), `blend` 0 to 1.
    """

    kind: ClassVar[str] = "spot"
    position: ArrayLike
    direction: ArrayLike
    intensity: ArrayLike | float
    angle: float = math.pi / 4
    blend: float = 0.15

    def __post_init__(self) -> None:
        object.__setattr__(self, "position", vector("spot position", self.position))
        object.__setattr__(self, "direction", unit_vector("spot direction", self.direction))
        object.__setattr__(self, "intensity", colour("spot intensity", self.intensity))
        object.__setattr__(self, "angle", number("spot angle", self.angle, 0.0, math.pi, "radians"))
        object.__setattr__(self, "blend", number("spot blend", self.blend, 0.0, 1.0))

    def fluence(self, point: NDArray[np.float64]) -> Rgb:
        away = point - np.asarray(self.position)
        distance = math.sqrt(_distance_squared(self.position, point))
        cosine = np.asarray(away @ np.asarray(self.direction)) / distance
        return np.asarray(self.intensity) * self.shape(cosine) / distance**2

    def shape(self, cosine: NDArray[np.float64]) -> NDArray[np.float64]:
        """Intensity over that on the axis, at cosines of the angle to the axis."""
        # Cycles' falloff: smoothstep in the spot's own projected coordinate.
        edge = math.cos(self.angle / 2)
        smooth = (1 - edge) * self.blend
        ramp = np.clip((cosine - edge) / smooth, 0, 1) if smooth > 0 else np.ones_like(cosine)
        return np.asarray((cosine > edge) * (3 * ramp**2 - 2 * ramp**3))


@dataclass(frozen=True, eq=False)
class AreaLight:
    """A flat emitter of uniform radiance: a rectangle, or the ellipse in it.

    `direction` is where it shines, `intensity` the RGB radiant intensity on that axis (W/sr), its
    radiance times its area. `size` is its width, or width and height (world units; 0: a point far
    away); `across` a vector along the width, perpendicular to `direction` (None: any).
    """

    kind: ClassVar[str] = "area"
    position: ArrayLike
    direction: ArrayLike
    intensity: ArrayLike | float
    size: ArrayLike | float = 0.0
    ellipse: bool = False
    across: ArrayLike | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "position", vector("area light position", self.position))
        object.__setattr__(self, "direction", unit_vector("area light direction", self.direction))
        object.__setattr__(self, "intensity", colour("area light intensity", self.intensity))
        size = np.asarray(self.size, np.float64)
        if size.shape not in ((), (2,)) or not np.all(np.isfinite(size)) or np.any(size < 0):
            raise bad("area light size", self.size, "a width, or width and height, 0 or more")
        object.__setattr__(self, "size", np.broadcast_to(size, (2,)).copy())
        axis = np.asarray(self.direction)
        if self.across is None:
            across = np.cross(axis, np.eye(3)[np.abs(axis).argmin()])
        else:
            across = unit_vector("area light's across", self.across)
            off = float(across @ axis)
            if abs(off) > 1e-4:
                raise bad("area light's across", self.across, "a vector at 90 degrees to direction")
            # What is perpendicular already changes by no bit.
            across = across - axis * off if abs(off) > 1e-12 else across
        object.__setattr__(self, "across", unit_vector("area light's across", across))

    @property
    def half_axes(self) -> NDArray[np.float64]:
        """Vectors [2, 3] from the middle to the middle of two sides."""
        across = np.asarray(self.across)
        axes = np.stack([across, np.cross(across, np.asarray(self.direction))])
        return np.asarray(axes * np.asarray(self.size)[:, None] / 2)

    @property
    def area(self) -> float:
        """Its surface."""
        return float(np.prod(np.asarray(self.size))) * (math.pi / 4 if self.ellipse else 1.0)

    def points(self, count: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """About `count` points [n, 3] of the emitter and their shares [n] of its surface: Gauss'
        rule in width and height, or in the square of the radius and evenly around."""
        if not np.any(np.asarray(self.size)):
            return np.asarray(self.position)[None], np.ones(1)
        if self.ellipse:
            rings = max(1, round(math.sqrt(count) / 2))
            square, share = np.polynomial.legendre.leggauss(rings)
            around = max(4, round(count / rings))
            # Rings are turned against each other, so that no two points cast one shadow's edge.
            turn = (np.arange(around) + np.arange(rings)[:, None] * 0.618) / around
            radius = np.sqrt((square + 1) / 2)[:, None]
            u = (radius * np.cos(2 * math.pi * turn)).ravel()
            v = (radius * np.sin(2 * math.pi * turn)).ravel()
            weights = np.repeat(share / (2 * around), around)
        else:
            side = max(1, round(math.sqrt(count)))
            node, share = np.polynomial.legendre.leggauss(side)
            u, v = np.repeat(node, side), np.tile(node, side)
            weights = np.outer(share, share).ravel() / 4
        return np.asarray(self.position) + np.stack([u, v], -1) @ self.half_axes, weights

    def fluence(self, point: NDArray[np.float64]) -> Rgb:
        if self.area == 0:
            squared = _distance_squared(self.position, point)
            away = (point - np.asarray(self.position)) / math.sqrt(squared)
            cosine = np.asarray(away @ np.asarray(self.direction))
            return np.asarray(self.intensity) * self.shape(cosine) / squared
        # Radiance times solid angle.
        return np.asarray(self.intensity) / self.area * self._solid_angle(np.asarray(point))

    def _solid_angle(self, point: NDArray[np.float64]) -> float:
        """At which the lit side is seen: a fan of triangles (Van Oosterom and Strackee 1983)."""
        middle = np.asarray(self.position)
        if not float((point - middle) @ np.asarray(self.direction)) > 0:
            return 0.0
        if self.ellipse:
            turn = np.arange(256) * (2 * math.pi / 256)
            # A polygon of the ellipse's area.
            stretch = math.sqrt(2 * math.pi / (256 * math.sin(2 * math.pi / 256)))
            rim = stretch * np.stack([np.cos(turn), np.sin(turn)], -1)
        else:
            rim = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
        a = middle - point
        b = middle + rim @ self.half_axes - point
        c = np.roll(b, -1, axis=0)
        la, lb, lc = (np.linalg.norm(x, axis=-1) for x in (a, b, c))
        above = np.cross(b, c) @ a
        below = la * lb * lc + (b @ a) * lc + (c @ a) * lb + (b * c).sum(-1) * la
        return abs(float(2 * np.arctan2(above, below).sum()))

    def shape(self, cosine: NDArray[np.float64]) -> NDArray[np.float64]:
        """Intensity over that on the axis, at cosines of the angle to the axis."""
        return np.maximum(cosine, 0.0)


@dataclass(frozen=True, eq=False)
class EnvironmentLight:
    """Light from all around: one RGB radiance, or a latitude-longitude image [h, w, 3].

    The image's first row is up (+z), its columns run with u = 1/2 - atan2(y, x) / (2 pi), as in
    Cycles; `rotation` (3 x 3) takes world directions to the image's. Negative pixels count as 0.
    """

    kind: ClassVar[str] = "environment"
    radiance: ArrayLike | float
    rotation: ArrayLike | None = None

    def __post_init__(self) -> None:
        radiance = np.asarray(self.radiance, dtype=np.float64)
        if radiance.ndim == 3:
            if radiance.shape[2] != 3 or radiance.size == 0:
                raise bad("environment image's shape", radiance.shape, "(h, w, 3)")
            if not np.all(np.isfinite(radiance)):
                raise bad("environment image", "not finite", "finite pixels")
            radiance = np.maximum(radiance, 0.0)
        else:
            radiance = colour("environment radiance", self.radiance)
        object.__setattr__(self, "radiance", radiance)
        if self.rotation is not None:
            rotation = np.asarray(self.rotation, dtype=np.float64)
            if rotation.shape != (3, 3) or not np.allclose(
                rotation @ rotation.T, np.eye(3), atol=1e-5
            ):
                raise bad("environment rotation", rotation.tolist(), "an orthonormal 3 x 3 matrix")
            object.__setattr__(self, "rotation", rotation)

    @property
    def is_image(self) -> bool:
        """Whether the radiance varies with direction."""
        return np.asarray(self.radiance).ndim == 3

    def fluence(self, point: NDArray[np.float64]) -> Rgb:
        radiance = np.asarray(self.radiance)
        if radiance.ndim == 1:
            return 4 * math.pi * radiance
        return np.asarray(_row_solid_angles(*radiance.shape[:2]) @ radiance.sum(axis=1))

    def harmonics(self) -> NDArray[np.float64]:
        """Coefficients [16, 3] of the radiance over outward world directions."""
        radiance = np.asarray(self.radiance)
        if radiance.ndim == 1:
            coefficients = np.zeros((harmonics.COUNT, 3))
            coefficients[0] = radiance * math.sqrt(4 * math.pi)
            return coefficients
        directions, solid_angles, radiance = self.pixels(HARMONIC_PIXELS)
        weighted = radiance.reshape(-1, 3) * solid_angles.reshape(-1, 1)
        return np.asarray(harmonics.evaluate(directions.reshape(-1, 3)).T @ weighted)

    def pixels(self, least: int) -> tuple[NDArray[np.float64], NDArray[np.float64], Rgb]:
        """World directions [h, w, 3] of an image's pixels, solid angles [h, w], radiance [h, w, 3].

        A pixel has one radiance. Those of a coarse image are split until there are `least`.
        """
        radiance = np.asarray(self.radiance)
        parts = math.ceil(math.sqrt(least / (radiance.shape[0] * radiance.shape[1])))
        if parts > 1:
            radiance = radiance.repeat(parts, axis=0).repeat(parts, axis=1)
        directions, solid_angles = latitude_longitude(radiance.shape[0], radiance.shape[1])
        if self.rotation is not None:
            directions = directions @ np.asarray(self.rotation)
        return directions, solid_angles, radiance


def shines(light: Light) -> bool:
    """Whether it has any strength at all; a light without is no light of the scene."""
    strengths = (getattr(light, name, 0.0) for name in ("irradiance", "intensity", "radiance"))
    return any(bool(np.any(np.asarray(value) > 0)) for value in strengths)


def light_shape(light: Light) -> Iterator[tuple[str, Any]]:
    """Names and values of all fields but the brightness; an image's pixels are its shape."""
    for name, value in sorted(vars(light).items()):
        constant = name == "radiance" and np.ndim(value) == 1
        if name not in ("irradiance", "intensity") and not constant:
            yield name, value


def latitude_longitude(height: int, width: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Directions [h, w, 3] of the pixel centres and exact solid angles [h, w] of the pixels."""
    elevation = math.pi * (0.5 - (np.arange(height) + 0.5) / height)
    azimuth = 2 * math.pi * (0.5 - (np.arange(width) + 0.5) / width)
    band = _row_solid_angles(height, width)
    cosine = np.cos(elevation)[:, None]
    directions = np.stack(
        [
            cosine * np.cos(azimuth),
            cosine * np.sin(azimuth),
            np.broadcast_to(np.sin(elevation)[:, None], (height, width)),
        ],
        axis=-1,
    )
    return directions, np.broadcast_to(band[:, None], (height, width))


def _row_solid_angles(height: int, width: int) -> NDArray[np.float64]:
    """Exact solid angle of a pixel in each row [h]."""
    edges = math.pi * (0.5 - np.arange(height + 1) / height)
    return np.asarray((np.sin(edges[:-1]) - np.sin(edges[1:])) * 2 * math.pi / width)


def _distance_squared(position: ArrayLike, point: NDArray[np.float64]) -> float:
    away = np.asarray(point) - np.asarray(position)
    squared = float(away @ away)
    if squared == 0:
        raise bad("a light's distance to the point it is evaluated at", 0, "a positive distance")
    return squared
