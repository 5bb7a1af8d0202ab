"""The gallery: standard scenes from real volumes, as data. Needs no bpy.

An entry is `presets/gallery/<name>.json`: the volume's file, what makes a medium of it (a transfer
function, an optical depth, or an extinction for density 1), perhaps another grid that glows, and a
scene preset (scene_presets.py). Files that come with the program lie in `presets/volumes`; others
are looked for in the folder VOLILLUM_DATA.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..bake.grids import read_grid
from ..core.errors import InputError, bad, choice, colour, number
from ..core.grid import Grid
from ..core.medium import Medium
from ..readers import transfer_presets
from ..readers.formats import read_volume
from ..readers.imported import About
from ..readers.transfer_presets import fitted
from ..resources import PRESETS
from . import scene_presets
from .scene_presets import ScenePreset

FOLDER = PRESETS / "gallery"
DATA_VARIABLE = "VOLILLUM_DATA"
WAYS = ("transfer_function", "optical_depth", "extinction")


@dataclass(frozen=True)
class Exhibit:
    """One entry, read but not its volume."""

    name: str
    summary: str
    volume: str
    medium: Mapping[str, Any]
    emission: Mapping[str, Any] | None
    preset: ScenePreset

    def load(self) -> Medium:
        """The medium. Raises InputError, also where the volume's file is not there."""
        path = volume_file(self.volume)
        grid, about = read_volume(path)
        medium = _medium(grid, about, self.medium)
        if self.emission is None:
            return medium
        glow = _on_lattice(read_grid(path, self.emission["grid"]), grid)
        radiance = colour("emission's radiance", self.emission["radiance"]).astype(np.float32)
        return replace(medium, emission=grid.with_values(glow[..., None] * radiance, "emission"))


def names(folder: Path = FOLDER) -> tuple[str, ...]:
    """The entries there are."""
    return tuple(sorted(path.stem for path in folder.glob("*.json")))


def exhibit(name: str, folder: Path = FOLDER) -> Exhibit:
    """The entry `name`; InputError for an unknown one or a file that is not as expected."""
    choice("the gallery's scene", name, names(folder))
    path = folder / f"{name}.json"
    try:
        entry = json.loads(path.read_text(encoding="utf-8"))
        summary = entry["summary"]
        return Exhibit(
            name,
            summary,
            entry["volume"],
            entry["medium"],
            entry.get("emission"),
            scene_presets.parsed({"summary": summary, **entry["scene"]}, path.name),
        )
    except json.JSONDecodeError as error:
        raise InputError(f"{path.name} is not JSON: {error}; expected a gallery's scene") from error
    except KeyError as error:
        raise bad(
            f"{path.name}'s entry {error.args[0]!r}", "missing", "a gallery's scene"
        ) from None


def volume_file(name: str) -> Path:
    """Where a volume's file is. Raises InputError that says how to get it."""
    shipped = PRESETS / "volumes" / name
    if shipped.exists():
        return shipped
    folder = os.environ.get(DATA_VARIABLE)
    if not folder:
        raise InputError(
            f"{name} does not come with volillum and {DATA_VARIABLE} is not set; expected it to "
            "name the folder of third-party volumes"
        )
    if not (Path(folder) / name).exists():
        raise InputError(f"{name} is not in {DATA_VARIABLE} ({folder}); expected it there")
    return Path(folder) / name


def _medium(grid: Grid, about: About, way: Mapping[str, Any]) -> Medium:
    chosen = [name for name in WAYS if name in way]
    if len(chosen) != 1:
        raise bad("the medium's ways", chosen, "one of " + ", ".join(WAYS))
    if "transfer_function" in way:
        chosen = way["transfer_function"]
        by_name = isinstance(chosen, str)
        function = transfer_presets.load(chosen, about) if by_name else fitted(chosen, about)
        return function.medium(grid)
    albedo = colour("albedo", way["albedo"])
    if "extinction" in way:
        scale = number("extinction", way["extinction"], 1e-30, 1e30)
        return Medium.from_density(grid, scale, albedo)
    depth = number("optical depth", way["optical_depth"], 1e-6, 1e6)
    return Medium.from_density(grid, depth / column(grid), albedo)


def column(grid: Grid) -> float:
    """The largest sum of density times length along the grid's axes."""
    largest = max(
        float(grid.values.sum(axis=axis, dtype=np.float64).max()) * float(grid.voxel_size[axis])
        for axis in range(3)
    )
    if largest <= 0:
        raise InputError(f"{grid.name} holds only zeros; expected some voxel with density")
    return largest


def _on_lattice(grid: Grid, lattice: Grid) -> np.ndarray:
    """Another grid's values at the lattice's voxels, where the two differ by whole voxels."""
    offset = np.rint(grid.to_index(lattice.to_world(np.zeros(3)))).astype(int)
    low = (int(offset[0]), int(offset[1]), int(offset[2]))
    high = tuple(a + n for a, n in zip(low, lattice.shape, strict=True))
    cropped = grid.crop(low, (high[0], high[1], high[2]))
    if not cropped.same_lattice(lattice):
        raise bad(f"{grid.name}'s voxels", "others", f"those of {lattice.name}")
    return cropped.values
