"""Scenes whose single scattering, rendered by Cycles, is a model's own equation.

Driven by the operator alone (docs/mathematics.md): a cone about a light is a sun of that size, a
cone about an orthographic view a sun behind the camera, a truncated expansion a world image. A
perspective cone about the eye, a finite radius or further scatterings have no such scene.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..core import harmonics
from ..core.lights import DistantLight, EnvironmentLight, Light, latitude_longitude
from ..core.scene import Scene
from ..models.operator import Operator, brightness, truncated_radiance

# Rows of the world image. Bilinear interpolation of band l errs by about l (l + 1) / 8 times the
# square of the pixel's angle: 2e-4 of band 3.
SKY_ROWS = 256


def witness_scenes(
    operator: Operator, scene: Scene, lights: tuple[Light, ...]
) -> tuple[tuple[float, Scene], ...] | None:
    """Weights and scenes whose weighted single-scattering images add up to the exact image.

    `lights` are those that the model represents. The sum is not clamped at 0 anywhere. None where
    Cycles cannot solve the equation.
    """
    if operator.order != 1 or not math.isinf(operator.radius):
        return None
    # The models scatter isotropically, and not the medium's own light, which Cycles scatters once
    # at 0 bounces: it is a scene of its own, without scattering.
    bare = replace(scene, medium=replace(scene.medium, emission=None, g=0.0))
    if operator.basis is not None and operator.lobe == "sphere":
        lit = _sky(truncated_radiance(operator, lights), bare)
    elif operator.lobe == "cone" and operator.source == "constant":
        suns = _suns(operator, bare, lights)
        if suns is None:
            return None
        lit = ((1.0, replace(bare, lights=suns)),)
    else:
        return None
    if operator.image_emission and scene.medium.emission is not None:
        black = scene.medium.sigma_s.with_values(np.zeros_like(scene.medium.sigma_s.values))
        glow = replace(scene, medium=replace(scene.medium, sigma_s=black), lights=())
        return (*lit, (1.0, glow))
    return lit


def _suns(operator: Operator, scene: Scene, lights: tuple[Light, ...]) -> tuple[Light, ...] | None:
    centre = scene.medium.sigma_t.centre
    if operator.axis == "light":
        if not all(isinstance(light, DistantLight) for light in lights):
            return None
        return tuple(
            _sun(np.asarray(light.direction), light.fluence(centre), operator.theta)
            for light in lights
            if isinstance(light, DistantLight)
        )
    if operator.axis == "view" and scene.need_camera().orthographic:
        fluence = 4 * math.pi * brightness(lights, centre)
        return (_sun(-scene.need_camera().forward, fluence, operator.theta),)
    return None


def _sun(
    direction: NDArray[np.float64], fluence: NDArray[np.float64], theta: float
) -> DistantLight:
    """A sun that fills the cone of half angle theta and has the fluence: E = F (1 + cos) / 2."""
    return DistantLight(direction, fluence * (1 + math.cos(theta)) / 2, 2 * theta)


def _sky(coefficients: NDArray[np.float64], scene: Scene) -> tuple[tuple[float, Scene], ...]:
    """The radiance's positive part minus its negative part, each a world that can exist."""
    directions, _ = latitude_longitude(SKY_ROWS, 2 * SKY_ROWS)
    radiance = (harmonics.evaluate(directions.reshape(-1, 3)) @ coefficients).reshape(
        directions.shape
    )
    positive = replace(scene, lights=(EnvironmentLight(np.maximum(radiance, 0)),))
    if radiance.min() >= 0:
        return ((1.0, positive),)
    negative = replace(scene, lights=(EnvironmentLight(np.maximum(-radiance, 0)),))
    return ((1.0, positive), (-1.0, negative))
