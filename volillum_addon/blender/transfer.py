"""The transfer function of a volume in Blender: a colour ramp in the volume's own material, so that
it is undone, saved, copied and appended with it. Colour is albedo, alpha is density."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ..bake.frame_files import frame_file, frame_of
from ..core.errors import InputError
from ..core.transfer_function import TransferFunction
from ..readers.imported import About, read_about
from ..readers.sequence import about_all
from ..readers.transfer_presets import fitted, span
from .medium_reader import volume_material

# The node that holds the ramp; nothing is linked to it.
NODE = "Transfer function"
# What Blender's ramps hold.
MOST_STOPS = 32
# Stops of a ramp may share a place; a function's values are this share of the range apart.
APART = 1e-6

_abouts: dict[tuple[str, int, int], About] = {}


def _get_text(settings: Any) -> str:
    try:
        return json.dumps(as_preset(settings.id_data))
    except InputError:
        return ""  # a material without a transfer function


def _set_text(settings: Any, text: str) -> None:
    from_preset(settings.id_data, json.loads(text))


class Transfer(bpy.types.PropertyGroup):
    """What goes with the ramp; kept in the volume's material."""

    source: bpy.props.StringProperty(
        name="Values",
        description="The imported file whose values the ramp maps",
        subtype="FILE_PATH",
        options={"PATH_SUPPORTS_BLEND_RELATIVE"},
    )
    frames: bpy.props.IntProperty(
        name="Frames",
        description="How many files of a sequence, of which the imported file is the first; 0: one "
        "volume that stands still",
        min=0,
        options=set(),
    )
    low: bpy.props.FloatProperty(
        name="From", description="The value at the ramp's left end, in the data's own unit"
    )
    high: bpy.props.FloatProperty(
        name="To", description="The value at the ramp's right end, in the data's own unit"
    )
    per_voxel: bpy.props.FloatProperty(
        name="Density",
        description="Optical depth of a voxel where the ramp is opaque: more makes surfaces, less "
        "makes fog",
        default=1.0,
        min=0.0,
        soft_max=10.0,
    )
    physical: bpy.props.BoolProperty(
        name="Per length",
        description="Density is an extinction per unit of length instead of per voxel: for data "
        "that are extinctions themselves",
    )
    logarithmic: bpy.props.BoolProperty(
        name="Logarithmic",
        description="Show the histogram's counts by their logarithm: rare values show too",
        default=True,
        options=set(),
    )
    applied: bpy.props.StringProperty(options={"HIDDEN"})
    text: bpy.props.StringProperty(
        name="Transfer function",
        description="All of it as a preset's text",
        get=_get_text,
        set=_set_text,
        options={"HIDDEN", "SKIP_SAVE"},
    )


def material_of(scene: bpy.types.Scene) -> bpy.types.Material | None:
    """The material of the scene's volume, where it has a transfer function."""
    from . import work

    volume = work.chosen_volume(scene)
    material = None if volume is None else volume_material(volume)
    return material if material is not None and NODE in _nodes(material) else None


def ramp_node(material: bpy.types.Material) -> bpy.types.Node:
    """The node with the colour ramp; made where it is not there."""
    nodes = _nodes(material)
    if NODE not in nodes:
        node = nodes.new("ShaderNodeValToRGB")
        node.name = node.label = NODE
        node.location = (0, 340)
    return nodes[NODE]


def source_of(material: bpy.types.Material) -> Path:
    """The imported file. Raises InputError when it is missing."""
    path = Path(bpy.path.abspath(material.volillum.source, library=material.library))
    # A file that was moved, or saved for the first time: its volumes' paths went along with it.
    beside = [
        Path(bpy.path.abspath(volume.filepath, library=volume.library)).with_name(path.name)
        for volume in bpy.data.volumes
        if material.name in volume.materials and volume.filepath
    ]
    path = next((place for place in (path, *beside) if place.is_file()), path)
    if not path.is_file():
        raise InputError(f"the values of {material.name!r} are not there: {path}; expected the "
                         "imported file (import the volume again)")  # fmt: skip
    return path


