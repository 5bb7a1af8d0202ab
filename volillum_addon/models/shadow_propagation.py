"""Shadow volume propagation (Ropinski, Doering, Rezk-Salama 2010), the paper's Eq. 8.

    L_i(x) = sum over lights of lambda(L_l T(x, omega_L)) gamma_mean(x)
    gamma_mean(x) = C integral over the cone C(omega_L, theta) of
                    cos^beta(omega, omega_L) gamma(L(x, omega)) d omega
    L(x, omega) = L_l T(x, infinity) + integral of T(x, s) (sigma_s L_l + sigma_a L_e) ds

lambda is the luminance (Rec. 709, linear light), gamma(L) = L / lambda(L) the hue, omega_L the
direction to the light, L_l = F / (4 pi) its unoccluded radiance, and C normalises Phong's lobe. So
the luminance is a hard shadow, and the medium that the light has passed lends it its hue. Where
lambda(L(x, omega)) < 1e-6 lambda(L_l) gamma is the hue of the light.

A point light's L_l is I / (4 pi d^2) at x, the shadow the single ray to it, and the lobe's rays end
where they are nearest to it. Beside a medium that glows, its hue mixes as if L_l were everywhere
what it is at the medium's centre.

gamma is not linear: L is complete before it is taken, for each direction and each light. Lights are
solved apart and summed. Neglects all scattering but the last and, for hue, the last but one, and
the phase function. The printed Eq. 8 lost the coefficients of its sources, and its cone is the
complement.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ..core.colour import LUMINANCE, luminance
from ..core.control import Control
from ..core.directions import about, cone_rule
from ..core.errors import bad
from ..core.grid import Grid, Region
from ..core.lights import DistantLight, Light, PointLight
from ..core.medium import Medium
from ..core.native import native
from ..core.scene import Scene
from .engines import falloff, sweep
from .local_cone import local_cones, parts
from .model import Model, Need, Parameter, Values
from .operator import Operator
from .published import PROPAGATION, is_published, propagated
from .settings import CONE_DIRECTIONS, CONE_LADDER, NEAR_SLICES, cone_theta
from .volume import Factor, RadianceTerm

# The hard shadow is one ray, whose errors no other direction averages out, and cheap: its near
# field is longer. RMS error on the CTs 0.7 % or less (4 slices: 3.2 %), in a quarter of a second.
SHADOW_NEAR_SLICES = 64
# Where less than this share of the light arrives, the hue is the light's own: a quotient of
# rounding errors otherwise.
DARKEST = 1e-6
# Of Phong's lobe about a point light this share of the weight is left out.
LOBE_REST = 1e-3
Directed = DistantLight | PointLight
# The share of the work that the hard shadow is, for the progress.
SHADOW_SHARE = 0.05


def operator(values: Values) -> Operator:
    """The row of this model."""
    return Operator(
        "phong", "light", "light", theta=float(values["theta"]), beta=float(values["beta"]),
        gathers_emission=True, gathers_colour=1.0, split="luminance", image_emission=True,
    )  # fmt: skip


def has_chroma(medium: Medium) -> bool:
    """Whether the medium can change the hue of light; the light's own is a factor otherwise."""
    return medium.channels == 3 or medium.sigma_s.channels == 3 or medium.emission is not None


def unoccluded(light: Light, medium: Medium) -> NDArray[np.float64]:
    """L_l: RGB F / (4 pi) at the medium's centre."""
    return np.asarray(light.fluence(medium.sigma_t.centre) / (4 * math.pi))


def hue(radiance: NDArray[np.float64]) -> NDArray[np.float64]:
    """gamma; a black light counts as white."""
    total = luminance(radiance)
    return radiance / total if total > 0 else np.ones(3)


