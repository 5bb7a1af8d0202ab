"""From what was imported to a volume object: plain functions that the operators call."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import bpy
import numpy as np
from mathutils import Matrix
from numpy.typing import NDArray

from ..core.errors import InputError
from ..readers.frames import VolumeFiles, sequence_of
from ..readers.imported import About
from ..readers.matter import Imported
from . import transfer
from .medium_builder import medium_material
from .places import block_file, relative
from .scene_reader import volume_path

# The longest side of a volume that is fitted, in Blender's units: that of the default cube.
FITTED = 2.0
METRES = {"nm": 1e-9, "um": 1e-6, "mm": 1e-3, "cm": 1e-2, "in": 0.0254, "m": 1.0, "km": 1e3}
SIZES = (
    ("FIT", "Fit", f"The longest side is {FITTED:g} units long, the middle at the world's origin"),
    ("TRUE", "True size", "One unit is a metre; for files that tell their unit of length"),
    ("FILE", "The file's", "One unit is the file's own unit of length"),
)


def files_of(volume: bpy.types.Object) -> VolumeFiles:
    """The files that a volume object shows. Raises InputError."""
    if volume.data.is_sequence:
        return sequence_of(block_file(volume.data))
    return VolumeFiles(volume_path(volume))


def place(scene: bpy.types.Scene, imported: Imported, size: str) -> bpy.types.Object:
    """A volume object that shows the imported volume, selected and named by the scene's settings.

    Raises InputError for a true size of a file that does not tell its unit.
    """
    matrix = placement(imported.corners, imported.about, size)
    item = add_volume(scene, imported.name, imported.medium)
    if imported.frames:
        play(item.data, imported.frames)
    give(item.data, imported)
    item.matrix_world = matrix
    return item


def give(data: bpy.types.Volume, imported: Imported, folder: Path | None = None) -> None:
    """Make a volume show what was imported, by a new material with the transfer function. When a
    sequence plays which of its frames stays. `folder`: where the file will be, if it is new."""
    material = medium_material(imported.name)
    transfer.write(material, imported.transfer)
    material.volillum.source = relative(imported.values, folder)
    material.volillum.frames = len(imported.frames)
    material.volillum.applied = transfer.signature(material)
    data.filepath = relative(imported.medium)
    data.materials.append(material)


def placement(corners: NDArray[np.float64], about: About, size: str) -> Matrix:
    """The object's matrix_world for one of SIZES. Raises InputError."""
    if size == "FILE":
        return Matrix.Identity(4)
    if size == "TRUE":
        if about.length_unit not in METRES:
            known = ", ".join(METRES)
            found = repr(about.length_unit) if about.length_unit else "not told by the file"
            raise InputError(f"the unit of length is {found}; expected one of {known} for a true "
                             f"size (or choose Fit), in {about.source}")  # fmt: skip
        return Matrix.Scale(METRES[about.length_unit], 4)
    low, high = corners.min(axis=0), corners.max(axis=0)
    scale = FITTED / float((high - low).max())
    return Matrix.Scale(scale, 4) @ Matrix.Translation(-(low + high) / 2)


def add_volume(scene: bpy.types.Scene, name: str, path: Path) -> bpy.types.Object:
    """A volume object of a VDB file, the active one of its scene."""
    data = bpy.data.volumes.new(name)
    data.filepath = relative(path)
    item = bpy.data.objects.new(name, data)
    scene.collection.objects.link(item)
    layer = scene.view_layers[0]
    for each in layer.objects:
        each.select_set(each == item, view_layer=layer)
    layer.objects.active = item
    scene.volillum.volume = item
    return item


def add_vdb(scene: bpy.types.Scene, files: VolumeFiles) -> bpy.types.Object:
    """A volume object of a VDB file or sequence as it is."""
    item = add_volume(scene, files.stem, files.path)
    if files.frames:
        play(item.data, tuple(files.frames))
    return item


def play(data: bpy.types.Volume, frames: Sequence[int]) -> None:
    """Make the data play files of these numbers, each at its own frame."""
    data.is_sequence = True
    data.frame_start, data.frame_duration = frames[0], len(frames)
    data.frame_offset = frames[0] - 1
