"""A small lopsided plume as a file and as a lit Blender scene, for tests of the interface."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import bpy
import numpy as np

from volillum_addon.bake.grids import read_grid, to_vdb
from volillum_addon.bake.openvdb_module import openvdb
from volillum_addon.blender import scene_builder, scene_presets
from volillum_addon.blender.extent import Extent
from volillum_addon.core.grid import Grid
from volillum_addon.readers.frames import VolumeFiles

SHAPE = (12, 15, 19)


def plume(shape: tuple[int, int, int] = SHAPE, name: str = "density") -> Grid:
    """Unequal sides, no symmetry, off the origin."""
    i, j, k = np.meshgrid(*(np.linspace(-1, 1, n) for n in shape), indexing="ij")
    values = np.exp(-3 * ((i - 0.2 * k) ** 2 + (j + 0.1) ** 2 + 0.6 * k**2)) - 0.2
    affine = np.diag([0.3, 0.25, 0.2, 1.0])
    affine[:3, 3] = (2.0, -1.0, 0.5)
    return Grid(np.maximum(values, 0).astype(np.float32), affine, name)


def write_plume(path: Path, shape: tuple[int, int, int] = SHAPE) -> Path:
    """The plume as a VDB file with the one grid `density`."""
    openvdb().write(str(path), grids=[to_vdb(plume(shape), "density")])
    return path


@contextmanager
def plume_scene(path: Path, shape: tuple[int, int, int] = SHAPE) -> Iterator[bpy.types.Scene]:
    """A new scene around the plume in the default preset's light; it is gone afterwards."""
    before = {block.session_uid for block in bpy.data.user_map()}
    write_plume(path, shape)
    scene = bpy.data.scenes.new("plume")
    extent = Extent.of(read_grid(path))
    scene_builder.build_scene(scene, VolumeFiles(path), extent, scene_presets.load("default"))
    scene.view_layers[0].update()
    try:
        yield scene
    finally:
        bpy.data.batch_remove(b for b in bpy.data.user_map() if b.session_uid not in before)
