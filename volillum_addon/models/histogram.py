"""Ambient occlusion for any transfer function: what of each data value is near every voxel.

Dynamic ambient occlusion keeps a histogram of the neighbourhood of every voxel, taken from the data
before a transfer function (Ropinski et al. 2008). Its bins here are the hat functions h_j of data
values c_j (piecewise linear, 1 at c_j, 0 at the others, constant beyond the ends):

    H_j(x) = mean of h_j(f(x + y)) over |y| < R, weighted |y|^-p

A function of the data that is linear between the c_j is the sum of g(c_j) h_j, so its mean over the
neighbourhood is the dot product of g(c_j) and H_j: with a new transfer function nothing is summed
over neighbours again. Its sigma_s is the product of two such functions, density and albedo:

    d a = sum over j of d_j a_j h_j  -  sum over j of (d_j+1 - d_j) (a_j+1 - a_j) h_j h_j+1

`products` are the means of h_j h_j+1. All means are exact but for rounding (models.engines); no
codebook compresses the histograms: they are n float32 volumes, 2 n - 1 with products.

Only whole balls: the open half of a neighbourhood follows the gradient of the extinction, which a
new transfer function turns, so that variant has no histogram.

The linear law is then the full bake's, where the transfer function's points are among the c_j. With
opacities, which are not linear in the density, those of the c_j are interpolated: too low by at
most delta^2 / 8 where neighbouring c_j differ by the depth delta in a voxel.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.control import Control
from ..core.errors import bad, number
from ..core.grid import Grid
from ..core.lights import Light
from ..core.medium import Medium
from ..core.native import native
from ..core.scene import Scene
from ..core.transfer_function import TransferFunction
from .ambient_occlusion import MODEL
from .illuminate import VOID_MARGIN
from .volume import IlluminationVolume

# A transfer function is linear between the bins where it leaves them by less than this share of its
# largest density, or of an albedo of 1 (rounding of the interpolation).
LINEAR_SLACK = 1e-9


@dataclass(frozen=True, eq=False)
class Histogram:
    """Means of the bins over the neighbourhood of every voxel: `bins` [n, i, j, k], `products`
    [n - 1, i, j, k] or None. The lattice is that of `data`, grown by VOID_MARGIN voxels."""

    data: Grid
    centres: NDArray[np.float64]
    radius: float
    weight_p: int
    bins: NDArray[np.float32]
    products: NDArray[np.float32] | None

    def occlusion(self, values: ArrayLike) -> Grid:
        """The mean over the neighbourhood of what has `values` [n] or [n, 3] at the bins' centres
        and is linear between: of sigma_t (times R: T_p), of opacities, or of a colour."""
        given = np.asarray(values, np.float64)
        if given.shape not in ((len(self.centres),), (len(self.centres), 3)):
            raise bad("values' shape", given.shape, f"({len(self.centres)},) or with 3 colours")
        return self._lattice.with_planes(_dot(given.reshape(len(given), -1), self.bins), "mean")

    def illumination(
        self,
        transfer: TransferFunction,
        lights: tuple[Light, ...],
        *,
        opacity: str = "bounded",
        reference_length: float = 0.0,
        bleeding: float = 0.0,
    ) -> IlluminationVolume:
        """What a bake of ambient occlusion in `transfer.medium(data)` gives, on the lattice of the
        data and without convolutions.

        Raises InputError where an albedo that varies shall bleed and there are no `products`.
        """
        whole = transfer.medium(self.data)
        medium = Medium(self._grown(whole.sigma_t), self._grown(whole.sigma_s))
        scene = Scene(medium, lights)
        MODEL.check(scene)
        values = MODEL.values(
            {
                "radius": self.radius,
                "weight_p": self.weight_p,
                "opacity": opacity,
                "reference_length": reference_length,
                "bleeding": bleeding,
            }
        )
        row = MODEL.operator_in(scene, values)
        bounded = row.law == "bounded"
        centres = self.centres.astype(np.float32)
        depth = transfer.densities(centres) * np.float64(transfer.per_length(self.data))
        # Of each bin: its share of the occlusion of a neighbourhood that holds nothing else.
        occlusion = -np.expm1(-depth * row.reference_length) if bounded else depth * row.radius
        upper = 1.0 if bounded else np.inf
        light = MODEL.represented(scene)
        radiance = MODEL.radiance(light, medium, values)
        summed = np.minimum(_dot(occlusion[:, None], self.bins), np.float32(upper))
        channels = {"openness": medium.sigma_t.with_planes(1 - summed, "openness")}
        if any(factor.channel == "bleeding" for term in radiance for factor in term.factors):
            glow = self._glow(occlusion, transfer.albedos(centres).astype(np.float64))
            channels["bleeding"] = medium.sigma_t.with_planes(np.minimum(glow, upper), "bleeding")
        return IlluminationVolume(
            MODEL.id, values, medium, channels, radiance, notes=self._notes(transfer)
        )

    def _glow(
        self, occlusion: NDArray[np.float64], albedo: NDArray[np.float64]
    ) -> NDArray[np.float32]:
        """Means of occlusion times albedo, [1 or 3, i, j, k]."""
        colours = albedo[:, :1] if np.ptp(albedo, axis=1).max() == 0 else albedo
        glow = _dot(occlusion[:, None] * colours, self.bins)
        both = np.diff(occlusion)[:, None] * np.diff(colours, axis=0)
        if not both.any():
            return glow
        if self.products is None:
            raise bad(
                "the histogram's products", None, "baked: the transfer function's albedo varies"
            )
        return np.asarray(np.maximum(glow - _dot(both, self.products), np.float32(0)))

    def _notes(self, transfer: TransferFunction) -> tuple[str, ...]:
        """What the bins cannot represent of a transfer function, in plain words."""
        low, high = float(self.data.values.min()), float(self.data.values.max())
        points = np.asarray(transfer.values, np.float64)
        # Both are linear between these and the bins' centres, where they agree.
        points = np.concatenate([points[(points > low) & (points < high)], [low, high]])

        def gap(curve: ArrayLike) -> NDArray[np.float64]:
            table = np.asarray(curve, np.float64)
            known = np.interp(self.centres, np.asarray(transfer.values), table)
            found = np.interp(points, self.centres, known)
            return np.abs(found - np.interp(points, np.asarray(transfer.values), table))

        density = np.asarray(transfer.density, np.float64)
        wrong = gap(density) > LINEAR_SLACK * max(density.max(), 1e-30)
        for colour in np.asarray(transfer.albedo, np.float64).T:
            wrong |= gap(colour) > LINEAR_SLACK
        if not wrong.any():
            return ()
        named = ", ".join(f"{value:g}" for value in np.unique(points[wrong]))
        return (f"Occlusion is linear between the histogram's bins, not at: {named}",)

    @property
    def _lattice(self) -> Grid:
        return self._grown(self.data)

    @staticmethod
    def _grown(grid: Grid) -> Grid:
        a, b, c = grid.shape
        low, margin = (-VOID_MARGIN,) * 3, VOID_MARGIN
        return grid.crop(low, (a + margin, b + margin, c + margin))


def bake_histogram(
    data: Grid,
    centres: ArrayLike,
    radius: float,
    weight_p: int = 1,
    control: Control | None = None,
    products: bool = False,
) -> Histogram:
    """The histogram of a scalar grid for bins at `centres` [n], ascending data values.

    `radius` in world units. `products` only where an albedo that varies shall bleed: n - 1 volumes
    more. Raises InputError for bad input.
    """
    if data.channels != 1:
        raise bad(f"{data.name}'s channels", data.channels, "1 for a histogram")
    where = np.asarray(centres, np.float64)
    if where.ndim != 1 or len(where) < 1 or not np.all(np.isfinite(where)):
        raise bad("the bins' centres", where.tolist(), "a list of finite numbers")
    if np.any(np.diff(where) <= 0):
        raise bad("the bins' centres", where.tolist(), "strictly ascending ones")
    number("radius", radius, np.finfo(np.float64).tiny, 1e9, "world units")
    control = control or Control()
    shape = Histogram._grown(data).shape
    count = 2 * len(where) - 1 if products else len(where)
    means = np.zeros((count, *shape), np.float32)
    for index, basis in enumerate(_basis(data, where, products)):
        # Beyond the data there is nothing, of no value; an empty bin stays 0.
        if not basis.values.any():
            continue
        with control.stage(index / count, (index + 1) / count, "summing the data's values"):
            means[index] = native.convolve(
                Histogram._grown(basis).planes(),
                data.index_to_world,
                radius=radius,
                weight_p=weight_p,
                upper=1.0,
                # Rare values beside common ones, which an opaque transfer function weighs up.
                precision="double",
                control=control.native,
            )[0]
    n = len(where)
    return Histogram(data, where, radius, weight_p, means[:n], means[n:] if products else None)


def _basis(data: Grid, centres: NDArray[np.float64], products: bool) -> Iterator[Grid]:
    """The hats of the data values, then the products of neighbouring ones."""
    one = np.eye(len(centres))
    hats = (np.interp(data.values, centres, each).astype(np.float32) for each in one)
    yield from (data.with_values(hat) for hat in hats)
    if products:
        # Between two centres both hats are the one's weight and its complement.
        for below, above in pairwise(centres):
            share = np.clip((data.values - below) / (above - below), 0, 1)
            yield data.with_values((share * (1 - share)).astype(np.float32))


def _dot(weights: NDArray[np.float64], means: NDArray[np.float32]) -> NDArray[np.float32]:
    """Sums over the bins, [c, i, j, k], of weights [n, c]."""
    flat = weights.T.astype(np.float32) @ means.reshape(len(means), -1)
    return np.asarray(flat.reshape(-1, *means.shape[1:]), np.float32)
