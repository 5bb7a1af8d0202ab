"""The participating medium: extinction, scattering, emission, phase anisotropy."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from .errors import InputError, bad, bad_voxels, colour, number
from .grid import Grid, active_box

# float32 rounding of sigma_s / sigma_t for an albedo of exactly 1.
ALBEDO_SLACK = 1e-5
# Channels that differ by less than this share of the largest are one channel (float32 rounding).
GREY_SLACK = 1e-6
# A larger anisotropy is a delta function in float32.
LARGEST_G = 0.999


@dataclass(frozen=True, eq=False)
class Medium:
    """Grids of sigma_t and sigma_s (1 or 3 channels, per world unit), emission, anisotropy g.

    `emission` is sigma_a L_e: radiance per world unit, 1 or 3 channels, or None. All grids share
    one lattice. By definition the medium is their trilinear interpolant, zero outside.

    Raises InputError for negative values, albedo above 1, or grids on different lattices.
    """

    sigma_t: Grid
    sigma_s: Grid
    emission: Grid | None = None
    g: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "g", number("g", self.g, -LARGEST_G, LARGEST_G))
        grids = {"sigma_t": self.sigma_t, "sigma_s": self.sigma_s}
        if self.emission is not None:
            grids["emission"] = self.emission
        for name, grid in grids.items():
            if not isinstance(grid, Grid):
                raise TypeError(f"{name} is a {type(grid).__name__}; expected a Grid")
            negative = grid.values < 0
            if negative.any():
                wrong = negative.reshape(*grid.shape, -1).any(-1)
                raise bad_voxels(grid.name, "negative", wrong, "values of at least 0")
            if not grid.same_lattice(self.sigma_t):
                raise bad(f"{name}'s lattice", f"{grid.shape}", f"sigma_t's, {self.sigma_t.shape}")
        sigma_t, sigma_s = self.sigma_t.values, self.sigma_s.values
        if sigma_t.ndim != sigma_s.ndim:
            sigma_t = sigma_t if sigma_t.ndim == 4 else sigma_t[..., None]
            sigma_s = sigma_s if sigma_s.ndim == 4 else sigma_s[..., None]
        above = sigma_s > sigma_t * (1 + ALBEDO_SLACK) + np.float32(1e-30)
        if above.any():
            raise bad_voxels(
                "sigma_s",
                "above sigma_t",
                above.reshape(*self.sigma_t.shape, -1).any(-1),
                "at most sigma_t",
            )

    @classmethod
    def from_density(
        cls, density: Grid, scale: ArrayLike | float = 1.0, albedo: ArrayLike | float = 1.0
    ) -> Medium:
        """sigma_t = scale * density (scale: one number or RGB, per world unit), one albedo."""
        scale_rgb, albedo_rgb = colour("density scale", scale), colour("albedo", albedo)
        if np.any(albedo_rgb > 1):
            raise bad("albedo", albedo_rgb.tolist(), "0 to 1")
        sigma_t = _scaled(density, scale_rgb)
        return cls(sigma_t, _scaled(density, scale_rgb * albedo_rgb))

    @property
    def channels(self) -> int:
        """Channels of the extinction: 1 or 3."""
        return self.sigma_t.channels

    @property
    def is_empty(self) -> bool:
        """Whether there is neither extinction nor emission anywhere."""
        return not self.sigma_t.values.any() and (
            self.emission is None or not self.emission.values.any()
        )

    @cached_property
    def constant_albedo(self) -> np.ndarray | None:
        """RGB float64 albedo when sigma_s is one constant times sigma_t, otherwise None. Looked for
        once, in every voxel."""
        sigma_t = np.atleast_1d(self.sigma_t.values.max(axis=(0, 1, 2)).astype(np.float64))
        sigma_s = np.atleast_1d(self.sigma_s.values.max(axis=(0, 1, 2)).astype(np.float64))
        albedo = np.divide(sigma_s, sigma_t, out=np.zeros(np.broadcast(sigma_s, sigma_t).shape),
                           where=sigma_t > 0)  # fmt: skip
        wide_t = self.sigma_t.values if self.channels == 3 else self.sigma_t.values[..., None]
        wide_s = (
            self.sigma_s.values if self.sigma_s.channels == 3 else self.sigma_s.values[..., None]
        )
        expected = wide_t * albedo.astype(np.float32)
        tolerance = np.float32(ALBEDO_SLACK) * wide_t
        if np.all(np.abs(wide_s - expected) <= tolerance + np.float32(1e-30)):
            constant = np.broadcast_to(albedo, (3,)).copy()
            constant.setflags(write=False)
            return constant
        return None

    @property
    def extinction_colour(self) -> np.ndarray | None:
        """RGB float64, 1 at its largest, when sigma_t is one field times this, otherwise None."""
        if self.channels == 1:
            return np.ones(3)
        values = self.sigma_t.values
        largest = values.max(axis=(0, 1, 2)).astype(np.float64)
        strongest = int(largest.argmax())
        if largest[strongest] == 0:
            return np.ones(3)
        shares = largest / largest[strongest]
        field = values[..., strongest]
        for channel in range(3):
            share = np.float32(shares[channel])
            error = np.abs(values[..., channel] - share * field)
            if np.any(error > np.float32(ALBEDO_SLACK) * share * field + np.float32(1e-30)):
                return None
        return np.asarray(shares)

    def trimmed(self, margin: int) -> Medium:
        """The same medium with only what it needs: the box that holds matter, grown by `margin`
        voxels, and one channel where all three are equal.

        Raises InputError when the medium is empty.
        """
        grids = [self.sigma_t] + ([self.emission] if self.emission is not None else [])
        box = active_box(*grids, margin=margin)
        if box is None:
            raise InputError(
                f"{self.sigma_t.name} holds only zeros; expected some voxel with extinction"
            )
        emission = self.emission
        if emission is not None:
            emission = _one_channel(emission.crop(*box)) if emission.values.any() else None
        return replace(
            self,
            sigma_t=_one_channel(self.sigma_t.crop(*box)),
            sigma_s=_one_channel(self.sigma_s.crop(*box)),
            emission=emission,
        )


def _scaled(density: Grid, scale: np.ndarray) -> Grid:
    if density.channels == 1 and np.ptp(scale) == 0:
        return density.with_values(density.values * np.float32(scale[0]))
    wide = density.values if density.channels == 3 else density.values[..., None]
    return density.with_values(wide * scale.astype(np.float32))


def _one_channel(grid: Grid) -> Grid:
    if grid.channels == 1:
        return grid
    for slab in grid.slabs():  # the first with colours decides
        red, green, blue = (grid.values[slab][..., channel] for channel in range(3))
        highest = np.maximum(np.maximum(red, green), blue)
        lowest = np.minimum(np.minimum(red, green), blue)
        if np.any(highest - lowest > GREY_SLACK * np.maximum(highest, -lowest)):
            return grid
    return grid.with_values(np.ascontiguousarray(grid.values[..., 0]))