def solve(scene: Scene, values: Values, control: Control) -> dict[str, Grid]:
    """For each light its hard shadow `shadow_0`, lambda(L_l T) / lambda(L_l), and the lobe's mean
    hue `chroma_0` (RGB) where the medium has colour or glows."""
    channels: dict[str, Grid] = {}
    lights = [light for light in scene.lights if isinstance(light, DistantLight | PointLight)]
    for index, light in enumerate(lights):
        with control.stage(index / len(lights), (index + 1) / len(lights), f"light {index + 1}"):
            if is_published(values):
                channels |= published(scene.medium, light, index, values, control)
                continue
            with control.stage(0, SHADOW_SHARE, "shadow"):
                name = f"shadow_{index}"
                channels[name] = hard_shadow(scene.medium, light, name, control, scene.wanted)
            if has_chroma(scene.medium):
                with control.stage(SHADOW_SHARE, 1, "hue"):
                    name = f"chroma_{index}"
                    if isinstance(light, PointLight):
                        found = lamp_hue(scene.medium, light, values, name, control)
                    else:
                        found = mean_hue(scene.medium, light, values, name, control)
                    channels[name] = found
    return channels


def published(
    medium: Medium, sun: Directed, index: int, values: Values, control: Control
) -> dict[str, Grid]:
    """The same channels from the published propagation: one lookup a slice in place of the lobe."""
    if isinstance(sun, PointLight):
        raise bad("the published algorithm's light", "a point light", "distant lights alone")
    colour, left = propagated(medium, np.asarray(sun.direction), values, control)
    lattice, light = medium.sigma_t, hue(unoccluded(sun, medium))
    incident = np.moveaxis(np.broadcast_to(left, (3, *lattice.shape)), 0, -1) * light
    name = f"shadow_{index}"
    shadow = (incident @ LUMINANCE).astype(np.float32)
    channels = {name: lattice.with_values(shadow, name)}
    if has_chroma(medium):
        incident = incident + np.moveaxis(colour, 0, -1) * light
        total = (incident @ LUMINANCE)[..., None]
        dark = total < DARKEST
        tint = np.where(dark, light, incident / np.where(dark, 1, total))
        name = f"chroma_{index}"
        channels[name] = lattice.with_values(tint.astype(np.float32), name)
    return channels


def hard_shadow(
    medium: Medium, light: Directed, name: str, control: Control, wanted: Region | None = None
) -> Grid:
    """lambda(L_l T(x, omega_L)) / lambda(L_l), of a point light L_l at the medium's centre."""
    sigma_t = medium.sigma_t
    if isinstance(light, PointLight):
        position = np.asarray(light.position)
        planes = falloff(sigma_t, position) * native.transmittance_to(
            sigma_t.planes(), sigma_t.index_to_world, position, control=control.native
        )
    else:
        toward = np.asarray(light.direction)[None]
        planes = sweep(
            sigma_t, toward, np.ones((1, 1)), SHADOW_NEAR_SLICES, control, wanted=wanted
        )[:, 0]
    if len(planes) == 1:
        return sigma_t.with_planes(planes, name)
    shares = (LUMINANCE * hue(unoccluded(light, medium))).astype(np.float32)
    return sigma_t.with_planes(np.tensordot(shares, planes, 1)[None], name)


def mean_hue(
    medium: Medium, sun: DistantLight, values: Values, name: str, control: Control
) -> Grid:
    """The hue gamma averaged over the lobe about the light, [i, j, k, 3]."""
    vectors, weights = cone_rule(
        float(values["theta"]), int(values["directions"]), float(values["beta"])
    )
    radiance = unoccluded(sun, medium)
    lobe = (
        medium.sigma_t.index_to_world,
        np.ascontiguousarray(about(vectors, np.asarray(sun.direction))),
        weights.astype(np.float32),
        hue(radiance),
    )
    near, token = int(values["near"]), control.native
    extinction, albedo = medium.extinction_colour, medium.constant_albedo
    if extinction is None or albedo is None or medium.emission is not None:
        tint, glow = per_luminance(radiance)
        swept = native.mean_hue(
            medium.sigma_t.planes(), medium.sigma_s.planes(), *lobe, colour=tint,
            emission=medium.emission.planes() if medium.emission is not None else None,
            emission_colour=glow, near_slices=near, control=token,
        )  # fmt: skip
    else:
        # L = L_l (T + albedo (1 - T)): optical depth is all that a direction needs.
        strongest = medium.sigma_t.planes()[int(extinction.argmax())]
        swept = native.mean_hue_uniform(
            strongest, *lobe, extinction, albedo * hue(radiance), near_slices=near, control=token
        )
    return medium.sigma_t.with_planes(swept, name)


