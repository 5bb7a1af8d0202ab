"""Dynamic ambient occlusion (Ropinski et al. 2008), the paper's Eq. 13, normalised.

    T_p(x) = (3 - p) / (4 pi R^(2 - p)) integral over |y| < R of sigma_t(x + y) |y|^-p dV
    linear:   L_i(x) = L_b [1 - T_p + k S_p],    S_p: T_p of sigma_s instead of sigma_t
    bounded:  L_i(x) = L_b [1 - O + k E]
              O = mean of alpha, E = mean of alpha sigma_s / sigma_t over |y| < R, weighted |y|^-p
              alpha = 1 - exp(-sigma_t d) of the voxels, d a voxel's mean side

p = 1 is the printed equation: along a ray of length R the medium at distance s counts as s, so the
integral over rays is one of sigma_t / |y| over a ball. It is divided by 2 pi R, so that T_p of a
homogeneous medium is its optical depth sigma_t R; p = 2 is then the mean optical depth, the
physical first order of occlusion. It is printed as a light but grows with occlusion: it is taken
from 1. An opaque surface has T_p far above 1, so what is displayed are opacities, as originally
published. k is the gain of the colour that bleeds from the neighbours.

As originally published the ball may be split by the gradient: with `neighbourhood` = hemisphere all
integrals are over y . grad sigma_t(x) < 0 alone, and twice as much.

Neglects that occluders hide each other, where light comes from, all that is beyond R, all
scattering but the last, the phase function, and emission.
"""

from __future__ import annotations

import math
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ..core.control import Control
from ..core.grid import Grid, Region, triple
from ..core.lights import Light
from ..core.medium import Medium
from ..core.native import native
from ..core.scene import Scene
from .model import Model, Need, Parameter, Value, Values
from .operator import Operator, brightness
from .volume import Factor, RadianceTerm

# The published radii are 4 to 24 voxels.
DEFAULT_RADIUS_VOXELS = 12


def operator(values: Values) -> Operator:
    """The row of this model; lengths of 0 stand for what follows the grid (`resolve`)."""
    linear = values["opacity"] == "linear"
    half = _is_half(values)
    return Operator(
        "hemisphere" if half else "sphere",
        "gradient" if half else "none",
        "constant",
        radius=float(values["radius"]),
        law="linear" if linear else "bounded",
        weight_p=float(values["weight_p"]),
        reference_length=float(values["reference_length"]),
        gathers_colour=float(values["bleeding"]),
        clamped=linear,
    )


def resolve(scene: Scene, values: Values) -> dict[str, Value]:
    """The lengths that follow the grid: the default radius, and what opacities refer to."""
    voxel = float(abs(np.linalg.det(scene.medium.sigma_t.index_to_world[:3, :3])) ** (1 / 3))
    lengths = {"radius": DEFAULT_RADIUS_VOXELS * voxel, "reference_length": voxel}
    return {**values, **{name: values[name] or length for name, length in lengths.items()}}


def solve(scene: Scene, values: Values, control: Control) -> dict[str, Grid]:
    """1 - T_p or 1 - O as `openness` (RGB if extinction is); S_p or E as `bleeding`."""
    row, medium = operator(values), scene.medium
    lattice, wanted = medium.sigma_t, scene.wanted
    length = row.reference_length if row.law == "bounded" else 0.0
    bleeds = _bleeds(medium, values)
    albedo = medium.constant_albedo if bleeds else None
    wide = bleeds and albedo is None
    with control.stage(0.0, 0.5 if wide else 1.0, "summing occlusion"):
        planes = _sums(row, lattice, lattice.planes(), wanted, control, length, True)
        channels = {"openness": lattice.with_planes(planes, "openness")}
    if albedo is not None:
        # One albedo: its mean over neighbours needs no convolution of its own.
        colour = albedo[:1] if np.ptp(albedo) == 0 and len(planes) == 1 else albedo
        bleeding = (1 - planes) * colour.astype(np.float32)[:, None, None, None]
        channels["bleeding"] = lattice.with_planes(bleeding, "bleeding")
    elif bleeds:
        with control.stage(0.5, 1.0, "summing colour"):
            planes = _sums(row, lattice, colours(medium, length), wanted, control)
            channels["bleeding"] = lattice.with_planes(planes, "bleeding")
    return channels


def _sums(
    row: Operator,
    lattice: Grid,
    planes: NDArray[np.float32],
    wanted: Region | None,
    control: Control,
    opacity_length: float = 0.0,
    complement: bool = False,
) -> NDArray[np.float32]:
    """The neighbourhoods' sums of the planes; 0 at voxels that are not wanted."""
    around = _within_reach(lattice, wanted, row.radius)
    bounded = row.law == "bounded"
    if row.lobe == "hemisphere":  # half balls are summed without cancellation
        sum_up = partial(native.hemisphere_sums, guide=_part(lattice.planes(), around))
    else:
        # Unbounded sums beside an opaque voxel of 1e6 would drown in the rounding of single
        # precision.
        sum_up = partial(native.convolve, precision="single" if bounded else "double")
    sums: NDArray[np.float32] = sum_up(
        _part(planes, around),
        index_to_world=lattice.index_to_world,
        radius=row.radius,
        weight_p=int(row.weight_p),
        total=1.0 if bounded else row.radius,
        upper=1.0 if bounded else math.inf,
        opacity_length=opacity_length,
        complement=complement,
        control=control.native,
    )
    if wanted is None:
        return sums
    result = np.zeros_like(planes)
    begin = np.array(around[0])
    inside = triple(np.array(wanted[0]) - begin), triple(np.array(wanted[1]) - begin)
    result[:, *map(slice, *wanted)] = _part(sums, inside)
    return result


