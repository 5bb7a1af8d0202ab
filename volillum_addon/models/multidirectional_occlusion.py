"""Multidirectional occlusion shading (Solteszova et al. 2010), the paper's Eq. 6 with Eq. 5.

    L_i(x) = sum over lights of F / (4 pi) (1 / Omega_C) integral over C(omega_L, theta) of T domega

omega_L is the direction to the light, theta the cone's half angle. A sun of angular diameter
2 theta has exactly this single scattering: Cycles at 0 bounces is a witness.

Neglects all scattering but the last, the phase function, emission, and lights that are not distant.
"""

from __future__ import annotations

import math

import numpy as np

from ..core.control import Control
from ..core.directions import about, cone_rule
from ..core.grid import Grid
from ..core.lights import DistantLight, Light
from ..core.medium import Medium
from ..core.scene import Scene
from .engines import channels_of, sweep
from .model import Model, Need, Values
from .operator import Operator
from .published import SLICES, blurred_slices, is_published
from .settings import CONE_DIRECTIONS, CONE_LADDER, NEAR_SLICES, cone_theta
from .volume import Factor, RadianceTerm


def operator(values: Values) -> Operator:
    """The row of this model."""
    return Operator("cone", "light", "constant", theta=float(values["theta"]))


def solve(scene: Scene, values: Values, control: Control) -> dict[str, Grid]:
    """Visibility of each sun's cone: channels `visibility_0`, `visibility_1`, ..."""
    vectors, weights = cone_rule(float(values["theta"]), int(values["directions"]))
    sigma_t = scene.medium.sigma_t
    suns = [light for light in scene.lights if isinstance(light, DistantLight)]
    channels = {}
    for index, sun in enumerate(suns):
        toward = np.asarray(sun.direction)
        with control.stage(index / len(suns), (index + 1) / len(suns), f"light {index + 1}"):
            if is_published(values):
                planes = blurred_slices(scene.medium, toward, values, control)
            else:
                directions, near = about(vectors, toward), int(values["near"])
                planes = sweep(sigma_t, directions, weights[:, None], near, control)[:, 0]
        name = f"visibility_{index}"
        channels[name] = channels_of(sigma_t, planes, name)
    return channels


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
    summary="Soft shadows from a cone around each sun, independent of the camera.",
    parameters=(cone_theta(math.radians(30)), CONE_DIRECTIONS, NEAR_SLICES, *SLICES),
    needs=(
        Need("light size", "approximates", "every sun has the half angle theta"),
        Need("environment light", "ignores", "only lights with one direction"),
        Need("local lights", "ignores", "only distant lights"),
        Need("multiple scattering", "ignores", "only the last scattering toward the eye"),
        Need("phase function", "ignores", "isotropic"),
        Need("emission", "ignores", "not in the model's equation"),
        Need("chromatic extinction", "represents", "one visibility per channel"),
    ),
    lights=frozenset({"distant"}),
    rebake_on=frozenset({"extinction", "light direction"}),
    operator=operator,
    solve=solve,
    radiance=radiance,
    ladder=CONE_LADDER,
)
