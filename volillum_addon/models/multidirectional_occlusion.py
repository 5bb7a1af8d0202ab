"""Multidirectional occlusion shading (Solteszova et al. 2010), the paper's Eq. 6 with Eq. 5.

    L_i(x) = sum over lights of F / (4 pi) (1 / Omega_C) integral over C(omega_L, theta) of T domega

omega_L is the direction to the light, theta the cone's half angle. A sun of angular diameter
2 theta has exactly this single scattering: Cycles at 0 bounces is a witness.

A point light's F is I / d^2 at x, and its rays end where they are nearest to it.

Neglects all scattering but the last, the phase function, emission, and lights without one
direction.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..core.control import Control
from ..core.directions import about, cone_rule
from ..core.grid import Grid, Region
from ..core.lights import DistantLight, Light, PointLight
from ..core.medium import Medium
from ..core.scene import Scene
from .engines import falloff, sweep
from .local_cone import local_cones, node_spacing, visibility
from .model import Model, Need, Values
from .operator import Operator
from .published import SLICES, blurred_slices, is_published
from .settings import CONE_DIRECTIONS, CONE_LADDER, NEAR_SLICES, cone_theta
from .volume import Factor, RadianceTerm


def operator(values: Values) -> Operator:
    """The row of this model."""
    return Operator("cone", "light", "constant", theta=float(values["theta"]))


def solve(scene: Scene, values: Values, control: Control) -> dict[str, Grid]:
    """Visibility of each light's cone: channels `visibility_0`, `visibility_1`, ...; that of a
    point light times (d0 / d)^2, d0 its distance from the medium's centre."""
    sigma_t = scene.medium.sigma_t
    lights = [light for light in scene.lights if isinstance(light, DistantLight | PointLight)]
    channels = {}
    for index, light in enumerate(lights):
        name = f"visibility_{index}"
        with control.stage(index / len(lights), (index + 1) / len(lights), f"light {index + 1}"):
            if isinstance(light, PointLight):
                planes = lamp_visibility(scene.medium, light, values, control, scene.wanted)
            else:
                planes = sun_visibility(scene.medium, light, values, control, scene.wanted)
        channels[name] = sigma_t.with_planes(planes, name)
    return channels


def sun_visibility(
    medium: Medium,
    sun: DistantLight,
    values: Values,
    control: Control,
    wanted: Region | None = None,
) -> NDArray[np.float32]:
    """V, [extinction channels, i, j, k]."""
    toward = np.asarray(sun.direction)
    if is_published(values):
        return blurred_slices(medium, toward, values, control)
    vectors, weights = cone_rule(float(values["theta"]), int(values["directions"]))
    return sweep(
        medium.sigma_t, about(vectors, toward), weights[:, None], int(values["near"]), control,
        wanted=wanted,
    )[:, 0]  # fmt: skip


def lamp_visibility(
    medium: Medium,
    lamp: PointLight,
    values: Values,
    control: Control,
    wanted: Region | None = None,
) -> NDArray[np.float32]:
    """V (d0 / d)^2, [extinction channels, i, j, k]."""
    sigma_t, position = medium.sigma_t, np.asarray(lamp.position)
    theta, count = float(values["theta"]), int(values["directions"])
    advice = "move the light out of the volume and away from it, or widen theta"
    if is_published(values):
        node_spacing(sigma_t, position, theta, count, "a point light", advice)
        toward = position - sigma_t.centre
        toward /= np.linalg.norm(toward)
        planes = blurred_slices(medium, toward, values, control, position)
    else:
        cones = local_cones(sigma_t, position, theta, count, "a point light", advice)
        planes = visibility(
            sigma_t, cones, int(values["near"]), control, to_lamp=True, wanted=wanted
        )
    return planes * falloff(sigma_t, position)


def radiance(lights: tuple[Light, ...], medium: Medium, values: Values) -> tuple[RadianceTerm, ...]:
    """L_i = sum of F / (4 pi) V over the lights."""
    terms = []
    for index, light in enumerate(lights):
        red, green, blue = light.fluence(medium.sigma_t.centre) / (4 * math.pi)
        terms.append(RadianceTerm((Factor(f"visibility_{index}"),), (red, green, blue)))
    return tuple(terms)


MODEL = Model(
    id="multidirectional_occlusion",
    label="Multidirectional occlusion",
    citation="Solteszova, Patel, Bruckner, Viola: A Multidirectional Occlusion Shading Model for "
    "Direct Volume Rendering, Computer Graphics Forum 29(3), 2010",
    equation="6 with 5",
    summary="Soft shadows from a cone around each light, independent of the camera.",
    parameters=(cone_theta(math.radians(30)), CONE_DIRECTIONS, NEAR_SLICES, *SLICES),
    needs=(
        Need("light size", "approximates", "every light fills the half angle theta"),
        Need("environment light", "ignores", "only lights with one direction"),
        Need("point lights", "represents", "outside the volume: inside, their cones turn too fast"),
        Need("spot and area lights", "ignores", "only distant and point lights"),
        Need("multiple scattering", "ignores", "only the last scattering toward the eye"),
        Need("phase function", "ignores", "isotropic"),
        Need("emission", "ignores", "not in the model's equation"),
        Need("chromatic extinction", "represents", "one visibility per channel"),
    ),
    lights=frozenset({"distant", "point"}),
    rebake_on=frozenset({"extinction", "light direction"}),
    operator=operator,
    solve=solve,
    radiance=radiance,
    ladder=CONE_LADDER,
)
