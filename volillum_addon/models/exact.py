"""The exact solution of a model's own equation, by brute force from its operator alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.control import Control
from ..core.errors import bad
from ..core.native import native
from ..core.scene import Scene
from .illuminate import VOID_MARGIN
from .operator import gather_terms
from .registry import get

# Independent randomisations behind every standard error.
REPLICATES = 8


@dataclass(frozen=True, eq=False)
class Estimate:
    """Values and their standard errors, of equal shape [..., 3]."""

    value: NDArray[np.float64]
    standard_error: NDArray[np.float64]


def exact(
    scene: Scene,
    model: str,
    points: ArrayLike,
    samples: int = 4096,
    seed: int = 0,
    control: Control | None = None,
    **parameters: object,
) -> Estimate:
    """In-scattered radiance of the model's exact solution at world points [n, 3].

    `samples` directions a point. Shares no code with the bakes: it is driven by the model's
    operator, marches rays exactly through the trilinear medium and randomises its directions.
    """
    where = np.ascontiguousarray(points, dtype=np.float64)
    if where.ndim != 2 or where.shape[1] != 3:
        raise bad("points' shape", where.shape, "(n, 3)")
    chosen = get(model)
    operator = chosen.operator(chosen.values(parameters))
    chosen.check(scene)
    trimmed = scene.trimmed(VOID_MARGIN)
    sigma_t = trimmed.medium.sigma_t
    value, error = native.exact_in_scattered(
        sigma_t.planes(),
        sigma_t.index_to_world,
        where,
        [term.native() for term in gather_terms(operator, trimmed, chosen.represented(trimmed))],
        radius=operator.radius,
        directions=samples,
        replicates=REPLICATES,
        seed=seed,
        clamp=operator.clamped,
        control=control.native if control else None,
    )
    return Estimate(value, error)


def exact_image(
    scene: Scene,
    model: str,
    width: int,
    height: int,
    parameters: Mapping[str, object] | None = None,
    points: int = 8,
    directions: int = 64,
    seed: int = 0,
    control: Control | None = None,
    clamped: bool = True,
) -> Estimate:
    """The image [h, w, 3] of the model's exact solution, without background, top row first.

    Per pixel and replicate `points` points along the ray with `directions` directions each.
    `clamped` False leaves negative in-scattered radiance negative where the model clamps it at 0.
    """
    chosen = get(model)
    operator = chosen.operator(chosen.values(parameters or {}))
    chosen.check(scene)
    trimmed = scene.trimmed(VOID_MARGIN)
    medium = trimmed.medium
    emission = medium.emission if operator.image_emission else None
    value, error = native.exact_image(
        medium.sigma_t.planes(),
        medium.sigma_s.planes(),
        emission.planes() if emission is not None else None,
        medium.sigma_t.index_to_world,
        [term.native() for term in gather_terms(operator, trimmed, chosen.represented(trimmed))],
        scene.need_camera().rays(width, height),
        width,
        height,
        radius=operator.radius,
        points=points,
        directions=directions,
        replicates=REPLICATES,
        seed=seed,
        clamp=operator.clamped and clamped,
        control=control.native if control else None,
    )
    return Estimate(value, error)
