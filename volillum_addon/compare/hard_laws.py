"""What must hold of every model in every hard scene.

Every bound is derived from the model's own operator, the scene's lights and a refinement of the
numerics; none is fitted to what was found. Errors are relative to the light that would arrive
unoccluded, because a shadow may be of any depth:

    error  RMS over some voxels of (baked - exact) over the scale, the larger of the RMS of the
           exact solution and of the unoccluded radiance there
    bound  2 RMS over all voxels of (baked - refined), and what chance adds: refined is the bake of
           the same trilinear field on a lattice of half the voxel size with the finest settings of
           the model's ladder. A method whose error at least halves in that step, as any of first
           order or better does, has an error of at most twice the difference (Richardson). A mean
           over a voxel (Model.averages) does not come closer to the value at its centre where light
           ends just there: it differs by at most the mean of what the exact solution differs by
           within the voxel, and that is added.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ..core import harmonics
from ..core.camera import Camera
from ..core.colour import LUMINANCE
from ..core.directions import sphere_rule
from ..core.grid import Grid
from ..core.lights import DistantLight, EnvironmentLight, Light, PointLight
from ..core.medium import Medium
from ..core.scene import Scene
from ..models.angular import MOMENT_ORDER, Moment
from ..models.operator import Operator, brightness, truncated_radiance
from ..models.volume import STANDARD_ERROR, IlluminationVolume

Field = NDArray[np.float64]
Law = Literal[
    "finite", "not negative", "within its bound", "conserves energy", "same for any threads",
    "continuous", "accurate",
]  # fmt: skip

# float32 sums of a few hundred terms, as in the models' contract.
ROUNDING = 2e-5
# Where scattering conserves all of the light, thousands of steps round.
CONSERVED = 2e-4
# Standard errors that chance does not pass at any of some ten thousand voxels: of few passes their
# own estimate varies, and the t distribution of 7 degrees of freedom passes 8 in 1e-4 of cases.
SIGMAS = 8.0
# Light and eye are turned by this angle over the optical depth across the medium: no ray's depth
# then changes by more than that, and a cone of a degree by 115 times it.
TURN = 1e-6
TURNED = 1e-3
# Directions of the rule that integrates a truncated sky's positive part.
FINE_DIRECTIONS = 4096


@dataclass(frozen=True)
class Finding:
    """One law: whether it holds, and in figures how far from it the cell is."""

    law: Law
    holds: bool
    detail: str = ""


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


def unoccluded(lights: tuple[Light, ...], points: Field) -> Field:
    """Sum of F / (4 pi) at world points [..., 3], [..., 3]."""
    total = np.zeros(points.shape)
    for light in lights:
        if isinstance(light, PointLight):
            squared = np.sum((points - np.asarray(light.position)) ** 2, axis=-1, keepdims=True)
            total += np.asarray(light.intensity) / np.maximum(squared, 1e-300)
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
        return unoccluded(lights, lattice_points(medium.sigma_t))
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


def is_finite(found: Field) -> Finding:
    """No NaN, no infinity."""
    wrong = int(np.count_nonzero(~np.isfinite(found).all(axis=-1)))
    return Finding("finite", wrong == 0, f"{wrong} voxels are not")


def is_not_negative(
    operator: Operator, volume: IlluminationVolume, camera: Camera | None, found: Field
) -> Finding:
    """Nothing below 0; before what is displayed is clamped, unless the sum is of signed harmonics
    or the equation itself is clamped."""
    signed = operator.clamped or any(isinstance(t.angular, Moment) for t in volume.radiance)
    least = found if signed else volume.in_scattered(view=camera, clamped=False).values
    return Finding("not negative", bool(np.all(least >= 0)), f"least {least.min():.3g}")


def is_within(
    operator: Operator,
    lights: tuple[Light, ...],
    volume: IlluminationVolume,
    found: Field,
    numerical: float,
) -> Finding:
    """No brighter than the equation allows; where that has no bound at a point, no more absorbed
    than arrives. Light that is scattered on by the phase function is solved apart from what arrives
    unscattered, so that their errors, estimated to be `numerical`, do not make up for each other.
    """
    most = most_radiance(operator, lights, volume)
    if most is None:
        return absorbs_no_more(lights, volume, found)
    most = np.broadcast_to(most, found.shape)
    if operator.split == "luminance":  # hue may raise one channel, luminance stays
        found, most = (found @ LUMINANCE)[..., None], (most @ LUMINANCE)[..., None]
    sigma = noise(volume)
    allowed = most * (1 + ROUNDING) + SIGMAS * np.maximum(sigma, rms(sigma))
    if operator.rescatter == "phase":
        allowed = allowed + numerical
    share = np.divide(found, most, out=np.zeros_like(found), where=most > 0)
    return Finding(
        "within its bound", bool(np.all(found <= allowed)), f"{share.max():.4g} of what it allows"
    )


def absorbs_no_more(lights: tuple[Light, ...], volume: IlluminationVolume, found: Field) -> Finding:
    """4 pi times the sum of sigma_a L_i, a midpoint rule that is below the integral where light
    decays, against the power that meets the box."""
    medium = volume.medium
    linear = medium.sigma_t.index_to_world[:3, :3]
    cell = abs(float(np.linalg.det(linear)))
    edges = linear * (np.array(medium.sigma_t.shape) + 1)
    faces = np.linalg.norm(
        [np.cross(edges[:, a], edges[:, b]) for a, b in ((0, 1), (1, 2), (2, 0))], axis=1
    ).sum()
    power = np.zeros(3)
    for light in lights:
        if isinstance(light, PointLight):
            power += 4 * math.pi * np.asarray(light.intensity)
        else:  # the box's shadow is at most as large as three of its faces
            power += light.fluence(np.zeros(3)) * faces
    if medium.emission is not None:
        power += 4 * math.pi * cell * wide(medium.emission).sum(axis=(0, 1, 2))
    absorbing = (wide(medium.sigma_t) - wide(medium.sigma_s)) * (4 * math.pi * cell)
    taken = (absorbing * found).sum(axis=(0, 1, 2))
    chance = np.sqrt(((absorbing * noise(volume)) ** 2).sum(axis=(0, 1, 2)))
    share = float(np.max(np.divide(taken, power, out=np.zeros(3), where=power > 0)))
    holds = bool(np.all(taken <= power * (1 + ROUNDING) + SIGMAS * chance))
    return Finding("within its bound", holds, f"absorbs {share:.3g} of what arrives")


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
        return unoccluded(lights, lattice_points(medium.sigma_t))
    bright = [light for light in lights if np.any(light.fluence(np.zeros(3)) > 0)]
    even = all(isinstance(light, EnvironmentLight) and not light.is_image for light in bright)
    return brightness(tuple(bright), medium.sigma_t.centre) if even and medium.g == 0 else None


def conserves(
    operator: Operator,
    lights: tuple[Light, ...],
    volume: IlluminationVolume,
    found: Field,
    estimate: float,
) -> Finding | None:
    """Where nothing is absorbed light stays what it was, to rounding, or to `estimate` where
    directions are sampled; None where the equation does not conserve it."""
    expected = conserved_radiance(operator, lights, volume.medium)
    if expected is None:
        return None
    scale = rms(np.broadcast_to(expected, found.shape))
    off = rms(found - expected)
    allowed = CONSERVED * scale
    if STANDARD_ERROR in volume.channels:
        allowed += estimate * scale + SIGMAS / 2 * rms(noise(volume))
    share = off / scale if scale else off
    return Finding("conserves energy", off <= allowed, f"off by {share:.3g}")


def has_the_bits_of(first: IlluminationVolume, second: IlluminationVolume) -> Finding:
    """All channels agree bit for bit."""
    different = [
        name
        for name, grid in first.channels.items()
        if grid.values.tobytes() != second.channels[name].values.tobytes()
    ]
    return Finding("same for any threads", not different, "differ: " + ", ".join(different))


def refined(medium: Medium) -> Medium:
    """The same trilinear field on a lattice of half the voxel size."""
    emission = medium.emission
    return replace(
        medium,
        sigma_t=_refined(medium.sigma_t),
        sigma_s=_refined(medium.sigma_s),
        emission=None if emission is None else _refined(emission),
    )


def _refined(grid: Grid) -> Grid:
    values = grid.values.astype(np.float64)
    for axis in range(3):
        padded = np.moveaxis(np.pad(values, _pads(values.ndim, axis)), axis, 0)
        fine = np.empty((2 * len(padded) - 3, *padded.shape[1:]))
        fine[0::2] = (padded[:-1] + padded[1:]) / 2
        fine[1::2] = padded[1:-1]
        values = np.moveaxis(fine, 0, axis)
    affine = grid.index_to_world.copy()
    affine[:3, :3] /= 2
    affine[:3, 3] = grid.to_world(np.array([-0.5, -0.5, -0.5]))
    return Grid(values.astype(np.float32), affine, grid.name)


def _pads(dimensions: int, axis: int) -> list[tuple[int, int]]:
    return [(1, 1) if a == axis else (0, 0) for a in range(dimensions)]


def depth_across(medium: Medium) -> float:
    """An upper bound of the optical depth of any way through the medium."""
    extent = float(np.linalg.norm(np.ptp(medium.sigma_t.corners(), axis=0)))
    return float(medium.sigma_t.values.max()) * extent


def turned(scene: Scene, angle: float) -> Scene:
    """Suns turned and the eye moved by a small angle about the middle."""
    lights = []
    for light in scene.lights:
        if isinstance(light, DistantLight):
            toward = np.asarray(light.direction)
            light = replace(light, direction=toward + angle * _aside(toward))
        lights.append(light)
    camera = scene.camera
    if camera is not None:
        away = np.asarray(camera.position) - np.asarray(camera.look_at)
        size = float(np.linalg.norm(away))
        moved = away / size + angle * _aside(away / size)
        place = np.asarray(camera.look_at) + size * moved / np.linalg.norm(moved)
        camera = replace(camera, position=place)
    return replace(scene, lights=tuple(lights), camera=camera)


def _aside(direction: Field) -> Field:
    """A unit vector across, along no axis."""
    across = np.cross(direction, (0.36, 0.48, -0.8))
    return np.asarray(across / np.linalg.norm(across))


def is_continuous(one: Field, two: Field, scale: float, estimate: float, chance: float) -> Finding:
    """Turned a little to either side, the solution changes by next to nothing; two numerical
    solutions differ from it by at most the estimate each."""
    change = rms(one - two) / scale if scale else rms(one - two)
    return Finding("continuous", change <= TURNED + 2 * estimate + chance, f"{change:.3g}")
