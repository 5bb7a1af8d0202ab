"""Directional occlusion shading (Schott et al. 2009), the paper's Eqs. 6 and 7.

    L_i(x) = L_b (1 / Omega_C) integral over the cone C(omega_V, theta) of T(x, omega) d omega

omega_V is the direction from x to the eye (constant for an orthographic camera), theta the cone's
half angle, Omega_C = 2 pi (1 - cos theta), L_b the unoccluded radiance of all lights together.

Neglects where the light comes from (every light counts as a glow around the eye), all scattering
but the last, the phase function, and emission. The printed Eq. 7 lost a minus: its cone is the
complement. The published slice algorithm does not solve this equation (docs/mathematics.md).
"""

from __future__ import annotations

import math
from dataclasses import replace

from ..core.control import Control
from ..core.directions import about, cone_rule
from ..core.grid import Grid
from ..core.lights import Light
from ..core.medium import Medium
from ..core.scene import Scene
from .engines import sweep
from .local_cone import local_cones, visibility
from .model import Model, Need, Values
from .operator import Operator, brightness
from .published import SLICES, blurred_slices, is_published
from .settings import CONE_DIRECTIONS, CONE_LADDER, NEAR_SLICES, cone_theta
from .volume import Factor, RadianceTerm

# The voxels that the eye sees are at surfaces, and their cones look along the same rays out of the
# medium again: what remains of the error there is the far field's. In a cloud of 2 to 4 optical
# depths a voxel 10 slices leave 0.9 % where 4 leave 1.6 %, for a fifth more time.
NEAR = replace(NEAR_SLICES, default=10)


def operator(values: Values) -> Operator:
    """The row of this model."""
    return Operator("cone", "view", "constant", theta=float(values["theta"]))


def solve(scene: Scene, values: Values, control: Control) -> dict[str, Grid]:
    """Visibility of the cone toward the eye: one channel `visibility` (RGB if extinction is)."""
    camera = scene.need_camera()
    theta, count, near = float(values["theta"]), int(values["directions"]), int(values["near"])
    sigma_t = scene.medium.sigma_t
    if is_published(values):
        eye = None if camera.orthographic else camera.eye
        planes = blurred_slices(scene.medium, -camera.forward, values, control, eye)
        return {"visibility": sigma_t.with_planes(planes, "visibility")}
    if camera.orthographic:
        vectors, weights = cone_rule(theta, count)
        planes = sweep(
            sigma_t, about(vectors, -camera.forward), weights[:, None], near, control,
            wanted=scene.wanted,
        )  # fmt: skip
        return {"visibility": sigma_t.with_planes(planes[:, 0], "visibility")}
    cones = local_cones(
        sigma_t, camera.eye, theta, count, "the camera",
        "move the camera away, widen theta, or take an orthographic camera",
    )  # fmt: skip
    planes = visibility(sigma_t, cones, near, control, wanted=scene.wanted)
    return {"visibility": sigma_t.with_planes(planes, "visibility")}


def radiance(lights: tuple[Light, ...], medium: Medium, values: Values) -> tuple[RadianceTerm, ...]:
    """L_i = L_b V."""
    red, green, blue = brightness(lights, medium.sigma_t.centre)
    return (RadianceTerm((Factor("visibility"),), (red, green, blue)),)


MODEL = Model(
    id="directional_occlusion",
    label="Directional occlusion",
    citation="Schott, Pegoraro, Hansen, Boulanger, Bouatouch: A Directional Occlusion Shading "
    "Model for Interactive Direct Volume Rendering, EuroVis 2009",
    equation="6, 7",
    summary="Light from a cone around the eye: soft ambient shadows that follow the camera.",
    parameters=(cone_theta(math.radians(30)), CONE_DIRECTIONS, NEAR, *SLICES),
    needs=(
        Need("light direction", "ignores", "every light counts as a glow around the eye"),
        Need("light brightness", "approximates", "one constant: the sum of F / (4 pi)"),
        Need("multiple scattering", "ignores", "only the last scattering toward the eye"),
        Need("phase function", "ignores", "isotropic"),
        Need("emission", "ignores", "not in the model's equation"),
        Need("chromatic extinction", "represents", "one visibility per channel"),
    ),
    lights=frozenset({"distant", "point", "spot", "area", "environment"}),
    rebake_on=frozenset({"extinction", "camera"}),
    operator=operator,
    solve=solve,
    radiance=radiance,
    ladder=CONE_LADDER,
)
