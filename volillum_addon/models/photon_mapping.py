"""Progressive photon mapping (Hachisuka et al. 2008, Knaus and Zwicker 2011), the paper's
Eqs. 14 to 16: the full volume rendering equation.

    L_i(x) = integral of p(omega . v) L(x, omega) d omega
    L(x, omega) = L_light T + integral of T (sigma_s L_i + sigma_a L_e) ds

Unscattered light is computed apart, exactly, one visibility a light; photons bring only what has
been scattered at least once. The estimate is the photons' track length in each voxel's box,
J = (1 / 4 pi) sum of power * length / volume: it has no kernel, works in the void and at borders,
and passes average without bias beyond the mean over a voxel.

The setting `estimate` = kernel is the paper's own: photons in balls whose radius shrinks from pass
to pass (photon_kernel.py), with bias and noise that both vanish.

Where the medium is anisotropic (g), unscattered light of one direction is multiplied by the phase
function toward the eye, and all other light is kept as directional moments up to l = 2, which g^l
carries through the phase function; the rest is estimated and noted. Nothing else of the equation is
neglected: what remains is noise, which falls with the root of the number of photons and is known at
every voxel.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..core.control import Control
from ..core.grid import Grid, occupied
from ..core.lights import Light
from ..core.medium import Medium
from ..core.scene import Scene
from . import photon_lights
from .angular import MOMENT_ORDER, MOMENTS, Moment
from .model import Model, Need, Parameter, Values
from .operator import Operator
from .photon_kernel import OPTIMAL_ALPHA
from .photon_state import LEAST_PASSES, PACK, PhotonState
from .settings import NEAR_SLICES
from .volume import STANDARD_ERROR, Factor, IlluminationVolume, RadianceTerm

# Beyond it the bands above l = 2 outweigh those that are stored, and no series tells by how much.
SHARPEST = 0.95
# Shares of the progress that unscattered light takes: before the photons and, its moments, after.
UNSCATTERED_SHARE = 0.1
# The bands that are left out weigh |g|^3 and less: of a smaller g, nothing that float32 can hold.
LEAST_G = 1e-3


def operator(values: Values) -> Operator:
    """The row of this model."""
    return Operator(
        "phase",
        "none",
        "lights",
        order=math.inf,
        rescatter="phase",
        gathers_emission=True,
        image_emission=True,
    )


def solve(scene: Scene, values: Values, control: Control) -> dict[str, Grid]:
    """The channels that `radiance` reads, and `standard_error`."""
    with control.stage(0, UNSCATTERED_SHARE, "unscattered light"):
        state = PhotonState(scene, values, control)
    with control.stage(UNSCATTERED_SHARE, 1 - UNSCATTERED_SHARE, "photons"):
        state.refine(
            int(values["passes"]), control, float(values["error"]), float(values["seconds"])
        )
    with control.stage(1 - UNSCATTERED_SHARE, 1, "unscattered light"):
        return state.channels(control, release=True)


def radiance(lights: tuple[Light, ...], medium: Medium, values: Values) -> tuple[RadianceTerm, ...]:
    """L_i = sum over lights of strength times what one unit of the light does, and what the medium
    emits. Channels are scalar, or RGB where the medium or the light's image is coloured.

    g = 0: `light_<i>` is in-scattered radiance itself.
    Otherwise: `direct_<i>`, unscattered light of one direction, times 4 pi times the phase
    function; and the moments M_lm / sqrt(4 pi) of all other light, times g^l: RGB `moment_<m>_<i>`,
    or three scalars to a grid in `moments_0_<i>` to `moments_2_<i>`.
    """
    terms: list[RadianceTerm] = []
    sources: list[Light | None] = [*lights, *([None] if medium.emission is not None else [])]
    for index, light in enumerate(sources):
        suffix = "_emitted" if light is None else f"_{index}"
        strength = np.ones(3) if light is None else photon_lights.strength(light, medium.sigma_t)
        if medium.g == 0:
            terms.append(RadianceTerm((Factor("light" + suffix),), _rgb(strength)))
            continue
        if light is not None and photon_lights.has_direction(light):
            phase = photon_lights.phase_of(light, medium.g, medium.sigma_t.centre)
            terms.append(RadianceTerm((Factor("direct" + suffix),), _rgb(strength), phase))
        emission = medium.emission if light is None else None
        coloured = (
            3 in (medium.sigma_t.channels, medium.sigma_s.channels)
            or (emission is not None and emission.channels == 3)
            or (light is not None and photon_lights.is_coloured(light))
        )
        for moment in range(MOMENTS):
            weight = strength * (math.sqrt(4 * math.pi) * medium.g ** math.isqrt(moment))
            factor = (
                Factor(f"moment_{moment}{suffix}")
                if coloured
                else Factor(f"moments_{moment // PACK}{suffix}", moment % PACK)
            )
            terms.append(RadianceTerm((factor,), _rgb(weight), Moment(moment)))
    return tuple(terms)


def _rgb(weight: NDArray[np.float64]) -> tuple[float, float, float]:
    return float(weight[0]), float(weight[1]), float(weight[2])


def remarks(volume: IlluminationVolume) -> tuple[str, ...]:
    """What the bands above l = 2 would add, estimated: they are not stored.

    Averaged over directions of view, band l has the mean square g^(2 l) E_l with E_l the sum over
    m of M_lm^2 / (4 pi), less what noise adds. E_l is continued from bands 1 and 2 as a geometric
    series, as for light that scattering makes ever more even.
    """
    moments = any(isinstance(term.angular, Moment) for term in volume.radiance)
    if not moments or abs(volume.medium.g) < LEAST_G:
        return ()
    g, sigma_t, errors = volume.medium.g, volume.medium.sigma_t, volume.channels[STANDARD_ERROR]
    count, power, noise, found = 0, 0.0, 0.0, np.zeros(MOMENT_ORDER + 1)
    for slab in sigma_t.slabs():
        matter = occupied(sigma_t.values[slab])
        count += int(matter.sum())
        power += _squared(volume.mean_over_views_in(slab)[matter])
        noise += _squared(errors.values[slab][matter]) * 3 / errors.channels
        for index in range(MOMENTS):
            part: NDArray[np.float32] | float = 0.0
            for term in volume.radiance:
                if term.angular == Moment(index):
                    component = volume.component(term.factors[0])[slab][matter]
                    part = part + component * np.asarray(term.weight)
            band = math.isqrt(index)
            found[band] += _squared(part) / (4 * math.pi * g ** (2 * band))
    # Means over voxels and colours.
    values = 3 * max(count, 1)
    power, noise, found = power / values, noise / values, found / values
    energy = [max(found[band] - (2 * band + 1) * noise, 0.0) for band in range(MOMENT_ORDER + 1)]
    if not energy[1] or not power:
        return ()
    ratio = min(energy[2] / energy[1], 1.0)
    rest = energy[2] * g**6 * ratio / (1 - g * g * ratio)
    share = f"{float(f'{100 * math.sqrt(rest / power):.2g}'):g}"
    return (
        f"the light that is scattered more than once keeps the bands 0 to {MOMENT_ORDER} of its "
        f"directions; the others are estimated at {share} % of the "
        "radiance",
    )


def _squared(values: NDArray[np.floating] | float) -> float:
    """The sum of squares."""
    return float(np.square(values, dtype=np.float64).sum())


# Photons of a deep medium take much longer than those of a thin one: a first look ends by time, in
# passes small enough that the last one does not matter.
QUICK: Values = {"photons": 20_000, "passes": 64, "seconds": 0.1, "directions": 32, "near": 0}

MODEL = Model(
    id="photon_mapping",
    label="Photon mapping",
    citation="Knaus, Zwicker: Progressive Photon Mapping: A Probabilistic Approach, ACM "
    "Transactions on Graphics 30(3), 2011",
    equation="14 to 16",
    summary="All scattering, every light and the medium's glow; slow, with noise that is known.",
    parameters=(
        Parameter("photons", 50_000, "Photons of each light in a pass", 1, 100_000_000),
        Parameter(
            "passes",
            16,
            "Passes at most: noise falls with the root of their number, time grows with it",
            LEAST_PASSES,
            1_000_000,
        ),
        Parameter("error", 0.0, "Stop at this relative error (RMS, in matter); 0: never", 0.0, 1.0),
        Parameter("seconds", math.inf, "Stop after this time", 1e-3, math.inf, "seconds"),
        Parameter("noise_seed", 0, "Another seed gives other noise", 0, 2**31 - 1),
        Parameter(
            "directions",
            256,
            "Directions of unscattered light from all around: more for hard surfaces",
            8,
            4096,
        ),
        NEAR_SLICES,
        Parameter(
            "estimate",
            "track_length",
            "Count path lengths in voxels, or photons in balls that shrink (the paper's)",
            choices=("track_length", "kernel"),
        ),
        Parameter(
            "radius", 2.0, "The kernel's first radius: more blur, less noise", 0.5, 32.0, "voxels"
        ),
        Parameter(
            "alpha",
            OPTIMAL_ALPHA,
            "How the kernel shrinks: small, fast, with more noise; 1: not at all",
            0.05,
            1.0,
        ),
    ),
    needs=(
        Need("multiple scattering", "represents", "all orders"),
        Need("every kind of light", "represents", "with its size"),
        Need("emission", "represents", "also as light on the medium"),
        Need("chromatic extinction", "represents", "all channels along one path"),
        Need(
            "phase function",
            "represents",
            f"exactly for unscattered light of one direction; g from {-SHARPEST} to {SHARPEST}",
        ),
        Need("phase function of area lights", "approximates", "with its mean over their surface"),
        Need("phase function of other light", "approximates", "its bands 0 to 2"),
    ),
    lights=frozenset({"distant", "point", "spot", "area", "environment"}),
    rebake_on=frozenset({"extinction", "scattering", "emission", "light shape", "phase function"}),
    operator=operator,
    solve=solve,
    radiance=radiance,
    remarks=remarks,
    ladder=({"passes": 4}, {"passes": 16}, {"passes": 64}),
    quick=QUICK,
    largest_g=SHARPEST,
    averages=True,
)
