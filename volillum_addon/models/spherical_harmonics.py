"""Spherical harmonic lighting (Kronander et al. 2012), the paper's Eqs. 9 to 12.

    V_lm(x) = integral of T_R(x, omega) Y_lm(omega) d omega
    L_i(x)  = 1 / (4 pi) sum over l <= n, m of L_lm V_lm(x)

T_R is the transmittance over the radius R (infinite: global), L_lm the coefficients of the light's
radiance. Both are expanded in outward directions, so the sign (-1)^l that the printed Eq. 12 lacks
does not arise. Equivalently, the model sees the lights' radiance truncated to the bands 0 to n.

Neglects angular detail above band n (it rings: a window damps that, L_i is clamped at 0), lights
inside or near the medium, all scattering but the last, and the phase function.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..core import harmonics
from ..core.control import Control
from ..core.directions import sphere_rule
from ..core.grid import Grid
from ..core.lights import Light
from ..core.medium import Medium
from ..core.scene import Scene
from .engines import sweep
from .model import Model, Need, Parameter, Values
from .operator import Operator, highest_band, truncated_radiance
from .published import ALGORITHM, LOCAL_RADIUS, composed_harmonics, is_published
from .settings import NEAR_SLICES
from .volume import Factor, IlluminationVolume, RadianceTerm

# Coefficients in one vector grid: EEVEE reads at most 15 grids of a material.
PACK = 3


def operator(values: Values) -> Operator:
    """The row of this model."""
    return Operator(
        "sphere",
        "none",
        "environment",
        radius=float(values["radius"]),
        image_emission=True,
        basis=(int(values["order"]), str(values["window"])),
        clamped=True,
    )


def solve(scene: Scene, values: Values, control: Control) -> dict[str, Grid]:
    """V_lm. Grey extinction: `coefficients_0`, ... with three coefficients each (the last one with
    what remains). Chromatic: one RGB channel `coefficient_0`, ... each."""
    vectors, weights = sphere_rule(int(values["directions"]))
    count = _stored(scene.lights, values)
    basis = harmonics.evaluate(vectors)[:, :count] * (4 * math.pi * weights)[:, None]
    sigma_t = scene.medium.sigma_t
    near, radius = int(values["near"]), float(values["radius"])
    if is_published(values):
        planes = composed(sigma_t, vectors, basis, values, control)
    else:
        planes = sweep(sigma_t, vectors, basis, near, control, radius, scene.wanted)
    channels = {}
    if sigma_t.channels == 3:
        for index in range(count):
            name = f"coefficient_{index}"
            channels[name] = sigma_t.with_planes(planes[:, index], name)
        return channels
    for first in range(0, count, PACK):
        name = f"coefficients_{first // PACK}"
        channels[name] = sigma_t.with_planes(planes[0, first : first + PACK], name)
    return channels


def _stored(lights: tuple[Light, ...], values: Values) -> int:
    """How many coefficients a bake under these lights holds."""
    order = int(values["order"])
    if values["bands"] == "lit":
        order = min(order, max((highest_band(light) for light in lights), default=0))
    return harmonics.count(order)


def composed(
    sigma_t: Grid,
    vectors: NDArray[np.float64],
    basis: NDArray[np.float64],
    values: Values,
    control: Control,
) -> NDArray[np.float32]:
    """V_lm [c, m, i, j, k] as published: local visibility, projected and composed."""
    step = float(values["local_radius"]) * float(sigma_t.voxel_size.mean())
    extent = float(np.linalg.norm(np.ptp(sigma_t.corners(), axis=0)))
    reach = min(float(values["radius"]), extent)
    step = min(step, reach)
    with control.stage(0.0, 0.3, "local visibility"):
        local = sweep(sigma_t, vectors, basis, int(values["near"]), control, step)
    result = []
    for index, planes in enumerate(local):
        begin, end = (0.3 + 0.7 * (index + part) / len(local) for part in (0, 1))
        with control.stage(begin, end, "composing"):
            order = math.isqrt(len(planes)) - 1
            result.append(composed_harmonics(planes, sigma_t, order, step, reach, control))
    return np.stack(result)


def radiance(lights: tuple[Light, ...], medium: Medium, values: Values) -> tuple[RadianceTerm, ...]:
    """L_i = 1 / (4 pi) sum of L_lm V_lm: relighting is these weights alone."""
    coefficients = truncated_radiance(operator(values), lights) / (4 * math.pi)
    terms = []
    for index in range(_stored(lights, values)):
        red, green, blue = coefficients[index]
        if red == green == blue == 0:
            continue
        factor = (
            Factor(f"coefficient_{index}")
            if medium.channels == 3
            else Factor(f"coefficients_{index // PACK}", index % PACK)
        )
        terms.append(RadianceTerm((factor,), (red, green, blue)))
    return tuple(terms)


def coefficients(volume: IlluminationVolume) -> NDArray[np.float32]:
    """V_lm of a bake, [(order + 1)^2, i, j, k, 1 or 3]; fewer where only lit bands are stored."""
    stored = len(volume.channels)
    if volume.medium.sigma_t.channels == 3:
        return np.stack([volume.channels[f"coefficient_{n}"].values for n in range(stored)])
    packs = [volume.channels[f"coefficients_{n}"].planes() for n in range(stored)]
    return np.concatenate(packs)[..., None]


MODEL = Model(
    id="spherical_harmonics",
    label="Spherical harmonic lighting",
    citation="Kronander, Jönsson, Löw, Ljung, Ynnerman, Unger: Efficient Visibility Encoding for "
    "Dynamic Illumination in Direct Volume Rendering, TVCG 18(3), 2012",
    equation="9 to 12",
    summary="Light from all around, stored so that new lights need no new bake; soft only.",
    parameters=(
        Parameter("order", 3, "Highest band: 0 ambient, 3 sixteen coefficients", 0, 3),
        Parameter(
            "bands",
            "all",
            "What is stored: all bands, which serve any later light, or those up to the highest in "
            "which today's lights have energy (of a sky of one radiance band 0 alone)",
            choices=("all", "lit"),
        ),
        Parameter(
            "directions",
            256,
            "Directions on the sphere: more for hard surfaces, time grows in proportion",
            8,
            4096,
        ),
        Parameter("radius", math.inf, "How far occluders count", 1e-9, math.inf, "world units"),
        Parameter(
            "window",
            "hanning",
            "Damping of the higher bands: less ringing, softer shadows",
            choices=harmonics.WINDOWS,
        ),
        NEAR_SLICES,
        ALGORITHM,
        LOCAL_RADIUS,
    ),
    needs=(
        Need("environment light", "approximates", "cut to the bands 0 to order"),
        Need("distant light", "approximates", "cut to the bands 0 to order: soft shadows only"),
        Need("local lights", "ignores", "visibility is to infinity"),
        Need("multiple scattering", "ignores", "only the last scattering toward the eye"),
        Need("phase function", "ignores", "isotropic"),
        Need("emission", "represents", "in the image"),
        Need("chromatic extinction", "represents", "one set of coefficients per channel"),
    ),
    lights=frozenset({"distant", "environment"}),
    rebake_on=frozenset({"extinction"}),
    rebake_when=lambda values: frozenset({"highest lit band"} if values["bands"] == "lit" else ()),
    operator=operator,
    solve=solve,
    radiance=radiance,
    ladder=(
        {"directions": 32, "near": 0},
        {"directions": 64, "near": 2},
        {"directions": 128, "near": 4},
        {"directions": 512, "near": 6},
        {"directions": 2048, "near": 12},
    ),
)
