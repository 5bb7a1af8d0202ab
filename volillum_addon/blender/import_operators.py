"""File > Import and drag and drop: any format becomes a volume object."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, override

import bpy
import numpy as np

from ..core.errors import InputError
from ..readers import transfer_presets
from ..readers.formats import FORMATS, SUFFIXES, format_of
from ..readers.frames import VolumeFiles, sequence_of
from ..readers.gather import MOST_LEVEL
from ..readers.matter import Imported, as_it_is, read_matter
from ..readers.raw import BYTE_ORDERS, TYPES, from_json, guessed
from ..readers.source import Options, RawLayout
from . import importing, modal
from .asked import Held
from .import_command import describe
from .jobs import Work
from .places import output_directory

LABEL = "Volume for illumination"
# A dropped text or JSON file is not ours to take; Blender itself opens dropped VDB files.
DROPPED = sorted({Path(f"x{suffix}").suffix for suffix in SUFFIXES} - {".json", ".txt", ".vdb"})
AUTO = "AUTO"
RAW = ("raw_dims", "raw_type", "raw_byte_order", "raw_offset", "raw_spacing")


def _enum(names: tuple[str, ...]) -> list[tuple[str, str, str]]:
    return [(name, name, "") for name in names]


class VOLILLUM_OT_import_volume(modal.WorkOperator, bpy.types.Operator):
    """Open a volume of any format: CT, MRI, microscope stack, simulation, cloud."""

    bl_idname = "volillum.import_volume"
    bl_label = "Import volume"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012 - Blender's own form

    filepath: bpy.props.StringProperty(subtype="FILE_PATH", options={"SKIP_SAVE"})
    directory: bpy.props.StringProperty(subtype="DIR_PATH", options={"SKIP_SAVE", "HIDDEN"})
    files: bpy.props.CollectionProperty(
        type=bpy.types.OperatorFileListElement, options={"SKIP_SAVE", "HIDDEN"}
    )
    filter_glob: bpy.props.StringProperty(
        default=";".join(f"*{suffix}" for suffix in SUFFIXES), options={"HIDDEN", "SKIP_SAVE"}
    )
    confirmed: bpy.props.BoolProperty(options={"HIDDEN", "SKIP_SAVE"})
    level: bpy.props.IntProperty(
        name="Level of detail",
        description="0 reads all voxels, 1 the means of 2 x 2 x 2 of them, 2 of 4 x 4 x 4, ...: a "
        "fast first look at a large file",
        min=0,
        max=MOST_LEVEL,
    )
    channel: bpy.props.IntProperty(
        name="Channel", description="Which of several channels or times, from 0", min=0
    )
    size: bpy.props.EnumProperty(
        name="Size", description="How large the volume is in the scene", items=importing.SIZES
    )
    transfer: bpy.props.EnumProperty(
        name="Transfer function",
        description="How values become matter; it can be changed afterwards",
        items=[(AUTO, "By the kind of data", ""), *_enum(transfer_presets.names())],
    )
    sequence: bpy.props.BoolProperty(
        name="Sequence",
        description="VDB files whose names differ by a number at the end are frames of one volume, "
        "all under one transfer function; off: this file alone",
        default=True,
    )
    raw_dims: bpy.props.IntVectorProperty(
        name="Voxels", description="Along x, y and z; x runs fastest in the file", min=0, size=3
    )
    raw_type: bpy.props.EnumProperty(name="Type", description="Of a voxel", items=_enum(TYPES))
    raw_byte_order: bpy.props.EnumProperty(
        name="Byte order", description="Of larger numbers", items=_enum(tuple(BYTE_ORDERS))
    )
    raw_offset: bpy.props.IntProperty(
        name="Offset", description="Bytes before the first voxel", min=0
    )
    raw_spacing: bpy.props.FloatVectorProperty(
        name="Voxel size", description="Along x, y and z", default=(1, 1, 1), min=1e-6, size=3
    )

    @override
    def prepare(self, context: bpy.types.Context) -> Work[Any]:
        """What is to be read and where it goes; the reading itself knows nothing of Blender."""
        path, held = self._path(), Held(context.scene)
        files = sequence_of(path) if self.sequence else VolumeFiles(path)
        size, level = self.size, self.level
        transfer = None if self.transfer == AUTO else self.transfer
        if as_it_is(files, level, transfer):
            return Work(lambda _control: files, lambda found: _added(held, found))
        several = self.properties.is_property_set("channel")
        options = Options(channel=self.channel if several else None, raw=self._layout(path))
        directory = output_directory(context.scene.volillum.directory)

        def finish(imported: Imported) -> str:
            importing.place(held.get(), imported, size)
            frames = [f"{len(imported.frames)} frames"] if imported.frames else []
            return "; ".join([*frames, describe(imported.about), *imported.about.notes])

        return Work(
            lambda control: read_matter(files, directory, level, options, transfer, control),
            finish,
        )

    @override
    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Ask for what is missing: the file, a raw file's layout; then read it beside the user."""
        manager = context.window_manager
        if context.window is None or self.confirmed:
            return super().invoke(context, event)
        if not (self.filepath or self.files):
            self.confirmed = True
            manager.fileselect_add(self)
            return {"RUNNING_MODAL"}
        try:
            unknown = format_of(self._path()).id == "raw" and self._layout(self._path()) is None
        except InputError as error:
            return self._refuse(error)
        if unknown and guessed(self._path()) is None:
            self.confirmed = True
            result: set[str] = manager.invoke_props_dialog(self, width=360)
            return result
        return super().invoke(context, event)

    @override
    def execute(self, context: bpy.types.Context) -> set[str]:
        """At once for a script; after a dialog once more, as a job."""
        if not self.confirmed or context.window is None:
            return super().execute(context)
        ignored = ("filter_glob", "files", "directory", "channel", "filepath")
        given = self.as_keywords(ignore=ignored)
        if self.properties.is_property_set("channel"):
            given["channel"] = self.channel
        bpy.ops.volillum.import_volume("INVOKE_DEFAULT", filepath=str(self._path()), **given)
        return {"FINISHED"}

    def draw(self, _context: bpy.types.Context) -> None:
        """The file browser's column, or the dialog of a raw file."""
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        for name in ("level", "channel", "size", "transfer", "sequence"):
            layout.prop(self, name)
        path = self._path()
        if path.suffix.lower() != ".raw" or (path.is_file() and guessed(path) is not None):
            return
        box = layout.box()
        box.label(text="Raw file: how to read it", icon="QUESTION")
        for name in RAW:
            box.prop(self, name)
        if path.is_file():
            have, wanted = path.stat().st_size, self._raw_bytes()
            row = box.row()
            row.alert = have != wanted
            row.label(text=f"{wanted} bytes of the file's {have}")

    def _path(self) -> Path:
        """The file, or the first of several that were dropped or chosen."""
        names = sorted(each.name for each in self.files if each.name)
        path = Path(self.directory, names[0]) if names and self.directory else Path(self.filepath)
        return Path(bpy.path.abspath(str(path)))

    def _raw_bytes(self) -> int:
        voxels = math.prod(int(n) for n in self.raw_dims)
        return int(voxels * np.dtype(self.raw_type).itemsize + self.raw_offset)

    def _layout(self, path: Path) -> RawLayout | None:
        if not all(self.raw_dims):
            return None
        entry = {
            "dims": list(self.raw_dims),
            "type": self.raw_type,
            "byte_order": self.raw_byte_order,
            "offset": self.raw_offset,
            "spacing": list(self.raw_spacing),
        }
        return from_json(entry, path)