def frames_of(material: bpy.types.Material) -> tuple[Path, ...]:
    """The files of a sequence's values, in order; none of a volume that stands still. Raises
    InputError when one is missing."""
    count = material.volillum.frames
    if not count:
        return ()
    first = source_of(material)
    begin = frame_of(first)
    files = tuple(frame_file(first, frame) for frame in range(begin, begin + count))
    for file in files:
        if not file.is_file():
            raise InputError(f"the values of {material.name!r} are not all there: {file}; expected "
                             "every imported frame (import the sequence again)")  # fmt: skip
    return files


def about(material: bpy.types.Material) -> About:
    """What is known of the values, of a sequence over all its frames. Raises InputError."""
    path, count = source_of(material), material.volillum.frames
    key = str(path), path.stat().st_mtime_ns, count
    if key not in _abouts:
        _abouts[key] = about_all(frames_of(material)) if count else read_about(path)
    return _abouts[key]


def read(material: bpy.types.Material) -> TransferFunction:
    """The ramp as a function of the data's values. Raises InputError."""
    settings = material.volillum
    if not settings.high > settings.low:
        raise InputError(f"the transfer function goes from {settings.low:g} to {settings.high:g}; "
                         "expected To above From")  # fmt: skip
    stops = sorted(ramp_node(material).color_ramp.elements, key=lambda stop: stop.position)
    places = np.array([stop.position for stop in stops], np.float64)
    for n in range(1, len(places)):
        places[n] = max(places[n], places[n - 1] + APART)
    colours = np.clip([tuple(stop.color) for stop in stops], 0, 1)
    return TransferFunction(
        values=settings.low + (settings.high - settings.low) * places,
        density=colours[:, 3],
        albedo=colours[:, :3],
        per_voxel=settings.per_voxel,
        physical=settings.physical,
    )


def write(material: bpy.types.Material, transfer: TransferFunction) -> None:
    """Show the function in the ramp. Raises InputError where it has too many points."""
    values = np.asarray(transfer.values)
    if len(values) > MOST_STOPS:
        raise InputError(f"the transfer function has {len(values)} points; expected at most "
                         f"{MOST_STOPS}, which is what a colour ramp holds")  # fmt: skip
    settings = material.volillum
    settings.low = float(values[0])
    settings.high = float(values[-1]) if len(values) > 1 else float(values[0]) + 1.0
    settings.per_voxel, settings.physical = transfer.per_voxel, transfer.physical
    ramp = ramp_node(material).color_ramp
    ramp.color_mode, ramp.interpolation = "RGB", "LINEAR"
    while len(ramp.elements) > 1:
        ramp.elements.remove(ramp.elements[-1])
    places = (values - settings.low) / (settings.high - settings.low)
    colours = np.column_stack([np.asarray(transfer.albedo), np.asarray(transfer.density)])
    ramp.elements[0].position = 0.0
    for n, (place, colour) in enumerate(zip(places, colours, strict=True)):
        stop = ramp.elements[0] if n == 0 else ramp.elements.new(min(max(float(place), 0), 1))
        stop.color = colour


def as_preset(material: bpy.types.Material) -> dict[str, Any]:
    """A preset's entries; relative to the data's range where its values have no unit."""
    entry = read(material).as_json()
    known = about(material)
    entry["unit"], entry["kind"] = known.unit, known.kind
    if not known.unit:
        low, scale = span(known)
        entry["relative"] = True
        entry["points"] = [[(value - low) / scale, *rest] for value, *rest in entry["points"]]
    return entry


def from_preset(material: bpy.types.Material, entry: dict[str, Any]) -> None:
    """Take a preset's entries. Raises InputError."""
    write(material, fitted(entry, about(material)))


def signature(material: bpy.types.Material) -> str:
    """What an application of the function depends on."""
    return json.dumps([material.volillum.source, read(material).as_json()])


def _nodes(material: bpy.types.Material) -> Any:
    return material.node_tree.nodes if material.node_tree is not None else {}


def register() -> None:
    """Give materials room for what goes with the ramp."""
    bpy.utils.register_class(Transfer)
    bpy.types.Material.volillum = bpy.props.PointerProperty(type=Transfer)


def unregister() -> None:
    """Take it away again; what is stored in files stays."""
    del bpy.types.Material.volillum
    bpy.utils.unregister_class(Transfer)
