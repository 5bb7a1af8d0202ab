"""The participating medium: extinction, scattering, emission, phase anisotropy."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .errors import InputError, bad, bad_voxels, colour, number
from .grid import Grid, active_box

# float32 rounding of sigma_s / sigma_t for an albedo of exactly 1.
ALBEDO_SLACK = 1e-5
# What rounding may leave of numbers that are too small for float32's full precision.
LEAST = np.float32(1e-30)
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
            if any((grid.values[slab] < 0).any() for slab in grid.slabs()):
                wrong = (grid.values < 0).reshape(*grid.shape, -1).any(-1)
                raise bad_voxels(grid.name, "negative", wrong, "values of at least 0")
            if not grid.same_lattice(self.sigma_t):
                raise bad(f"{name}'s lattice", f"{grid.shape}", f"sigma_t's, {self.sigma_t.shape}")
        if any(self._scatters_too_much(slab).any() for slab in self.sigma_t.slabs()):
            raise bad_voxels(
                "sigma_s", "above sigma_t", self._scatters_too_much(slice(None)), "at most sigma_t"
            )

    def _scatters_too_much(self, slab: slice) -> NDArray[np.bool_]:
        """[slab, j, k]: whether some channel scatters more than is extinguished."""
        wrong = np.zeros(self.sigma_t.values[slab].shape[:3], bool)
        for channel in range(max(self.sigma_t.channels, self.sigma_s.channels)):
            extinction = _channel(self.sigma_t, channel)[slab]
            wrong |= _channel(self.sigma_s, channel)[slab] > extinction * (1 + ALBEDO_SLACK) + LEAST
        return wrong

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
        sigma_t, sigma_s = (_largest(grid) for grid in (self.sigma_t, self.sigma_s))
        albedo = np.divide(sigma_s, sigma_t, out=np.zeros(np.broadcast(sigma_s, sigma_t).shape),
                           where=sigma_t > 0)  # fmt: skip
        for slab in self.sigma_t.slabs():
            for channel, share in enumerate(albedo):
                extinction = _channel(self.sigma_t, channel)[slab]
                scattering = _channel(self.sigma_s, channel)[slab]
                if not _agree(scattering, np.float32(share) * extinction, extinction):
                    return None
        constant = np.broadcast_to(albedo, (3,)).copy()
        constant.setflags(write=False)
        return constant

    @property
    def extinction_colour(self) -> np.ndarray | None:
        """RGB float64, 1 at its largest, when sigma_t is one field times this, otherwise None."""
        if self.channels == 1:
            return np.ones(3)
        largest = _largest(self.sigma_t)
        strongest = int(largest.argmax())
        if largest[strongest] == 0:
            return np.ones(3)
        shares = largest / largest[strongest]
        for slab in self.sigma_t.slabs():
            field = _channel(self.sigma_t, strongest)[slab]
            for channel, share in enumerate(shares.astype(np.float32)):
                if not _agree(_channel(self.sigma_t, channel)[slab], share * field, share * field):
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


def _channel(grid: Grid, channel: int) -> NDArray[np.float32]:
    """One of the grid's channels, [i, j, k]; a scalar grid's only one."""
    return grid.values if grid.channels == 1 else grid.values[..., channel]


def _largest(grid: Grid) -> NDArray[np.float64]:
    """The largest value of each channel."""
    return np.array([_channel(grid, channel).max() for channel in range(grid.channels)], np.float64)


def _agree(
    values: NDArray[np.float32], expected: NDArray[np.float32], size: NDArray[np.float32]
) -> bool:
    """Whether the values are the expected ones but for rounding, which is in proportion to size."""
    return bool(np.all(np.abs(values - expected) <= np.float32(ALBEDO_SLACK) * size + LEAST))


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
