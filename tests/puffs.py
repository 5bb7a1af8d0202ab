"""A short sequence of real VDB files, for tests of what plays over time."""

from __future__ import annotations

from pathlib import Path

from blender_scenes import write_grids
from plumes import plume

from volillum_addon.bake.openvdb_module import openvdb

FRAMES = (2, 3, 4)


def puffs(directory: Path) -> Path:
    """Three frames that rise, widen their box and grow brighter; the first file."""
    directory.mkdir(exist_ok=True)
    for frame in FRAMES:
        grid = plume((12, 15, 15 + 2 * frame))
        write_grids(directory / f"puff_{frame:04d}.vdb", grid.with_values(grid.values * frame))
    return directory / f"puff_{FRAMES[0]:04d}.vdb"


def empty_file(path: Path) -> None:
    grid = openvdb().FloatGrid()
    grid.name = "density"
    openvdb().write(str(path), grids=[grid])
