"""What a scene holds, before any work: its medium, its lights, how deep they reach, what is absent.

Everything here is read off the scene's own numbers; what models make of it is no concern of the
core.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import cast

import numpy as np
from numpy.typing import NDArray

from . import harmonics
from .camera import Camera
from .grid import occupied
from .lights import (
    AreaLight,
    DistantLight,
    EnvironmentLight,
    Light,
    PointLight,
    SpotLight,
    latitude_longitude,
)
from .medium import Medium
from .native import native
from .orders import largest_albedo, lasting_orders
from .scene import Scene

# Points of matter, drawn by their extinction, from which optical depths are taken.
POINTS = 512
# The share of the scattered light that may be missing after the orders that matter.
TAIL = 0.01

Rgb = tuple[float, float, float]


@dataclass(frozen=True)
class Depths:
    """Optical depths (mean of the colours) over a sample: the median, 95 %, and the largest."""

    median: float
    high: float
    largest: float


@dataclass(frozen=True)
class LightAnalysis:
    """One light. `solid_angle` in steradians seen from the medium's centre (0: from one direction),
    `fluence` there, RGB, unoccluded, and its `share` of all lights'. `depths` lie between matter
    and the light. `bands` are the shares of the radiance's energy in the harmonic bands 0 to 3 and
    above, for a light from all around."""

    kind: str
    solid_angle: float
    fluence: Rgb
    share: float
    depths: Depths
    bands: tuple[float, ...] = ()

    @property
    def is_coloured(self) -> bool:
        """Whether its colours differ."""
        return float(np.ptp(self.fluence)) > 0


@dataclass(frozen=True)
class Analysis:
    """The terms of a scene.

    `shape` is of the box of matter, `matter` the share of its voxels that hold any. Channels are 1
    (grey) or 3, `emission` 0 where nothing glows. `albedo` is (mean by extinction, largest).
    `view` are the depths of the camera's rays that meet matter (None without a camera); `orders`
    bounds the scattering orders after which less than TAIL of the light is left. `dark` lights
    have no strength, or none of it reaches the medium, and are not among the `lights`.
    """

    shape: tuple[int, int, int]
    matter: float
    extinction_channels: int
    scattering_channels: int
    emission_channels: int
    albedo: tuple[float, float]
    g: float
    lights: tuple[LightAnalysis, ...]
    view: Depths | None
    orders: float
    dark: int = 0

    @property
    def voxels(self) -> int:
        """Voxels of the box of matter."""
        return math.prod(self.shape)

    @property
    def kinds(self) -> frozenset[str]:
        """The kinds of light that shine."""
        return frozenset(light.kind for light in self.lights)

    def of_kinds(self, kinds: frozenset[str]) -> Analysis:
        """The same scene with only these kinds of light."""
        return replace(self, lights=tuple(each for each in self.lights if each.kind in kinds))


def analysis(scene: Scene) -> Analysis:
    """Read the scene. Raises InputError when its medium is empty."""
    medium = scene.medium.trimmed(0)
    sigma_t = medium.sigma_t
    points = _matter_points(medium)
    lit = [light for light in scene.lights if np.any(light.fluence(sigma_t.centre) > 0)]
    total = sum(float(light.fluence(sigma_t.centre).sum()) for light in lit)
    mean_t, mean_s = (float(np.mean(grid.values)) for grid in (sigma_t, medium.sigma_s))
    return Analysis(
        shape=sigma_t.shape,
        matter=float(np.mean(occupied(sigma_t.values))),
        extinction_channels=sigma_t.channels,
        scattering_channels=medium.sigma_s.channels,
        emission_channels=0 if medium.emission is None else medium.emission.channels,
        albedo=(mean_s / mean_t if mean_t > 0 else 0.0, largest_albedo(medium)),
        g=medium.g,
        lights=tuple(_light(light, medium, points, total) for light in lit),
        view=None if scene.camera is None else _view_depths(scene.camera, medium, points),
        orders=lasting_orders(medium, TAIL),
        dark=len(scene.lights) - len(lit),
    )


def _matter_points(medium: Medium) -> NDArray[np.float64]:
    """World positions [POINTS, 3] of voxels, drawn in proportion to their extinction."""
    grid = medium.sigma_t
    cumulative = np.cumsum(grid.planes().mean(axis=0, dtype=np.float64).ravel())
    if cumulative[-1] == 0:  # a glow without extinction
        cumulative = np.arange(1.0, len(cumulative) + 1)
    drawn = np.random.default_rng(0).random(POINTS) * cumulative[-1]
    flat = np.minimum(np.searchsorted(cumulative, drawn, side="right"), len(cumulative) - 1)
    return grid.to_world(np.stack(np.unravel_index(flat, grid.shape), -1).astype(np.float64))


def _light(
    light: Light, medium: Medium, points: NDArray[np.float64], total: float
) -> LightAnalysis:
    fluence = light.fluence(medium.sigma_t.centre)
    return LightAnalysis(
        kind=light.kind,
        solid_angle=_solid_angle(light),
        fluence=cast(Rgb, tuple(float(value) for value in fluence)),
        share=float(fluence.sum()) / total,
        depths=_light_depths(light, medium, points),
        bands=_bands(light) if isinstance(light, EnvironmentLight) else (),
    )


def _solid_angle(light: Light) -> float:
    if isinstance(light, DistantLight):
        return 2 * math.pi * (1 - math.cos(light.angle / 2))
    return 4 * math.pi if isinstance(light, EnvironmentLight) else 0.0


def _bands(light: EnvironmentLight) -> tuple[float, ...]:
    """Shares of the integral of L^2 over all directions, summed over the colours."""
    energy = np.sum(light.harmonics() ** 2, axis=-1)
    radiance = np.asarray(light.radiance)
    if light.is_image:
        _, solid_angles = latitude_longitude(radiance.shape[0], radiance.shape[1])
        whole = float(np.sum(radiance**2 * solid_angles[..., None]))
    else:
        whole = float(energy.sum())
    shares = [
        float(energy[band**2 : (band + 1) ** 2].sum()) / whole
        for band in range(harmonics.LARGEST_ORDER + 1)
    ]
    return (*shares, max(0.0, 1.0 - sum(shares)))


def _light_depths(light: Light, medium: Medium, points: NDArray[np.float64]) -> Depths:
    if isinstance(light, DistantLight):
        return _depths(_outward(medium, points, np.tile(light.direction, (len(points), 1))))
    if isinstance(light, PointLight | SpotLight | AreaLight):
        return _depths(_between(medium, points, np.asarray(light.position)))
    random = np.random.default_rng(1).normal(size=(len(points), 3))
    random /= np.linalg.norm(random, axis=-1, keepdims=True)
    return _depths(_outward(medium, points, random))


def _view_depths(camera: Camera, medium: Medium, points: NDArray[np.float64]) -> Depths:
    """Whole rays through matter: what lies before and behind each point."""
    if camera.orthographic:
        toward = np.tile(-camera.forward, (len(points), 1))
        before = _outward(medium, points, toward)
    else:
        toward = camera.eye - points
        toward /= np.maximum(np.linalg.norm(toward, axis=-1, keepdims=True), 1e-30)
        before = _between(medium, points, camera.eye)
    return _depths(before + _outward(medium, points, -toward))


def _between(
    medium: Medium, points: NDArray[np.float64], place: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Optical depths from the points to one place, which may lie inside."""
    toward = place - points
    toward /= np.maximum(np.linalg.norm(toward, axis=-1, keepdims=True), 1e-30)
    beyond = _outward(medium, np.tile(place, (len(points), 1)), toward)
    return np.maximum(_outward(medium, points, toward) - beyond, 0.0)


def _outward(
    medium: Medium, points: NDArray[np.float64], directions: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Optical depths from the points to infinity, mean of the colours [n]."""
    grid = medium.sigma_t
    depths = native.exact_optical_depth(
        grid.planes(), grid.index_to_world, points, np.ascontiguousarray(directions)
    )
    return np.asarray(depths).mean(axis=-1)


def _depths(sample: NDArray[np.float64]) -> Depths:
    middle, high = np.quantile(sample, (0.5, 0.95))
    return Depths(float(middle), float(high), float(sample.max()))
