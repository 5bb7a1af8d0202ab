"""From a file of any format to a volume object: plain functions that the operator calls."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import bpy
import numpy as np
from mathutils import Matrix
from numpy.typing import NDArray

from ..core.control import Control
from ..core.errors import InputError
from ..core.transfer_function import TransferFunction
from ..readers.formats import format_of, read_volume, stem_of
from ..readers.imported import About, write_imported
from ..readers.medium_file import write_medium
from ..readers.sequence import apply_frames, read_frames
from ..readers.source import Options
from ..readers.transfer_presets import default_name, load
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
AUTO = "AUTO"


@dataclass(frozen=True, eq=False)
class Source:
    """What to import: one file of any format, or all VDB files of a sequence by frame."""

    path: Path
    frames: Mapping[int, Path] = field(default_factory=dict)

    @property
    def stem(self) -> str:
        """What the volume is called by."""
        return _sequence_name(self.path) if self.frames else stem_of(self.path)


@dataclass(frozen=True, eq=False)
class Imported:
    """What was written: the values and the coefficients that the function makes of them, of a
    sequence the first files; and the corners [n, 3] of the box, of a sequence of all boxes."""

    name: str
    values: Path
    medium: Path
    about: About
    corners: NDArray[np.float64]
    transfer: TransferFunction
    frames: tuple[int, ...] = ()


def file_source(path: Path) -> Source:
    """The file, or the sequence that a VDB file belongs to."""
    frames = sequence_frames(path) if format_of(path).id == "vdb" else []
    if len(frames) < 2:
        return Source(path)
    return Source(path, {frame: _frame_path(path, frame) for frame in frames})


def source_of(volume: bpy.types.Object) -> Source:
    """The files that a volume object shows. Raises InputError."""
    path = block_file(volume.data)
    return file_source(path) if volume.data.is_sequence else Source(volume_path(volume))


def read(
    source: Source, directory: Path, level: int, options: Options, preset: str, control: Control
) -> Imported:
    """Read, write the values and what the preset makes of them. Any thread.

    Raises InputError, StorageError, Cancelled.
    """
    if source.frames:
        return _read_frames(source, directory, level, options, preset, control)
    path, stem = source.path, source.stem
    with control.stage(0.0, 0.5, f"reading {path.name}"):
        grid, about = read_volume(path, level, options, control)
    digest = hashlib.sha256(repr((grid.shape, about)).encode())
    digest.update(grid.index_to_world.tobytes())
    digest.update(grid.values.tobytes())
    values = directory / f"{stem}.values.{digest.hexdigest()[:12]}.vdb"
    chosen = _chosen(preset, about)
    with control.stage(0.5, 0.7, f"writing {values.name}"):
        if not values.is_file():
            write_imported(grid, about, values, control)
    with control.stage(0.7, 1.0, "applying the transfer function"):
        medium = write_medium((grid, about), chosen, directory, stem, control)
    return Imported(stem, values, medium, about, grid.corners(), chosen)


def _read_frames(
    source: Source, directory: Path, level: int, options: Options, preset: str, control: Control
) -> Imported:
    with control.stage(0.0, 0.5, "reading"):
        values = read_frames(source.frames, directory, source.stem, level, options, control)
    chosen = _chosen(preset, values.about)
    with control.stage(0.5, 1.0, "applying the transfer function"):
        medium = apply_frames(values.files, chosen, directory, control)
    return Imported(
        source.stem, values.files[0], medium, values.about, values.corners, chosen,
        tuple(sorted(source.frames)),
    )  # fmt: skip


def _chosen(preset: str, about: About) -> TransferFunction:
    return load(default_name(about) if preset == AUTO else preset, about)


def place(scene: bpy.types.Scene, imported: Imported, size: str) -> bpy.types.Object:
    """A volume object that shows the imported volume, selected and named by the scene's settings.

    Raises InputError for a true size of a file that does not tell its unit.
    """
    matrix = placement(imported.corners, imported.about, size)
    item = add_volume(scene, imported.name, imported.medium)
    if imported.frames:
        _play(item.data, imported.frames)
    give(item.data, imported)
    item.matrix_world = matrix
    return item


def give(data: bpy.types.Volume, imported: Imported) -> None:
    """Make a volume show what was imported, by a new material with the transfer function. When a
    sequence plays which of its frames stays."""
    material = medium_material(imported.name)
    transfer.write(material, imported.transfer)
    material.volillum.source = relative(imported.values)
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


def add_vdb(scene: bpy.types.Scene, path: Path, alone: bool = False) -> bpy.types.Object:
    """A volume object of a VDB file as it is; unless it is to be `alone`, of the sequence that it
    belongs to."""
    frames = [] if alone else sequence_frames(path)
    name = _sequence_name(path) if len(frames) > 1 else path.stem
    item = add_volume(scene, name, path)
    if len(frames) > 1:
        _play(item.data, frames)
        item.data.filepath = relative(_frame_path(path, frames[0]))
    return item


def _play(data: bpy.types.Volume, frames: Sequence[int]) -> None:
    """Make the data play files of these numbers, each at its own frame."""
    data.is_sequence = True
    data.frame_start, data.frame_duration = frames[0], len(frames)
    data.frame_offset = frames[0] - 1


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


def _sequence_name(path: Path) -> str:
    """What a sequence is called by: what its files have in common."""
    return (_sequence_stem(path) or "").rstrip("._-") or path.parent.name or "frames"


def _sequence_stem(path: Path) -> str | None:
    """The name before a frame's number, or None where there is no number."""
    found = re.fullmatch(r"(.*?)(\d+)", path.stem)
    return found[1] if found else None


def _frame_path(path: Path, frame: int) -> Path:
    stem = _sequence_stem(path) or ""
    digits = len(path.stem) - len(stem)
    return path.with_name(f"{stem}{frame:0{digits}d}{path.suffix}")
