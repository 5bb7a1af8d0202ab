"""An operator in a medium, as the exact evaluator takes it.

Written for the judge alone, from the equations (docs/mathematics.md): bakes prepare their own.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..core.errors import bad
from ..core.grid import Grid
from ..core.medium import Medium
from .operator import Operator

Planes = NDArray[np.float32]


def native_equation(operator: Operator, medium: Medium) -> dict[str, object]:
    """What `exact_in_scattered` and `exact_image` call `equation`."""
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
    """-grad sigma_t in the world, by central differences of the voxels' (mean) values."""
    values = np.pad(sigma_t.planes().mean(axis=0, dtype=np.float64), 1)
    inner = slice(1, -1)
    slopes = []
    for axis in range(3):
        ahead, behind = ([inner] * 3 for _ in range(2))
        ahead[axis], behind[axis] = slice(2, None), slice(0, -2)
        slopes.append((values[tuple(ahead)] - values[tuple(behind)]) / 2)
    # A gradient is a covector: it turns with the inverse's transpose.
    inverse = np.linalg.inv(sigma_t.index_to_world[:3, :3])
    outward = -np.tensordot(inverse.T, np.stack(slopes), 1)
    return np.ascontiguousarray(outward, dtype=np.float32)
