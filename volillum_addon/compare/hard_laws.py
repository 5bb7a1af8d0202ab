"""What must hold of every model in every hard scene.

Every bound is derived from the model's own operator, the scene's lights and a refinement of the
numerics; none is fitted to what was found. Errors are relative to the light that would arrive
unoccluded, because a shadow may be of any depth:

    error  RMS over some voxels of (baked - exact) over the scale, the larger of the RMS of the
           exact solution and of the unoccluded radiance there
    bound  2 RMS over all voxels of (baked - refined), and what chance adds: refined is the bake of
           the same trilinear field on a lattice of half the voxel size with the finest settings of
           the model's ladder, or, of half balls, the sums on such a lattice. A method whose error
           at least halves in that step, as any of first order or better does, has an error of at
           most twice the difference (Richardson). A mean
           over a voxel (Model.averages) does not come closer to the value at its centre where light
           ends just there: it differs by at most the mean of what the exact solution differs by
           within the voxel, and that is added.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from ..core.camera import Camera
from ..core.colour import LUMINANCE
from ..core.lights import DistantLight, Light, PointLight
from ..core.medium import Medium
from ..core.scene import Scene
from ..models.angular import Moment
from ..models.operator import Operator
from ..models.volume import STANDARD_ERROR, IlluminationVolume
from .hard_bounds import (
    Field,
    conserved_radiance,
    most_radiance,
    noise,
    rms,
    wide,
)

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


@dataclass(frozen=True)
class Finding:
    """One law: whether it holds, and in figures how far from it the cell is."""

    law: Law
    holds: bool
    detail: str = ""


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
