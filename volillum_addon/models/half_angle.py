"""Half angle slicing (Kniss et al. 2003), the paper's Eq. 4 with Eq. 5.

    L_i(x) = 1 / Omega_C integral over C(omega_L, theta) of [ F / (4 pi) T(x, infinity)
             + integral_0^inf T(x, x + s omega) sigma_s L_i(x + s omega) ds ] domega

summed over the lights; omega_L is the direction to the light, theta the cone's half angle. Light is
scattered again and again, but always into the same cone: forward. So it moves only away from its
source, and one march in the light's frame solves the equation. Where nothing is absorbed L_i is
F / (4 pi) at every depth; theta -> 0 leaves exp(-integral of sigma_a).

A point light's F is I / d^2 at x, cones are about the direction to it wherever light scatters, and
rays end where they are nearest to it (docs/mathematics.md, half angle).

Neglects light that is scattered sideways or back, the phase function, emission, and lights without
one direction. The printed cone condition selects the complement of the cone, and its omega_o is to
be the direction to the light.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..core.control import Control
from ..core.directions import about, cone_rule
from ..core.errors import InputError
from ..core.grid import Grid
from ..core.lights import DistantLight, Light, PointLight
from ..core.medium import Medium
from ..core.native import native
from ..core.scene import Scene
from .engines import falloff, sweep
from .local_cone import local_cones, node_spacing, visibility
from .model import Model, Need, Parameter, Values
from .operator import Operator
from .published import SLICES, blurred_slices, is_published
from .settings import NEAR_SLICES
from .volume import Factor, RadianceTerm

# The share of the work that the unscattered light is, for the progress.
UNSCATTERED_SHARE = 0.2
# The smallest cosine between a point light's cones and the march: slices get as dense as its
# inverse.
FLATTEST = 0.1


def operator(values: Values) -> Operator:
    """The row of this model."""
    return Operator(
        "cone", "light", "light", theta=float(values["theta"]), order=math.inf, rescatter="lobe"
    )


def solve(scene: Scene, values: Values, control: Control) -> dict[str, Grid]:
    """Light of each sun and point light in units of its own at the medium's centre: channels
    `light_0`, `light_1`, ..."""
    lights = [light for light in scene.lights if isinstance(light, DistantLight | PointLight)]
    channels = {}
    for index, light in enumerate(lights):
        name = f"light_{index}"
        with control.stage(index / len(lights), (index + 1) / len(lights), f"light {index + 1}"):
            if isinstance(light, PointLight):
                planes = light_of_lamp(scene.medium, light, values, control)
            else:
                planes = light_of_sun(scene.medium, light, values, control)
        channels[name] = scene.medium.sigma_t.with_planes(planes, name)
    return channels


def light_of_sun(
    medium: Medium, sun: DistantLight, values: Values, control: Control
) -> NDArray[np.float32]:
    """L_i / L_l, [channels, i, j, k]."""
    axis = np.asarray(sun.direction)
    if is_published(values):
        return blurred_slices(medium, axis, values, control, scattered_on=True)
    vectors, weights = cone_rule(float(values["theta"]), int(values["directions"]))
    directions = np.ascontiguousarray(about(vectors, axis))
    # The unscattered light first, in the memory of the result, which may have more channels.
    planes = np.empty((_channels(medium), *medium.sigma_t.shape), np.float32)
    seen = planes[: medium.sigma_t.channels]
    with control.stage(0, UNSCATTERED_SHARE, "unscattered light"):
        near = int(values["near"])
        sweep(medium.sigma_t, directions, weights[:, None], near, control, out=seen[None])
    with control.stage(UNSCATTERED_SHARE, 1, "scattered light"):
        return marched(medium, axis, directions, weights, seen, values, control, out=planes)


def light_of_lamp(
    medium: Medium, lamp: PointLight, values: Values, control: Control
) -> NDArray[np.float32]:
    """L_i over L_l at the medium's centre, [channels, i, j, k]."""
    sigma_t, position = medium.sigma_t, np.asarray(lamp.position)
    theta, count = float(values["theta"]), int(values["directions"])
    advice = "move the light out of the volume and away from it, or widen theta"
    axis = position - sigma_t.centre
    axis /= np.linalg.norm(axis) or 1.0
    if is_published(values):
        node_spacing(sigma_t, position, theta, count, "a point light", advice)
        planes = blurred_slices(medium, axis, values, control, position, scattered_on=True)
        return planes * falloff(sigma_t, position)
    cones = local_cones(sigma_t, position, theta, count, "a point light", advice)
    # Without the negative lobes of cubic weights all that is marched stays within its bounds.
    march = local_cones(sigma_t, position, theta, count, "a point light", advice, covered=True)
    flattest = float((march.directions @ axis).min())
    if flattest < FLATTEST:
        raise InputError(
            f"the cones of half angle {math.degrees(theta):.4g} degrees toward a point light reach "
            f"{math.degrees(math.acos(flattest)):.4g} degrees from its direction at the volume's "
            f"centre; expected at most {math.degrees(math.acos(FLATTEST)):.4g} (move the light "
            "away from the volume, or narrow theta)"
        )
    with control.stage(0, UNSCATTERED_SHARE, "unscattered light"):
        near = int(values["near"])
        seen = visibility(sigma_t, cones, near, control, to_lamp=True)
    with control.stage(UNSCATTERED_SHARE, 1, "scattered light"):
        planes = marched(
            medium, axis, march.directions, march.weights, seen, values, control, position,
            march.spacing,
        )  # fmt: skip
    return planes * falloff(sigma_t, position)


def marched(
    medium: Medium,
    axis: NDArray[np.float64],
    directions: NDArray[np.float64],
    weights: NDArray[np.float64] | NDArray[np.float32],
    seen: NDArray[np.float32],
    values: Values,
    control: Control,
    lamp: NDArray[np.float64] | None = None,
    node_spacing: int = 1,
    out: NDArray[np.float32] | None = None,
) -> NDArray[np.float32]:
    """The solution of the march along `axis`, [channels, i, j, k], where `seen` of the light is
    not scattered; InputError where the light's lattice would have no end. `seen` is given up:
    `out` may begin with it."""
    if out is None and len(seen) == _channels(medium):
        out = seen
    try:
        planes: NDArray[np.float32] = native.cone_transport(
            medium.sigma_t.planes(),
            medium.sigma_s.planes(),
            medium.sigma_t.index_to_world,
            axis,
            directions,
            np.ascontiguousarray(weights),
            transmittance=seen,
            node_spacing=node_spacing,
            lamp=lamp,
            spacing=float(values["spacing"]),
            control=control.native,
            out=out,
        )
    except ValueError as error:
        raise InputError(f"Half angle slicing cannot march here: {error}") from error
    return planes


def _channels(medium: Medium) -> int:
    return max(medium.sigma_t.channels, medium.sigma_s.channels)


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
            0.68,
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
        Need("point lights", "represents", "outside the volume: inside, their cones turn too fast"),
        Need("spot and area lights", "ignores", "only distant and point lights"),
        Need("multiple scattering", "approximates", "only forward, within the cone of the light"),
        Need("phase function", "approximates", "one cone about the light at every scattering"),
        Need("emission", "ignores", "not in the model's equation"),
        Need("chromatic extinction", "represents", "one solution per channel"),
    ),
    lights=frozenset({"distant", "point"}),
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
