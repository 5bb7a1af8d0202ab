"""A model's own equation as data: one row of the comparison of the paper.

    L_i(x) = N * integral f(omega; axis, lobe) Q(x, omega) d omega
    Q(x, omega) = L_src(x, omega) T_R(x, omega)
                  + integral_0^R w(s) T(x, x + s omega) [e sigma_a L_e + m sigma_s L_i] ds
    image:  L = integral tau (sigma_a L_e [where the model has it] + sigma_s L_i) ds

What judges a model (`models/exact.py`) is driven by this row and the scene alone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ..core import harmonics
from ..core.lights import DistantLight, EnvironmentLight, Light
from ..core.scene import Scene


@dataclass(frozen=True)
class Operator:
    """The terms of a model's equation (docs/mathematics.md has the equations).

    `lobe` and `axis` say over which outward directions light is gathered, `source` what arrives
    from there, `radius` how far occluders count (world units), `order` how many scatterings,
    `image_emission` whether the medium's own emission enters the image, `basis` whether the
    source is reduced to spherical harmonics of an order, with a window.
    """

    lobe: Literal["sphere", "cone"]
    axis: Literal["none", "light", "view"]
    source: Literal["constant", "light", "environment"]
    theta: float = math.pi
    radius: float = math.inf
    order: int = 1
    image_emission: bool = False
    basis: tuple[int, str] | None = None
    clamped: bool = False

    @property
    def sees_camera(self) -> bool:
        """Whether the equation itself depends on the camera."""
        return self.axis == "view"


@dataclass(frozen=True, eq=False)
class GatherTerm:
    """One lobe of directions and the radiance that arrives through it.

    L_i = sum over terms of the mean over the lobe of L(omega) T(x, omega). The lobe is the cone of
    half angle acos(cos_theta) about `axis` (`local`: about the direction from x to the point
    `axis`); `radiance` [k, 3] are spherical-harmonic coefficients of L over outward directions.
    """

    axis: NDArray[np.float64]
    local: bool
    cos_theta: float
    radiance: NDArray[np.float64]

    def native(self) -> tuple[NDArray[np.float64], bool, float, NDArray[np.float64]]:
        """As the native evaluator takes it."""
        return self.axis, self.local, self.cos_theta, self.radiance


def brightness(lights: tuple[Light, ...], centre: NDArray[np.float64]) -> NDArray[np.float64]:
    """Unoccluded L_i: RGB sum of F / (4 pi), local lights taken at the medium's centre."""
    total = np.zeros(3)
    for light in lights:
        total += light.fluence(centre)
    return total / (4 * math.pi)


def gather_terms(
    operator: Operator, scene: Scene, lights: tuple[Light, ...]
) -> tuple[GatherTerm, ...]:
    """The operator's lobes in this scene, for the lights that the model represents."""
    cosine = -1.0 if operator.lobe == "sphere" else math.cos(operator.theta)
    centre = scene.medium.sigma_t.centre
    if operator.axis == "view":
        camera = scene.need_camera()
        constant = _constant(brightness(lights, centre))
        axis = -camera.forward if camera.orthographic else camera.eye
        return (GatherTerm(axis, not camera.orthographic, cosine, constant),)
    if operator.axis == "light":
        terms = []
        for light in lights:
            assert isinstance(light, DistantLight)
            constant = _constant(light.fluence(centre) / (4 * math.pi))
            terms.append(GatherTerm(np.asarray(light.direction), False, cosine, constant))
        return tuple(terms)
    up = np.array([0.0, 0.0, 1.0])
    return (GatherTerm(up, False, cosine, truncated_radiance(operator, lights)),)


def truncated_radiance(operator: Operator, lights: tuple[Light, ...]) -> NDArray[np.float64]:
    """Coefficients [16, 3] of the lights' radiance, cut and windowed by the operator's basis."""
    assert operator.basis is not None
    order, window = operator.basis
    total = np.zeros((harmonics.COUNT, 3))
    for light in lights:
        assert isinstance(light, DistantLight | EnvironmentLight)
        total += light.harmonics()
    return total * harmonics.window(window, order)[:, None]


def _constant(radiance: NDArray[np.float64]) -> NDArray[np.float64]:
    return (radiance * math.sqrt(4 * math.pi))[None]
