"""What the equation of a model allows of a bake: the most radiance, and what of it is conserved.

Derived from the operator and the scene's lights alone, or, of chance, from the bake's own standard
error.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..core import harmonics
from ..core.camera import Camera
from ..core.directions import sphere_rule
from ..core.grid import Grid
from ..core.lights import DistantLight, EnvironmentLight, Light, PointLight
from ..core.medium import Medium
from ..models.angular import MOMENT_ORDER, Moment
from ..models.operator import Operator, brightness, truncated_radiance
from ..models.volume import STANDARD_ERROR, IlluminationVolume

Field = NDArray[np.float64]

# Directions of the rule that integrates a truncated sky's positive part.
FINE_DIRECTIONS = 4096


def radiance(volume: IlluminationVolume, camera: Camera | None) -> Field:
    """In-scattered radiance toward the camera, [i, j, k, 3]."""
    return volume.in_scattered(view=camera).values.astype(np.float64)


def noise(volume: IlluminationVolume) -> Field:
    """Standard error of the radiance, [i, j, k, 1 or 3]; 0 for a deterministic model."""
    if STANDARD_ERROR not in volume.channels:
        return np.zeros((*volume.medium.sigma_t.shape, 1))
    error = volume.channels[STANDARD_ERROR].values.astype(np.float64)
    error = error if error.ndim == 4 else error[..., None]
    return error * moments_gain(volume)


def moments_gain(volume: IlluminationVolume) -> float:
    """The largest factor by which a phase function of g, cut after its moments, may multiply the
    mean radiance: sum of (2 l + 1) |g|^l."""
    if not any(isinstance(term.angular, Moment) for term in volume.radiance):
        return 1.0
    g = abs(volume.medium.g)
    return float(sum((2 * band + 1) * g**band for band in range(MOMENT_ORDER + 1)))


def rms(values: Field) -> float:
    """Root mean square."""
    return math.sqrt(float(np.mean(np.square(values)))) if values.size else 0.0


def unoccluded(lights: tuple[Light, ...], points: Field, grid: Grid) -> Field:
    """Sum of F / (4 pi) at world points [..., 3], [..., 3]; beside a lamp 1 / d^2 is at most its
    mean over a ball of a voxel's volume, as it is stored."""
    volume = abs(float(np.linalg.det(grid.index_to_world[:3, :3])))
    least = (3 * volume / (4 * math.pi)) ** (2 / 3) / 3
    total = np.zeros(points.shape)
    for light in lights:
        if isinstance(light, PointLight):
            squared = np.sum((points - np.asarray(light.position)) ** 2, axis=-1, keepdims=True)
            total += np.asarray(light.intensity) / np.maximum(squared, least)
        else:
            total += light.fluence(np.zeros(3))
    return total / (4 * math.pi)


def lattice_points(grid: Grid) -> Field:
    """World positions of all voxels, [i, j, k, 3]."""
    index = np.stack(np.meshgrid(*map(np.arange, grid.shape), indexing="ij"), axis=-1)
    return grid.to_world(index.astype(np.float64))


def most_radiance(
    operator: Operator, lights: tuple[Light, ...], volume: IlluminationVolume
) -> Field | None:
    """The largest in-scattered radiance that the equation allows, broadcastable to [i, j, k, 3];
    None where it has no bound at a point: full scattering of an ideal sun or lamp may be
    focussed."""
    medium = volume.medium
    if operator.source == "constant" and operator.axis != "light":
        return brightness(lights, medium.sigma_t.centre)
    if operator.axis == "light":
        # One term of at most F / (4 pi) a light, weights that sum to 1, transmittances up to 1.
        return unoccluded(lights, lattice_points(medium.sigma_t), medium.sigma_t)
    if operator.basis is not None:
        return positive_part(operator, lights, volume)
    # The maximum principle: nothing is brighter than the brightest source.
    total = np.zeros(3)
    for light in lights:
        brightest = brightest_radiance(light)
        if brightest is None:
            return None
        total += brightest
    return (total + hottest(medium)) * moments_gain(volume)


def positive_part(
    operator: Operator, lights: tuple[Light, ...], volume: IlluminationVolume
) -> Field:
    """1 / (4 pi) times the integral of the truncated sky where it is above 0: visibility is at most
    1 there, and 0 where the sky is negative. Of a fine rule or the bake's own, the larger."""
    coefficients = truncated_radiance(operator, lights)
    found = []
    for count in (FINE_DIRECTIONS, int(volume.parameters["directions"])):
        vectors, weights = sphere_rule(count)
        sky = harmonics.evaluate(vectors) @ coefficients
        found.append(weights @ np.maximum(sky, 0))
    return np.asarray(np.maximum(*found))


def brightest_radiance(light: Light) -> Field | None:
    """The largest radiance of a light; None where it is not finite."""
    if isinstance(light, EnvironmentLight):
        return np.asarray(light.radiance, np.float64).reshape(-1, 3).max(axis=0)
    fluence = light.fluence(np.zeros(3)) if isinstance(light, DistantLight) else np.ones(3)
    if not fluence.any():
        return np.zeros(3)
    if isinstance(light, DistantLight) and light.angle > 0:
        return fluence / (2 * math.pi * (1 - math.cos(light.angle / 2)))
    return None


def hottest(medium: Medium) -> Field:
    """The largest source radiance of the medium's own glow, sigma_a L_e / sigma_a."""
    if medium.emission is None:
        return np.zeros(3)
    absorbed = wide(medium.sigma_t) - wide(medium.sigma_s)
    emitted = wide(medium.emission)
    ratio = np.divide(emitted, absorbed, out=np.zeros_like(emitted), where=absorbed > 0)
    return np.asarray(ratio.reshape(-1, 3).max(axis=0))


def wide(grid: Grid) -> Field:
    """Values as [i, j, k, 3]."""
    values = grid.values if grid.channels == 3 else grid.values[..., None]
    return np.broadcast_to(values, (*grid.shape, 3)).astype(np.float64)


def conserved_radiance(
    operator: Operator, lights: tuple[Light, ...], medium: Medium
) -> Field | None:
    """What L_i is everywhere because nothing is absorbed; None where nothing says so."""
    albedo = medium.constant_albedo
    if albedo is None or np.any(albedo < 1) or medium.emission is not None:
        return None
    if math.isfinite(operator.order):
        return None
    if operator.rescatter == "lobe":
        return unoccluded(lights, lattice_points(medium.sigma_t), medium.sigma_t)
    bright = [light for light in lights if np.any(light.fluence(np.zeros(3)) > 0)]
    even = all(isinstance(light, EnvironmentLight) and not light.is_image for light in bright)
    return brightness(tuple(bright), medium.sigma_t.centre) if even and medium.g == 0 else None