def lamp_hue(medium: Medium, lamp: PointLight, values: Values, name: str, control: Control) -> Grid:
    """The hue gamma averaged over each voxel's own lobe about the lamp, [i, j, k, 3]."""
    lattice, beta = medium.sigma_t, float(values["beta"])
    # Where Phong's lobe has all but LOBE_REST of its weight, so that directions are not spent
    # where it has none.
    theta = float(values["theta"])
    theta = math.acos(max(math.cos(theta), LOBE_REST ** (1 / (beta + 1))))
    cones = local_cones(
        lattice, np.asarray(lamp.position), theta, int(values["directions"]), "a point light",
        "move the light out of the volume and away from it, or widen theta", beta=beta,
    )  # fmt: skip
    radiance = unoccluded(lamp, medium)
    tint, glow = per_luminance(radiance)
    total = np.zeros((3, *lattice.shape), np.float32)
    for part in parts(lattice, cones, control, to_lamp=True):
        seen = partial(part.before_lamp, lattice)
        total += native.mean_hue(
            seen(lattice.planes()), seen(medium.sigma_s.planes()), lattice.index_to_world,
            part.directions, part.weights, hue(radiance), colour=tint,
            emission=seen(medium.emission.planes()) if medium.emission is not None else None,
            emission_colour=glow, node_spacing=cones.spacing, near_slices=int(values["near"]),
            control=control.native,
        )  # fmt: skip
    return lattice.with_planes(total, name)


def per_luminance(
    radiance: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """By what sigma_s and sigma_a L_e are multiplied in (sigma_s L_l + sigma_a L_e) / lambda(L_l),
    RGB each; a black light scatters nothing."""
    scale = luminance(radiance) or 1.0
    return radiance / scale, np.full(3, 1 / scale)


def radiance(lights: tuple[Light, ...], medium: Medium, values: Values) -> tuple[RadianceTerm, ...]:
    """L_i = sum of lambda(L_l) shadow chroma, or L_l shadow where the medium has no colour."""
    terms = []
    for index, light in enumerate(lights):
        full = unoccluded(light, medium)
        factors: tuple[Factor, ...] = (Factor(f"shadow_{index}"),)
        if has_chroma(medium):
            full = np.full(3, luminance(full))
            factors = (*factors, Factor(f"chroma_{index}"))
        terms.append(RadianceTerm(factors, (full[0], full[1], full[2])))
    return tuple(terms)


MODEL = Model(
    id="shadow_propagation",
    label="Shadow volume propagation",
    citation="Ropinski, Doering, Rezk-Salama: Interactive Volumetric Lighting Simulating "
    "Scattering and Shadowing, PacificVis 2010",
    equation="8",
    summary="Hard shadows whose light takes on the colour of what it has passed.",
    parameters=(
        cone_theta(math.radians(30)),
        Parameter(
            "beta", 10.0,
            "Exponent of the lobe that gathers colour: 0 fills the cone, large ones look at the "
            "light alone",
            0.0, 1e4,
        ),
        # RMS error at camera-visible voxels of the head CT 0.15 %, the engine CT 0.7 %, coloured
        # smoke 0.05 %: hue matters only where light arrives, and there little is in its way.
        replace(CONE_DIRECTIONS, default=16),
        replace(NEAR_SLICES, default=1),
        *PROPAGATION,
    ),
    needs=(
        Need("light size", "ignores", "shadows are hard, whatever the sun's diameter"),
        Need("several lights", "approximates", "solved apart and summed: hues do not mix before"),
        Need("environment light", "ignores", "only lights with one direction"),
        Need("point lights", "represents", "outside the volume; a glow mixes as at its centre"),
        Need("spot and area lights", "ignores", "only distant and point lights"),
        Need("multiple scattering", "ignores", "what scatters on the way lends its hue alone"),
        Need("phase function", "ignores", "isotropic"),
        Need("emission", "represents", "lends the light its hue, and is in the image"),
        Need("chromatic extinction", "represents", "in the shadow's brightness and in the hue"),
    ),
    lights=frozenset({"distant", "point"}),
    rebake_on=frozenset({"extinction", "scattering", "emission", "light direction", "light hue"}),
    operator=operator,
    solve=solve,
    radiance=radiance,
    ladder=({"directions": 16, "near": 0}, {"directions": 16, "near": 1}, *CONE_LADDER[2::2]),
)  # fmt: skip
