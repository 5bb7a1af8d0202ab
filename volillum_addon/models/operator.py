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
from ..core.errors import bad
from ..core.lights import DistantLight, EnvironmentLight, Light, PointLight
from ..core.scene import Scene

# A band is dark where each of its coefficients is below this share of all: the pixels of an image
# of one radiance and 128 rows sum to 6e-5 in band 2.
DARK_BAND = 1e-4


@dataclass(frozen=True)
class Operator:
    """The terms of a model's equation (docs/mathematics.md has the equations).

    lobe, axis, theta, beta   over which outward directions light is gathered: the sphere, the
                     half space about the axis, a cone of half angle theta, a cone with the weight
                     cos^beta, or the medium's phase function
    source           what arrives from outside: one constant (the sum of F / (4 pi)), each light
                     spread over the lobe about it, the radiance of distant light, or every light
                     as it is
    radius           how far the medium counts, world units
    law              "exp": attenuation exp(-od). "linear": 1 - od_w, the first order of Taylor's
                     series with the distance weight below, medium on the way not attenuated.
                     "bounded": 1 - the mean opacity with that weight, opacities
                     1 - exp(-sigma_t reference_length) being of voxels, interpolated like a medium
    weight_p         the medium at distance s counts as s^(2 - p) along the ray (2: physical)
    order            how many scatterings: 1, or math.inf
    rescatter        the directions of further scatterings: the same lobe, or the phase function
    gathers_emission whether sigma_a L_e on the way is gathered
    gathers_colour   share of the medium's own scattered colour on the way that is gathered
    split            "luminance": brightness from the axis alone, colour from the lobe
    image_emission   whether the medium's own emission enters the image
    basis            whether the source is cut to spherical harmonics: an order and a window
    clamped          whether in-scattered radiance below 0 is displayed as 0
    """

    lobe: Literal["sphere", "hemisphere", "cone", "phong", "phase"]
    axis: Literal["none", "light", "view", "gradient"]
    source: Literal["constant", "light", "environment", "lights"]
    theta: float = math.pi
    beta: float = 0.0
    radius: float = math.inf
    law: Literal["exp", "linear", "bounded"] = "exp"
    weight_p: float = 2.0
    reference_length: float = 0.0
    order: float = 1
    rescatter: Literal["none", "lobe", "phase"] = "none"
    gathers_emission: bool = False
    gathers_colour: float = 0.0
    split: Literal["none", "luminance"] = "none"
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

    The lobe is the cone of half angle acos(cos_theta) about the direction `axis`, or, toward a
    "point" or a "lamp", about the direction from x to the point `axis`. `radiance` [k, 3] are
    spherical-harmonic coefficients of L over outward directions; a lamp's is that at distance 1.
    """

    axis: NDArray[np.float64]
    toward: Literal["direction", "point", "lamp"]
    cos_theta: float
    radiance: NDArray[np.float64]

    def native(self) -> tuple[NDArray[np.float64], str, float, NDArray[np.float64]]:
        """As the native evaluator takes it."""
        return self.axis, self.toward, self.cos_theta, self.radiance


def brightness(lights: tuple[Light, ...], centre: NDArray[np.float64]) -> NDArray[np.float64]:
    """Unoccluded L_i: RGB sum of F / (4 pi), local lights taken at the medium's centre."""
    total = np.zeros(3)
    for light in lights:
        total += light.fluence(centre)
    return total / (4 * math.pi)


def gather_terms(
    operator: Operator, scene: Scene, lights: tuple[Light, ...]
) -> tuple[GatherTerm, ...]:
    """The operator's lobes in this scene, for the lights that the model represents.

    None where every light comes as it is: full scattering.
    """
    if operator.source == "lights":
        return ()
    cosine = math.cos(operator.theta) if operator.lobe in ("cone", "phong") else -1.0
    centre = scene.medium.sigma_t.centre
    if operator.axis == "view":
        camera = scene.need_camera()
        constant = _constant(brightness(lights, centre))
        axis = -camera.forward if camera.orthographic else camera.eye
        toward: Literal["direction", "point"] = "direction" if camera.orthographic else "point"
        return (GatherTerm(axis, toward, cosine, constant),)
    if operator.axis == "light":
        return tuple(_light_term(light, cosine) for light in lights)
    up = np.array([0.0, 0.0, 1.0])
    if operator.source == "constant":
        return (GatherTerm(up, "direction", cosine, _constant(brightness(lights, centre))),)
    return (GatherTerm(up, "direction", cosine, truncated_radiance(operator, lights)),)


def _light_term(light: Light, cosine: float) -> GatherTerm:
    """The lobe about the direction to a light, filled with its F / (4 pi)."""
    if isinstance(light, DistantLight):
        constant = _constant(light.fluence(np.zeros(3)) / (4 * math.pi))
        return GatherTerm(np.asarray(light.direction), "direction", cosine, constant)
    if isinstance(light, PointLight):
        constant = _constant(np.asarray(light.intensity) / (4 * math.pi))
        return GatherTerm(np.asarray(light.position), "lamp", cosine, constant)
    raise bad("a light with one direction", light.kind, "a distant or a point light")


def truncated_radiance(operator: Operator, lights: tuple[Light, ...]) -> NDArray[np.float64]:
    """Coefficients [16, 3] of the lights' radiance, cut and windowed by the operator's basis."""
    assert operator.basis is not None
    order, window = operator.basis
    total = np.zeros((harmonics.COUNT, 3))
    for light in lights:
        assert isinstance(light, DistantLight | EnvironmentLight)
        total += light.harmonics()
    return total * harmonics.window(window, order)[:, None]


def highest_band(light: Light) -> int:
    """The highest harmonic band in which a distant light's radiance has energy, 0 to 3."""
    if not isinstance(light, DistantLight | EnvironmentLight):
        return 0
    size = np.abs(light.harmonics()).sum(axis=1)
    lit = np.flatnonzero(size > DARK_BAND * size.sum())
    return math.isqrt(int(lit[-1])) if len(lit) else 0


def _constant(radiance: NDArray[np.float64]) -> NDArray[np.float64]:
    return (radiance * math.sqrt(4 * math.pi))[None]
