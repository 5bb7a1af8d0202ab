"""An operator in a medium, as the exact evaluator takes it.

Written for the judge alone, from the equations (docs/mathematics.md): bakes prepare their own.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..core.errors import bad
from ..core.grid import Grid
from ..core.lights import (
    AreaLight,
    DistantLight,
    EnvironmentLight,
    Light,
    PointLight,
    SpotLight,
)
from ..core.medium import Medium
from .operator import Operator

Planes = NDArray[np.float32]
# A change from voxel to voxel that is less than this share of the voxel's value has no direction.
FLAT = 1e-5


def native_equation(
    operator: Operator, medium: Medium, lights: tuple[Light, ...]
) -> dict[str, object]:
    """What `exact_in_scattered` and `exact_image` call `equation`."""
    if operator.lobe == "phase" and operator.rescatter == "phase" and math.isinf(operator.order):
        return {
            "kind": "transported",
            "g": medium.g,
            "emission": float(operator.gathers_emission),
            "lights": [native_light(light, medium.sigma_t) for light in lights],
        }
    gathers = operator.gathers_colour > 0 or operator.gathers_emission
    if operator.law != "exp":
        return _occluded(operator, medium)
    if operator.order == 1:
        if not gathers and operator.split == "none":
            return {"kind": "gather"}
        return {
            "kind": "coloured",
            "beta": operator.beta if operator.lobe == "phong" else 0.0,
            "colour": operator.gathers_colour,
            "emission": float(operator.gathers_emission),
            "split": float(operator.split == "luminance"),
        }
    if operator.rescatter == "lobe" and math.isinf(operator.order) and not gathers:
        return {"kind": "scattered"}
    raise bad("the operator", operator, "one that the exact evaluator knows (models/exact.py)")


def cost(operator: Operator) -> int:
    """About how many rays of visibility one sample of this equation takes as long as (measured on
    random media: 0.8 us a ray, 2 us a walk in a cone, 17 us a ray with its colour, 20 to 40 us a
    walk of full scattering)."""
    if math.isinf(operator.order):
        return 40 if operator.rescatter == "phase" else 3
    return 20 if operator.split != "none" else 1


def native_light(light: Light, lattice: Grid) -> dict[str, object]:
    """A light as the evaluator of full scattering takes it.

    Its share of the effort goes by what of it arrives at the medium, half of all alike: a light
    that is dark at the centre is still looked for.
    """
    if isinstance(light, DistantLight):
        fluence = light.fluence(lattice.centre)
        return {
            "kind": "distant",
            "colour": fluence,
            "direction": np.asarray(light.direction),
            "cos_angle": math.cos(light.angle / 2),
            "share": 1 + float(fluence.mean()),
        }
    if isinstance(light, EnvironmentLight):
        share = 1 + float(light.fluence(lattice.centre).mean())
        radiance = np.asarray(light.radiance)
        if not light.is_image:
            return {"kind": "constant", "colour": radiance, "share": share}
        rotation = np.eye(3) if light.rotation is None else np.asarray(light.rotation)
        return {"kind": "image", "image": radiance, "rotation": rotation, "share": share}
    assert isinstance(light, PointLight | SpotLight | AreaLight)
    away = np.asarray(light.position) - lattice.centre
    size = lattice.corners() - lattice.centre
    squared = max(float(away @ away), float((size**2).sum(axis=-1).max()))
    lamp: dict[str, object] = {
        "kind": "lamp",
        "colour": np.asarray(light.intensity),
        "position": np.asarray(light.position),
        "share": 1 + float(np.asarray(light.intensity).mean()) / squared,
    }
    if isinstance(light, PointLight):
        return lamp | {"shape": "point"}
    lamp["direction"] = np.asarray(light.direction)
    if isinstance(light, SpotLight):
        edge = math.cos(light.angle / 2)
        return lamp | {"shape": "spot", "cos_angle": edge, "blend": (1 - edge) * light.blend}
    width, height = light.half_axes
    flat = {"half_width": width, "half_height": height, "ellipse": float(light.ellipse)}
    return lamp | {"shape": "flat"} | flat


def _occluded(operator: Operator, medium: Medium) -> dict[str, object]:
    """L_i = L_b (1 - T_p + k E), with one medium for both: what occludes less what bleeds.

    The scale makes T_p of a homogeneous medium sigma_t R, and a mean of opacities their mean.
    """
    sigma_t = medium.sigma_t.planes().astype(np.float64)
    sigma_s = medium.sigma_s.planes().astype(np.float64)
    bounded = operator.law == "bounded"
    occluder, colour = sigma_t, sigma_s
    if bounded:
        if not operator.reference_length > 0:
            raise bad("the reference length", operator.reference_length, "more than 0")
        occluder = -np.expm1(-sigma_t * operator.reference_length)
        albedo = np.zeros(np.broadcast_shapes(sigma_s.shape, sigma_t.shape))
        np.divide(sigma_s, sigma_t, out=albedo, where=sigma_t > 0)
        colour = occluder * albedo
    if operator.gathers_colour > 0:
        occluder = occluder - operator.gathers_colour * colour
    p = operator.weight_p
    return {
        "kind": "occluded",
        "occluder": np.ascontiguousarray(occluder, dtype=np.float32),
        "outward": _outward(medium.sigma_t) if operator.lobe == "hemisphere" else None,
        "weight_p": p,
        "scale": (3 - p) * operator.radius ** (p - 3 if bounded else p - 2),
    }


def _outward(sigma_t: Grid) -> Planes:
    """-grad sigma_t in the world, by central differences of the voxels' (mean) values; 0 where they
    are the rounding of a constant."""
    values = np.pad(sigma_t.planes().mean(axis=0, dtype=np.float64), 1)
    inner = slice(1, -1)
    slopes = []
    for axis in range(3):
        ahead, behind = ([inner] * 3 for _ in range(2))
        ahead[axis], behind[axis] = slice(2, None), slice(0, -2)
        slopes.append((values[tuple(ahead)] - values[tuple(behind)]) / 2)
    steepness = np.sqrt(sum(slope**2 for slope in slopes))
    slopes = [np.where(steepness > FLAT * values[1:-1, 1:-1, 1:-1], s, 0) for s in slopes]
    # A gradient is a covector: it turns with the inverse's transpose.
    inverse = np.linalg.inv(sigma_t.index_to_world[:3, :3])
    outward = -np.tensordot(inverse.T, np.stack(slopes), 1)
    return np.ascontiguousarray(outward, dtype=np.float32)
