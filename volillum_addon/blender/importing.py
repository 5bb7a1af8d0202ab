"""From a file of any format to a volume object: plain functions that the operator calls."""

from __future__ import annotations

import hashlib
import re
from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np
from mathutils import Matrix

from ..core.control import Control
from ..core.errors import InputError
from ..core.grid import Grid
from ..core.transfer_function import TransferFunction
from ..readers.formats import read_volume, stem_of
from ..readers.imported import About, write_imported
from ..readers.medium_file import write_medium
from ..readers.source import Options
from ..readers.transfer_presets import default_name, load
from . import transfer
from .medium_builder import medium_material
from .places import relative

# The longest side of a volume that is fitted, in Blender's units: that of the default cube.
FITTED = 2.0
METRES = {"nm": 1e-9, "um": 1e-6, "mm": 1e-3, "cm": 1e-2, "in": 0.0254, "m": 1.0, "km": 1e3}
SIZES = (
    ("FIT", "Fit", f"The longest side is {FITTED:g} units long, the middle at the world's origin"),
    ("TRUE", "True size", "One unit is a metre; for files that tell their unit of length"),
    ("FILE", "The file's", "One unit is the file's own unit of length"),
)
AUTO = "AUTO"


@dataclass(frozen=True, eq=False)
class Imported:
    """What was written: the values and the coefficients that the function makes of them."""

    values: Path
    medium: Path
    about: About
    grid: Grid
    transfer: TransferFunction


def read(
    path: Path, directory: Path, level: int, options: Options, preset: str, control: Control
) -> Imported:
    """Read, write the values and what the preset makes of them. Any thread.

    Raises InputError, StorageError, Cancelled.
    """
    with control.stage(0.0, 0.5, f"reading {path.name}"):
        grid, about = read_volume(path, level, options, control)
    digest = hashlib.sha256(repr((grid.shape, about)).encode())
    digest.update(grid.index_to_world.tobytes())
    digest.update(grid.values.tobytes())
    stem = stem_of(path)
    values = directory / f"{stem}.values.{digest.hexdigest()[:12]}.vdb"
    chosen = load(default_name(about) if preset == AUTO else preset, about)
    with control.stage(0.5, 0.7, f"writing {values.name}"):
        if not values.is_file():
            write_imported(grid, about, values, control)
    with control.stage(0.7, 1.0, "applying the transfer function"):
        medium = write_medium((grid, about), chosen, directory, stem, control)
    return Imported(values, medium, about, grid, chosen)


def place(scene: bpy.types.Scene, imported: Imported, size: str) -> bpy.types.Object:
    """A volume object that shows the imported volume, selected and named by the scene's settings.

    Raises InputError for a true size of a file that does not tell its unit.
    """
    matrix = placement(imported.grid, imported.about, size)
    name = stem_of(Path(imported.about.source))
    material = medium_material(name)
    transfer.write(material, imported.transfer)
    material.volillum.source = relative(imported.values)
    material.volillum.applied = transfer.signature(material)
    item = add_volume(scene, name, imported.medium)
    item.data.materials.append(material)
    item.matrix_world = matrix
    return item


def placement(grid: Grid, about: About, size: str) -> Matrix:
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
    corners = grid.corners()
    scale = FITTED / float(np.ptp(corners, axis=0).max())
    return Matrix.Scale(scale, 4) @ Matrix.Translation(-grid.centre)


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


def add_vdb(scene: bpy.types.Scene, path: Path) -> bpy.types.Object:
    """A volume object of a VDB file as it is, or of the sequence that it belongs to."""
    item = add_volume(scene, _sequence_stem(path) or path.stem, path)
    frames = sequence_frames(path)
    if len(frames) > 1:
        item.data.is_sequence = True
        item.data.frame_start, item.data.frame_duration = frames[0], len(frames)
        item.data.frame_offset = frames[0] - 1
        item.data.filepath = relative(_frame_path(path, frames[0]))
    return item


def sequence_frames(path: Path) -> list[int]:
    """The numbers of the files that make up an unbroken sequence with this one."""
    stem = _sequence_stem(path)
    if stem is None:
        return []
    pattern = re.compile(re.escape(stem) + r"(\d+)" + re.escape(path.suffix))
    there = {int(found[1]) for file in path.parent.glob(f"*{path.suffix}")
             if (found := pattern.fullmatch(file.name))}  # fmt: skip
    first = last = int(path.stem[len(stem) :])
    while first - 1 in there:
        first -= 1
    while last + 1 in there:
        last += 1
    return list(range(first, last + 1))


def _sequence_stem(path: Path) -> str | None:
    """The name before a frame's number, or None where there is no number."""
    found = re.fullmatch(r"(.*?)(\d+)", path.stem)
    return found[1] if found else None


def _frame_path(path: Path, frame: int) -> Path:
    stem = _sequence_stem(path) or ""
    digits = len(path.stem) - len(stem)
    return path.with_name(f"{stem}{frame:0{digits}d}{path.suffix}")
