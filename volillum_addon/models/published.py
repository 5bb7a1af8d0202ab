"""The slice algorithms as they were published, as variants of their models.

They do not solve their models' equations (docs/mathematics.md): the blur from slice to slice draws
a new direction at every slice, so penumbras narrow as the slices get denser; lookups from slice to
slice diffuse; buffers of few bits forget. A model offers them by the parameter `algorithm`.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..core import harmonics
from ..core.control import Control
from ..core.directions import sphere_rule
from ..core.grid import Grid
from ..core.medium import Medium
from ..core.native import native
from .model import Parameter, Values

EQUATION, PUBLISHED = "equation", "published"
ALGORITHM = Parameter(
    "algorithm",
    EQUATION,
    "Solve the model's equation, or run the slice algorithm as it was published",
    choices=(EQUATION, PUBLISHED),
)
SLICE_DISTANCE = Parameter(
    "slice_distance",
    1.0,
    "Published algorithm: distance of the slices. Penumbras narrow with its square root",
    0.05,
    64.0,
    "voxels",
)
TAPS = Parameter("taps", 4, "Published algorithm: lookups along each edge of a slice's blur", 1, 8)
BUFFER = Parameter(
    "buffer",
    "float",
    "Published algorithm: what is stored between slices; 8 bits never see thin media",
    choices=("float", "half", "byte"),
)
NEIGHBOURS = Parameter(
    "neighbours",
    "0",
    "Published algorithm: neighbours that a lookup in the slice before is averaged with",
    choices=("0", "4", "8"),
)
LOCAL_RADIUS = Parameter(
    "local_radius",
    8.0,
    "Published algorithm: radius of the local visibility that is composed into the global one",
    1.0,
    256.0,
    "voxels",
)
# Directions in which local visibilities are composed: those of a rule that is exact for products of
# harmonics up to band 3, (n + 1) (2 n + 1).
COMPOSED_DIRECTIONS = 28
PROPAGATION = (ALGORITHM, NEIGHBOURS, BUFFER)
SLICES = (ALGORITHM, SLICE_DISTANCE, TAPS, BUFFER)


def is_published(values: Values) -> bool:
    """Whether the published algorithm is asked for."""
    return values["algorithm"] == PUBLISHED


def blurred_slices(
    medium: Medium,
    toward: NDArray[np.float64],
    values: Values,
    control: Control,
    eye: NDArray[np.float64] | None = None,
    scattered_on: bool = False,
) -> NDArray[np.float32]:
    """Visibility (with `scattered_on`: light that also scattered into the cone) [c, i, j, k].

    Slices across `toward`, a unit vector to the light or, with `eye`, to the eye. c is 1 or 3.
    """
    sigma_t = medium.sigma_t
    voxel = float(sigma_t.voxel_size.mean())
    planes, scattering = sigma_t.planes(), None
    if scattered_on:
        planes, scattering = alike(sigma_t, medium.sigma_s)
    return np.asarray(
        native.blurred_slices(
            planes,
            sigma_t.index_to_world,
            np.asarray(toward, np.float64),
            sigma_s=scattering,
            eye=None if eye is None else np.asarray(eye, np.float64),
            distance=float(values["slice_distance"]) * voxel,
            pixel=float(sigma_t.voxel_size.min()),
            theta=float(values["theta"]),
            taps=int(values["taps"]),
            buffer=str(values["buffer"]),
            control=control.native,
        )
    )


def propagated(
    medium: Medium, toward: NDArray[np.float64], values: Values, control: Control
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Colour gathered on the way to the light and what is left of the light, [c, i, j, k] each.

    `toward` is a unit vector; c is 1 or 3. From slice to slice of the grid (Ropinski et al. 2010).
    """
    sigma_t, sigma_s = alike(medium.sigma_t, medium.sigma_s)
    planes = native.propagated_shadow(
        sigma_t,
        sigma_s,
        medium.sigma_t.index_to_world,
        np.asarray(toward, np.float64),
        neighbours=int(values["neighbours"]),
        buffer=str(values["buffer"]),
        control=control.native,
    )
    return planes[: len(sigma_t)], 1 - planes[len(sigma_t) :]


def composed_harmonics(
    local: NDArray[np.float32],
    sigma_t: Grid,
    basis_order: int,
    step: float,
    reach: float,
    control: Control,
) -> NDArray[np.float32]:
    """Coefficients [m, i, j, k] of the visibility that local ones compose to.

    `local` [m, i, j, k] are coefficients of the visibility over `step` (world units); along a rule
    of directions their expansions, clamped to 0 and 1, are multiplied every step up to `reach`.
    """
    vectors, weights = sphere_rule(COMPOSED_DIRECTIONS)
    basis = harmonics.evaluate(vectors)[:, : harmonics.count(basis_order)].astype(np.float32)
    inverse = np.linalg.inv(sigma_t.index_to_world[:3, :3])
    steps = max(1, math.ceil(reach / step))
    total = np.zeros_like(local)
    for index, vector in enumerate(vectors):
        stage = control.stage(index / len(vectors), (index + 1) / len(vectors), "composing")
        with stage:
            expanded = np.tensordot(basis[index], local, axes=1).astype(np.float32)
            offset = np.ascontiguousarray(inverse @ vector * step)
            visible = native.composed_visibility(
                expanded, offset, steps=steps, control=control.native
            )[0]
        weighted = basis[index] * np.float32(4 * math.pi * weights[index])
        for coefficient, weight in enumerate(weighted):
            total[coefficient] += weight * visible
    return total


def alike(first: Grid, second: Grid) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """The planes of both with one number of channels."""
    channels = max(first.channels, second.channels)
    one, other = (
        np.ascontiguousarray(np.broadcast_to(grid.planes(), (channels, *grid.shape)))
        for grid in (first, second)
    )
    return one, other
