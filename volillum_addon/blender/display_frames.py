"""Showing a sequence of bakes in sync with the scene."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np

from ..bake.frame_files import files
from ..bake.vdb import read_vdb
from ..core.errors import InputError
from ..core.grid import Grid
from ..models.angular import Angular
from ..models.illuminate import relight
from ..models.volume import Factor, IlluminationVolume, RadianceTerm
from .constants import Constants, constants, key_frames, same_nodes
from .display import display_material, grid_limit
from .frames import kept_frame
from .light_reader import read_lights
from .sandbox import load_volume

# What a term multiplies; its weight is what may change from frame to frame.
type Products = tuple[tuple[Factor, ...], Angular | None]


def show_frames(
    first: Path, scene: bpy.types.Scene, collection: bpy.types.Collection
) -> bpy.types.Object:
    """A volume object that plays the sequence, under the lights as they are at each frame.

    What differs between the frames' materials (lights that move or change, an albedo) are their
    constants: these get key frames. Raises InputError where the frames need unlike materials.
    """
    paths = files(first)
    with kept_frame(scene):
        products: dict[Products, None] = {}
        channels: dict[str, Grid] = {}
        for frame, path in paths.items():
            volume = _lit(scene, frame, path)
            products |= dict.fromkeys(_products(term) for term in volume.radiance)
            channels |= {name: _stand_in(grid) for name, grid in volume.channels.items()}
        material, found = _materials(scene, paths, tuple(products), channels)
    try:
        key_frames(material, found)
        data = load_volume(first)
    except InputError:
        bpy.data.materials.remove(material)
        raise
    start = min(paths)
    # Blender plays the file `frame - frame_start + 1 + frame_offset`: here the frame's own.
    data.is_sequence, data.frame_start, data.frame_duration = True, start, len(paths)
    data.frame_offset = start - 1
    data.materials.append(material)
    shown = bpy.data.objects.new(first.stem, data)
    collection.objects.link(shown)
    return shown


def _lit(scene: bpy.types.Scene, frame: int, path: Path) -> IlluminationVolume:
    scene.frame_set(frame)
    return relight(read_vdb(path), read_lights(scene))


def _products(term: RadianceTerm) -> Products:
    return term.factors, term.angular


def _stand_in(grid: Grid) -> Grid:
    """One voxel of 0 with the grid's number of components: where a frame's file lacks the grid
    (a light is dark there), Blender reads 0."""
    return Grid(np.zeros((1, 1, 1, 3)[: 4 if grid.channels == 3 else 3], np.float32), np.eye(4))


def _materials(
    scene: bpy.types.Scene,
    paths: Mapping[int, Path],
    products: tuple[Products, ...],
    channels: Mapping[str, Grid],
) -> tuple[bpy.types.Material, dict[int, Constants]]:
    """The first frame's material, and every frame's constants, all over the same products: a term
    that a frame lacks has the weight 0 there."""
    material: bpy.types.Material | None = None
    found: dict[int, Constants] = {}
    try:
        for frame, path in paths.items():
            volume = _padded(_lit(scene, frame, path), products, channels)
            made = display_material(path.stem, volume, grid_limit(scene))
            found[frame] = constants(made)
            if material is None:
                material = made
            else:
                bpy.data.materials.remove(made)
                _require(same_nodes(found[frame], next(iter(found.values()))), frame)
    except InputError:
        if material is not None:
            bpy.data.materials.remove(material)
        raise
    assert material is not None  # a sequence has a frame
    return material, found


def _padded(
    volume: IlluminationVolume, products: tuple[Products, ...], channels: Mapping[str, Grid]
) -> IlluminationVolume:
    weights = {_products(term): term.weight for term in volume.radiance}
    terms = tuple(
        RadianceTerm(factors, weights.get((factors, angular), (0.0, 0.0, 0.0)), angular)
        for factors, angular in products
    )
    return replace(volume, radiance=terms, channels={**channels, **volume.channels})


def _require(alike: bool, frame: int) -> None:
    if not alike:
        raise InputError(
            f"frame {frame} needs another material than the others (its medium has other terms); "
            "expected the same kind of medium at every frame"
        )
