"""The exact solution of a model's own equation, by brute force from its operator alone.

What is evaluated for an operator (`native/src/exact/`):

    order 1, law exp                         exact optical depths along random rays of the lobe
    order inf, further scatterings in the    random walks toward the light
    same lobe
    law linear or bounded                    sums along random rays, each ray exact
    light gathers colour or glow on its      quadrature to rounding along random rays, hue and
    way, split or not                        luminance of each
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.control import Control
from ..core.errors import bad
from ..core.native import native
from ..core.scene import Scene
from .equation import native_equation
from .illuminate import VOID_MARGIN
from .operator import gather_terms
from .registry import get

# Independent randomisations behind every standard error.
REPLICATES = 8
# More than this share of the light's paths given up is an error; less is told in the estimate.
MOST_NEGLECTED = 0.01


@dataclass(frozen=True, eq=False)
class Estimate:
    """Values and their standard errors, of equal shape [..., 3].

    `neglected` is the largest share of the light's paths to any of the points that was given up,
    because it scattered more often than is followed: the values may be low by as much.
    """

    value: NDArray[np.float64]
    standard_error: NDArray[np.float64]
    neglected: float = 0.0


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

    `samples` directions or walks a point. Shares no code with the bakes: it is driven by the
    model's operator, marches rays exactly through the trilinear medium and randomises them.

    Raises InputError where a bounded amount of work cannot follow the light (white, very deep
    media).
    """
    where = np.ascontiguousarray(points, dtype=np.float64)
    if where.ndim != 2 or where.shape[1] != 3:
        raise bad("points' shape", where.shape, "(n, 3)")
    chosen = get(model)
    operator = chosen.operator_in(scene, chosen.values(parameters))
    chosen.check(scene)
    trimmed = scene.trimmed(VOID_MARGIN)
    medium = trimmed.medium
    return _estimate(
        *native.exact_in_scattered(
            medium.sigma_t.planes(),
            medium.sigma_t.index_to_world,
            where,
            [t.native() for t in gather_terms(operator, trimmed, chosen.represented(trimmed))],
            sigma_s=medium.sigma_s.planes(),
            equation=native_equation(operator, medium),
            radius=operator.radius,
            directions=samples,
            replicates=REPLICATES,
            seed=seed,
            clamp=operator.clamped,
            control=control.native if control else None,
        )
    )


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
    operator = chosen.operator_in(scene, chosen.values(parameters or {}))
    chosen.check(scene)
    trimmed = scene.trimmed(VOID_MARGIN)
    medium = trimmed.medium
    emission = medium.emission if operator.image_emission else None
    return _estimate(
        *native.exact_image(
            medium.sigma_t.planes(),
            medium.sigma_s.planes(),
            emission.planes() if emission is not None else None,
            medium.sigma_t.index_to_world,
            [t.native() for t in gather_terms(operator, trimmed, chosen.represented(trimmed))],
            scene.need_camera().rays(width, height),
            width,
            height,
            equation=native_equation(operator, medium),
            radius=operator.radius,
            points=points,
            directions=directions,
            replicates=REPLICATES,
            seed=seed,
            clamp=operator.clamped and clamped,
            control=control.native if control else None,
        )
    )


def _estimate(
    value: NDArray[np.float64], error: NDArray[np.float64], neglected: NDArray[np.float64]
) -> Estimate:
    share = float(neglected.max(initial=0.0))
    if share > MOST_NEGLECTED:
        raise bad(
            "the share of light that still scatters after 16384 collisions", f"{share:.2g}",
            f"at most {MOST_NEGLECTED}: a less deep medium, or an albedo below 1",
        )  # fmt: skip
    return Estimate(value, error, share)
