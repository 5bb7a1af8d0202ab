"""The exact solution of a model's own equation, by brute force from its operator alone.

What is evaluated for an operator (`native/src/exact/`):

    order 1, law exp                         exact optical depths along random rays of the lobe
    order inf, further scatterings in the    random walks toward the light
    same lobe
    law linear or bounded                    sums along random rays, each ray exact
    light gathers colour or glow on its      quadrature to rounding along random rays, hue and
    way, split or not                        luminance of each
    order inf, phase function                random walks that seek every kind of light: full
                                             scattering
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.control import Control
from ..core.errors import bad
from ..core.medium import Medium
from ..core.native import native
from ..core.scene import Scene
from .equation import native_equation
from .illuminate import VOID_MARGIN
from .model import Equation
from .operator import gather_terms
from .registry import get

# Independent randomisations behind every standard error.
REPLICATES = 8
# Between the seeds of the equations of one model, so that their errors are independent.
SEEDS = 1_000_003
# More than this share of the light's paths given up is an error; less is told in the estimate.
MOST_NEGLECTED = 0.01


@dataclass(frozen=True, eq=False)
class Estimate:
    """Values and their standard errors, of equal shape [..., 3], or of coefficients [..., 1 or 3].

    `neglected` is the largest share of the light's paths to any of the points that was given up,
    because it scattered more often than is followed: the values may be low by as much.
    """

    value: NDArray[np.float64]
    standard_error: NDArray[np.float64]
    neglected: float = 0.0


def exact(
    scene: Scene,
    model: str | Mapping[str, str],
    points: ArrayLike,
    samples: int = 4096,
    seed: int = 0,
    control: Control | None = None,
    view: ArrayLike | None = None,
    clamped: bool = True,
    **parameters: object,
) -> Estimate:
    """In-scattered radiance of the model's exact solution at world points [n, 3].

    `samples` directions or walks a point. Shares no code with the bakes: it is driven by the
    model's operator, marches rays exactly through the trilinear medium and randomises them.

    `view` are unit directions toward the eye, [3] or [n, 3], on which the value depends only where
    the medium's g counts; None: toward the scene's camera. `clamped` False leaves negative values
    negative where the model clamps them at 0.

    Raises InputError where a bounded amount of work cannot follow the light (white, very deep
    media).
    """
    where = np.ascontiguousarray(points, dtype=np.float64)
    if where.ndim != 2 or where.shape[1] != 3:
        raise bad("points' shape", where.shape, "(n, 3)")
    chosen = get(model)
    chosen.check(scene)
    equations = chosen.equations(scene, chosen.values(parameters))
    return _sum(
        [
            _in_scattered(equation, where, samples, seed + SEEDS * index, control, view, clamped)
            for index, equation in enumerate(equations)
        ]
    )


def _in_scattered(
    equation: Equation,
    where: NDArray[np.float64],
    samples: int,
    seed: int,
    control: Control | None,
    view: ArrayLike | None,
    clamped: bool,
) -> Estimate:
    operator, trimmed = equation.operator, equation.scene.trimmed(VOID_MARGIN)
    medium, lights = trimmed.medium, trimmed.lights
    rows = native_equation(operator, medium, lights)
    return _estimate(
        *native.exact_in_scattered(
            medium.sigma_t.planes(),
            medium.sigma_t.index_to_world,
            where,
            [term.native() for term in gather_terms(operator, trimmed, lights)],
            sigma_s=medium.sigma_s.planes(),
            emission=_emission(medium, operator.gathers_emission),
            equation=rows,
            view=_views(trimmed, where, view) if rows.get("g", 0.0) != 0 else None,
            radius=operator.radius,
            directions=samples,
            replicates=REPLICATES,
            seed=seed,
            clamp=operator.clamped and clamped,
            control=control.native if control else None,
        )
    )


def exact_coefficients(
    scene: Scene,
    model: str,
    points: ArrayLike,
    samples: int = 4096,
    seed: int = 0,
    control: Control | None = None,
    **parameters: object,
) -> Estimate:
    """V_lm [n, count, 1 or 3] of the visibility at world points [n, 3], one a colour of the
    extinction, for the bands that the model's operator has.

    `samples` directions a point, for all coefficients alike. Raises InputError for a model without
    a basis.
    """
    chosen = get(model)
    operator = chosen.operator_in(scene, chosen.values(parameters))
    if operator.basis is None:
        raise bad("the operator's basis", None, "an order and a window: a model of coefficients")
    sigma_t = scene.trimmed(VOID_MARGIN).medium.sigma_t
    return Estimate(
        *native.exact_visibility_harmonics(
            sigma_t.planes(),
            sigma_t.index_to_world,
            np.ascontiguousarray(points, dtype=np.float64),
            order=operator.basis[0],
            radius=operator.radius,
            directions=samples,
            replicates=REPLICATES,
            seed=seed,
            control=control.native if control else None,
        )
    )


def exact_image(
    scene: Scene,
    model: str | Mapping[str, str],
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
    chosen.check(scene)
    equations = chosen.equations(scene, chosen.values(parameters or {}))
    return _sum(
        [
            _image(
                equation, width, height, points, directions, seed + SEEDS * index, control, clamped
            )
            for index, equation in enumerate(equations)
        ]
    )


def _image(
    equation: Equation,
    width: int,
    height: int,
    points: int,
    directions: int,
    seed: int,
    control: Control | None,
    clamped: bool,
) -> Estimate:
    operator, trimmed = equation.operator, equation.scene.trimmed(VOID_MARGIN)
    medium, lights = trimmed.medium, trimmed.lights
    if operator.gathers_emission and not operator.image_emission:
        raise bad("the operator's emission", "gathered but not in the image", "both or neither")
    return _estimate(
        *native.exact_image(
            medium.sigma_t.planes(),
            medium.sigma_s.planes(),
            _emission(medium, operator.image_emission),
            medium.sigma_t.index_to_world,
            [term.native() for term in gather_terms(operator, trimmed, lights)],
            trimmed.need_camera().rays(width, height),
            width,
            height,
            equation=native_equation(operator, medium, lights),
            radius=operator.radius,
            points=points,
            directions=directions,
            replicates=REPLICATES,
            seed=seed,
            clamp=operator.clamped and clamped,
            control=control.native if control else None,
        )
    )


def _sum(estimates: list[Estimate]) -> Estimate:
    """The sum of independent estimates."""
    if len(estimates) == 1:
        return estimates[0]
    return Estimate(
        np.sum([each.value for each in estimates], axis=0),
        np.sqrt(np.sum([each.standard_error**2 for each in estimates], axis=0)),
        max(each.neglected for each in estimates),
    )


def _emission(medium: Medium, wanted: bool) -> NDArray[np.float32] | None:
    return medium.emission.planes() if wanted and medium.emission is not None else None


def _views(
    scene: Scene, points: NDArray[np.float64], view: ArrayLike | None
) -> NDArray[np.float64]:
    """Unit directions toward the eye, [n, 3]."""
    if view is None:
        camera = scene.need_camera()
        toward = np.broadcast_to(-camera.forward, points.shape)
        if not camera.orthographic:
            toward = camera.eye - points
    else:
        toward = np.asarray(view, np.float64)
        if toward.shape not in ((3,), points.shape):
            raise bad("view's shape", toward.shape, f"(3,) or {points.shape}")
        toward = np.broadcast_to(toward, points.shape)
    length = np.linalg.norm(toward, axis=-1, keepdims=True)
    if not np.all(length > 0):
        raise bad("view", "zero at a point", "directions toward the eye")
    return np.ascontiguousarray(toward / length)


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