def _within_reach(lattice: Grid, wanted: Region | None, radius: float) -> Region:
    """The box of voxels that count for those that are wanted."""
    if wanted is None:
        return (0, 0, 0), lattice.shape
    per_world = np.linalg.norm(np.linalg.inv(lattice.index_to_world[:3, :3]), axis=1)
    # Half balls open along the gradient, which reaches one voxel further.
    reach = np.ceil(radius * per_world).astype(int) + 1
    low, high = np.array(wanted[0]) - reach, np.array(wanted[1]) + reach
    return triple(np.maximum(low, 0)), triple(np.minimum(high, lattice.shape))


def _part(planes: NDArray[np.float32], region: Region) -> NDArray[np.float32]:
    return np.ascontiguousarray(planes[:, *map(slice, *region)])


def colours(medium: Medium, opacity_length: float) -> NDArray[np.float32]:
    """sigma_s, or with opacities alpha sigma_s / sigma_t, [1 or 3, i, j, k]."""
    sigma_s = medium.sigma_s.planes()
    if opacity_length == 0:
        return sigma_s
    sigma_t = medium.sigma_t.planes()
    # alpha / sigma_t, whose limit without matter is the length itself (times sigma_s = 0).
    ratio = np.full_like(sigma_t, opacity_length)
    length = np.float32(opacity_length)
    np.divide(-np.expm1(-sigma_t * length), sigma_t, out=ratio, where=sigma_t > 0)
    return np.ascontiguousarray(ratio * sigma_s)


def _is_half(values: Values) -> bool:
    return values["neighbourhood"] == "hemisphere"


def _bleeds(medium: Medium, values: Values) -> bool:
    return float(values["bleeding"]) > 0 and bool(medium.sigma_s.values.any())


def radiance(lights: tuple[Light, ...], medium: Medium, values: Values) -> tuple[RadianceTerm, ...]:
    """L_i = L_b (openness + k bleeding)."""
    red, green, blue = brightness(lights, medium.sigma_t.centre)
    terms = [RadianceTerm((Factor("openness"),), (red, green, blue))]
    if _bleeds(medium, values):
        gain = float(values["bleeding"])
        terms.append(RadianceTerm((Factor("bleeding"),), (gain * red, gain * green, gain * blue)))
    return tuple(terms)


MODEL = Model(
    id="ambient_occlusion",
    label="Ambient occlusion",
    citation="Ropinski, Meyer-Spradow, Diepenbrock, Mensmann, Hinrichs: Interactive Volume "
    "Rendering with Dynamic Ambient Occlusion and Color Bleeding, Computer Graphics Forum 27(2), "
    "2008",
    equation="13",
    summary="Crevices darken by how much matter is near, from no direction in particular; fast.",
    parameters=(
        Parameter(
            "radius",
            0.0,
            "How far neighbours count: wider darkens broader hollows; 0: 12 voxels",
            0.0,
            1e9,
            "world units",
        ),
        Parameter(
            "weight_p",
            1,
            "Neighbours at distance r count as 1/r^p: 1 as published, 2 as light would see them, "
            "0 all alike",
            0,
            2,
        ),
        Parameter(
            "opacity",
            "bounded",
            "bounded: the mean opacity of the neighbours, for any medium; linear: the published "
            "equation, for thin media",
            choices=("bounded", "linear"),
        ),
        Parameter(
            "reference_length",
            0.0,
            "Depth of matter whose opacity counts when bounded: more is darker; 0: one voxel",
            0.0,
            1e9,
            "world units",
        ),
        Parameter(
            "neighbourhood",
            "sphere",
            "sphere: all around; hemisphere: only the open side of a surface (where the medium "
            "thins out), crisper; time grows with the cube of the radius",
            choices=("sphere", "hemisphere"),
        ),
        Parameter("bleeding", 0.0, "Gain of the colour that glows from the neighbours", 0.0, 1.0),
    ),
    needs=(
        Need("light direction", "ignores", "every light counts as a glow from all around"),
        Need("light brightness", "approximates", "one constant: the sum of F / (4 pi)"),
        Need("far shadows", "ignores", "only matter within the radius occludes"),
        Need("multiple scattering", "ignores", "bleeding is a gain, not transport"),
        Need("phase function", "ignores", "isotropic"),
        Need("emission", "ignores", "not in the model's equation"),
        Need("chromatic extinction", "represents", "one openness per channel"),
    ),
    lights=frozenset({"distant", "point", "spot", "area", "environment"}),
    rebake_on=frozenset({"extinction", "scattering"}),
    operator=operator,
    solve=solve,
    radiance=radiance,
    resolve=resolve,
)
