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

import numpy as np
from numpy.typing import NDArray

from ..core.camera import Camera
from ..core.control import Control
from ..core.directions import AngularLattice, about, cone_rule
from ..core.errors import InputError
from ..core.grid import Grid
from ..core.lights import Light
from ..core.medium import Medium
from ..core.native import native
from ..core.scene import Scene
from .engines import channels_of, sweep
from .model import Model, Need, Values
from .operator import Operator, brightness
from .published import SLICES, blurred_slices, is_published
from .settings import CONE_DIRECTIONS, CONE_LADDER, NEAR_SLICES, cone_theta
from .volume import Factor, RadianceTerm

# The weights of a perspective cone are interpolated between nodes whose axes differ by at most this
# share of the angular lattice's spacing (measured on a smooth
# field of 64 voxels: 0.03 % RMS, of 0.19 % in all).
AXIS_STEP = 0.4
WIDEST_NODE_SPACING = 16
# The eye must keep this many node spacings away from the voxels, or the axis turns too fast.
CLOSEST_EYE = 1.0


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
        return {"visibility": channels_of(sigma_t, planes, "visibility")}
    if camera.orthographic:
        vectors, weights = cone_rule(theta, count)
        planes = sweep(sigma_t, about(vectors, -camera.forward), weights[:, None], near, control)
        return {"visibility": channels_of(sigma_t, planes[:, 0], "visibility")}
    lattice, field, spacing = perspective_weights(sigma_t, camera, theta, count)
    per_channel = []
    for index, plane in enumerate(sigma_t.planes()):
        with control.stage(index / sigma_t.channels, (index + 1) / sigma_t.channels, "sweeping"):
            per_channel.append(
                native.sweep_weighted(
                    plane, sigma_t.index_to_world, lattice, field, spacing,
                    near_slices=near, control=control.native)
            )  # fmt: skip
    # Cubic weights have negative lobes: at edges they may leave a visibility's range by 1e-3.
    planes = np.clip(np.stack(per_channel), 0, 1)
    return {"visibility": channels_of(sigma_t, planes, "visibility")}


def perspective_weights(
    grid: Grid, camera: Camera, theta: float, count: int
) -> tuple[NDArray[np.float64], NDArray[np.float32], int]:
    """Directions [d, 3], their weights [d, a, b, c] at nodes every `spacing` voxels, and `spacing`.

    Raises InputError when the eye is so near that the cone's axis is not smooth between voxels.
    """
    size = np.array(grid.shape)
    index_eye = grid.to_index(camera.eye)
    nearest = np.clip(index_eye, 0, size - 1)
    distance = float(np.linalg.norm(camera.eye - grid.to_world(nearest)))
    angle = math.sqrt(2 * math.pi * (1 - math.cos(theta)) / count)
    voxel = float(grid.voxel_size.max())
    spacing = min(WIDEST_NODE_SPACING, int(AXIS_STEP * angle * distance / voxel))
    if spacing < 1 or distance < CLOSEST_EYE * spacing * voxel:
        raise InputError(
            f"the camera is {distance:.4g} from the volume's voxels of {voxel:.4g}; expected at "
            f"least {voxel / (AXIS_STEP * angle):.4g}: directional occlusion's cone toward the "
            "eye turns too fast there (move the camera away, widen theta, or take an "
            "orthographic camera)"
        )
    nodes = [np.arange(math.ceil((n - 1) / spacing) + 1) * spacing for n in grid.shape]
    index = np.stack(np.meshgrid(*nodes, indexing="ij"), axis=-1).astype(np.float64)
    axes = camera.eye - grid.to_world(index.reshape(-1, 3))
    axes /= np.linalg.norm(axes, axis=-1, keepdims=True)
    lattice = AngularLattice.covering(axes, theta, count)
    weights = lattice.cone_weights(axes, theta)
    used = np.abs(weights).max(axis=1) > 0
    field = np.ascontiguousarray(weights[used].reshape(-1, *(len(n) for n in nodes)))
    return np.ascontiguousarray(lattice.directions[used]), field, spacing


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
    parameters=(cone_theta(math.radians(30)), CONE_DIRECTIONS, NEAR_SLICES, *SLICES),
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