class VOLILLUM_FH_volume(bpy.types.FileHandler):
    """A file dropped on the 3D view."""

    bl_idname = "VOLILLUM_FH_volume"
    bl_label = LABEL
    bl_import_operator = "volillum.import_volume"
    bl_file_extensions = ";".join(DROPPED)

    @classmethod
    def poll_drop(cls, context: bpy.types.Context) -> bool:
        """Only there: elsewhere a picture is a picture."""
        return context.area is not None and context.area.type == "VIEW_3D"


def _added(held: Held, files: VolumeFiles) -> str:
    item = importing.add_vdb(held.get(), files)
    frames = f", {item.data.frame_duration} frames" if item.data.is_sequence else ""
    return f"{item.name}{frames}"


def _menu(self: bpy.types.Menu, _context: bpy.types.Context) -> None:
    labels = ", ".join(each.label for each in FORMATS[:4])
    self.layout.operator("volillum.import_volume", text=f"{LABEL} ({labels}, ...)")


CLASSES = (VOLILLUM_OT_import_volume, VOLILLUM_FH_volume)


def register_menu() -> None:
    """Add the entry of File > Import."""
    bpy.types.TOPBAR_MT_file_import.append(_menu)


def unregister_menu() -> None:
    """Take it out again."""
    bpy.types.TOPBAR_MT_file_import.remove(_menu)
