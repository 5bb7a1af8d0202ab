"""A transfer function: how scalar data become a participating medium."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .errors import bad, number
from .grid import Grid
from .medium import Medium


@dataclass(frozen=True, eq=False)
class TransferFunction:
    """Piecewise linear maps of a data value to relative density and to albedo.

    `values` [n] ascend strictly, in the data's own unit; `density` [n] is relative to `per_voxel`,
    the optical depth of one voxel (of the grid's mean edge length) of density 1, or with `physical`
    to an extinction of `per_voxel` per unit of length; `albedo` [n, 3] is RGB in 0 to 1. Values
    beyond the ends take the ends' density and albedo. It is applied to voxel values: the medium is
    the interpolant of what comes out.

    Raises InputError for points that do not ascend or are out of range.
    """

    values: ArrayLike
    density: ArrayLike
    albedo: ArrayLike
    per_voxel: float
    unit: str = ""
    summary: str = ""
    physical: bool = False

    def __post_init__(self) -> None:
        values = np.asarray(self.values, np.float64)
        density = np.asarray(self.density, np.float64)
        albedo = np.asarray(self.albedo, np.float64)
        if values.ndim != 1 or len(values) < 1 or not np.all(np.isfinite(values)):
            raise bad("transfer function's values", values.tolist(), "a list of finite numbers")
        if np.any(np.diff(values) <= 0):
            raise bad("transfer function's values", values.tolist(), "strictly ascending ones")
        if density.shape != values.shape or not np.all((density >= 0) & np.isfinite(density)):
            raise bad("transfer function's density", density.tolist(), "one from 0 up per value")
        if albedo.shape != (len(values), 3) or not np.all((albedo >= 0) & (albedo <= 1)):
            raise bad("transfer function's albedo", albedo.tolist(), "RGB from 0 to 1 per value")
        number("transfer function's per_voxel", self.per_voxel, 0.0, 1e9)
        for name, array in (("values", values), ("density", density), ("albedo", albedo)):
            object.__setattr__(self, name, array)

    @classmethod
    def from_json(cls, entry: Mapping[str, Any]) -> TransferFunction:
        """From a preset: `points` are [value, density, red, green, blue]."""
        for name in ("points", "per_voxel"):
            if name not in entry:
                raise bad("transfer function's entries", sorted(entry), f"one named {name!r}")
        points = np.asarray(entry["points"], np.float64)
        if points.ndim != 2 or points.shape[1] != 5:
            shape = points.shape
            raise bad(
                "transfer function's points", f"of shape {shape}", "[value, density, r, g, b]"
            )
        return cls(
            values=points[:, 0],
            density=points[:, 1],
            albedo=points[:, 2:],
            per_voxel=entry["per_voxel"],
            unit=entry.get("unit", ""),
            summary=entry.get("summary", ""),
            physical=bool(entry.get("physical", False)),
        )

    def as_json(self) -> dict[str, Any]:
        """What `from_json` reads."""
        columns = [self.values, self.density, *np.transpose(self.albedo)]
        return {
            "summary": self.summary,
            "unit": self.unit,
            "per_voxel": self.per_voxel,
            "physical": self.physical,
            "points": np.transpose(columns).tolist(),
        }

    def densities(self, data: NDArray[np.float32]) -> NDArray[np.float32]:
        """Relative density of data values, same shape."""
        return np.interp(data, self.values, self.density).astype(np.float32)  # type: ignore[arg-type]

    def albedos(self, data: NDArray[np.float32]) -> NDArray[np.float32]:
        """Albedo of data values, [..., 3]."""
        rgb = np.asarray(self.albedo)
        columns = [np.interp(data, self.values, rgb[:, c]) for c in range(3)]  # type: ignore[arg-type]
        return np.stack(columns, axis=-1).astype(np.float32)

    def per_length(self, data: Grid) -> float:
        """Extinction of density 1 on this grid, per world unit."""
        return self.per_voxel / (1.0 if self.physical else float(data.voxel_size.mean()))

    def medium(self, data: Grid) -> Medium:
        """The medium of a scalar grid: extinction grey, albedo by value."""
        if data.channels != 1:
            raise bad(f"{data.name}'s channels", data.channels, "1 for a transfer function")
        sigma_t = self.densities(data.values) * np.float32(self.per_length(data))
        colours = np.asarray(self.albedo)
        if np.ptp(colours, axis=-1).max() == 0:
            albedo = np.interp(data.values, self.values, colours[:, 0])  # type: ignore[arg-type]
            sigma_s = sigma_t * albedo.astype(np.float32)
        else:
            sigma_s = sigma_t[..., None] * self.albedos(data.values)
        return Medium(data.with_values(sigma_t, "sigma_t"), data.with_values(sigma_s, "sigma_s"))
