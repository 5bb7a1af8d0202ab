"""Half angle slicing (Kniss et al. 2003), the paper's Eq. 4 with Eq. 5.

    L_i(x) = 1 / Omega_C integral over C(omega_L, theta) of [ F / (4 pi) T(x, infinity)
             + integral_0^inf T(x, x + s omega) sigma_s L_i(x + s omega) ds ] domega

summed over the lights; omega_L is the direction to the light, theta the cone's half angle. Light is
scattered again and again, but always into the same cone: forward. So it moves only away from its
source, and one march in the light's frame solves the equation. Where nothing is absorbed L_i is
F / (4 pi) at every depth; theta -> 0 leaves exp(-integral of sigma_a).

Neglects light that is scattered sideways or back, the phase function, emission, and lights that are
not distant. The printed cone condition selects the complement of the cone, and its omega_o is to be
the direction to the light.
"""

from __future__ import annotations

import math

import numpy as np

from ..core.control import Control
from ..core.directions import about, cone_rule
from ..core.grid import Grid
from ..core.lights import DistantLight, Light
from ..core.medium import Medium
from ..core.native import native
from ..core.scene import Scene
from .engines import channels_of, sweep
from .model import Model, Need, Parameter, Values
from .operator import Operator
from .published import SLICES, blurred_slices, is_published
from .settings import NEAR_SLICES
from .volume import Factor, RadianceTerm


def operator(values: Values) -> Operator:
    """The row of this model."""
    return Operator(
        "cone", "light", "light", theta=float(values["theta"]), order=math.inf, rescatter="lobe"
    )


def solve(scene: Scene, values: Values, control: Control) -> dict[str, Grid]:
    """Light of each sun in units of its own: channels `light_0`, `light_1`, ..."""
    vectors, weights = cone_rule(float(values["theta"]), int(values["directions"]))
    medium, near = scene.medium, int(values["near"])
    suns = [light for light in scene.lights if isinstance(light, DistantLight)]
    channels = {}
    for index, sun in enumerate(suns):
        name, axis = f"light_{index}", np.asarray(sun.direction)
        with control.stage(index / len(suns), (index + 1) / len(suns), f"light {index + 1}"):
            if is_published(values):
                planes = blurred_slices(medium, axis, values, control, scattered_on=True)
                channels[name] = channels_of(medium.sigma_t, planes, name)
                continue
            directions = about(vectors, axis)
            with control.stage(0, 0.2, "unscattered light"):
                seen = sweep(medium.sigma_t, directions, weights[:, None], near, control)[:, 0]
            with control.stage(0.2, 1, "scattered light"):
                planes = native.cone_transport(
                    medium.sigma_t.planes(),
                    medium.sigma_s.planes(),
                    medium.sigma_t.index_to_world,
                    axis,
                    np.ascontiguousarray(directions),
                    weights,
                    transmittance=seen,
                    spacing=float(values["spacing"]),
                    control=control.native,
                )
        channels[name] = channels_of(medium.sigma_t, planes, name)
    return channels


def radiance(lights: tuple[Light, ...], medium: Medium, values: Values) -> tuple[RadianceTerm, ...]:
    """L_i = sum over the lights of F / (4 pi) times the channel."""
    terms = []
    for index, light in enumerate(lights):
        red, green, blue = light.fluence(medium.sigma_t.centre) / (4 * math.pi)
        terms.append(RadianceTerm((Factor(f"light_{index}"),), (red, green, blue)))
    return tuple(terms)


MODEL = Model(
    id="half_angle",
    label="Half angle",
    citation="Kniss, Premoze, Hansen, Shirley, McPherson: A Model for Volume Lighting and "
    "Modeling, IEEE Transactions on Visualization and Computer Graphics 9(2), 2003",
    equation="4 with 5",
    summary="Light that is scattered forward again and again, into a cone about its direction.",
    parameters=(
        Parameter(
            "theta",
            math.radians(30),
            "Half angle of the cone: wider blurs light and shadows more",
            math.radians(1),
            math.radians(85),
            "radians",
        ),
        Parameter(
            "directions",
            16,
            "Directions in the cone: more follow hard edges more closely, time grows in proportion",
            4,
            1024,
        ),
        Parameter(
            "spacing",
            0.7,
            "Step of the light's lattice: 1 for smoke, less for hard surfaces; time grows with its "
            "inverse cube",
            0.1,
            4.0,
            "voxels",
        ),
        NEAR_SLICES,
        *SLICES,
    ),
    needs=(
        Need("light size", "approximates", "every sun has the half angle theta"),
        Need("environment light", "ignores", "only lights with one direction"),
        Need("local lights", "ignores", "only distant lights"),
        Need("multiple scattering", "approximates", "only forward, within the cone of the light"),
        Need("phase function", "approximates", "one cone about the light at every scattering"),
        Need("emission", "ignores", "not in the model's equation"),
        Need("chromatic extinction", "represents", "one solution per channel"),
    ),
    lights=frozenset({"distant"}),
    rebake_on=frozenset({"extinction", "scattering", "light direction"}),
    operator=operator,
    solve=solve,
    radiance=radiance,
    ladder=(
        {"directions": 8, "spacing": 1.5, "near": 0},
        {"directions": 16, "spacing": 1.0, "near": 2},
        {"directions": 64, "spacing": 0.7, "near": 4},
        {"directions": 64, "spacing": 0.4, "near": 8},
    ),
)
