"""Applying a transfer function, and its presets as files."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, override

import bpy
from bl_operators.presets import AddPresetBase

from ..core.control import Control
from ..core.errors import InputError
from ..readers.matter import Imported, read_matter
from ..readers.medium_file import apply
from ..readers.sequence import apply_frames
from ..readers.source import Options
from ..readers.transfer_presets import load_file
from . import importing, modal, transfer, work
from .jobs import Work
from .medium_reader import volume_material
from .places import output_directory, relative

# In Blender's own presets folder, and in the extension's.
PRESET_FOLDER = "transfer_functions"
# Words of presets' names that are written in capitals.
ABBREVIATIONS = {"ct", "mri"}


def _material(context: bpy.types.Context) -> bpy.types.Material:
    material = transfer.material_of(context.scene)
    if material is None:
        raise InputError(
            "the scene's volume has no transfer function; expected one that was imported (File > "
            "Import > Volume for illumination) or that was given one (Add a transfer function)"
        )
    return material


class VOLILLUM_OT_apply_transfer(modal.WorkOperator, bpy.types.Operator):
    """Make the volume what the transfer function says: what is rendered, and baked from now on."""

    bl_idname = "volillum.apply_transfer"
    bl_label = "Apply"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012 - Blender's own form

    @override
    def prepare(self, context: bpy.types.Context) -> Work[Any]:
        """Read the ramp; the volume itself is read by the job."""
        material = _material(context)
        name, values = material.name, transfer.source_of(material)
        frames = transfer.frames_of(material)
        function, signature = transfer.read(material), transfer.signature(material)
        volume = work.chosen_volume(context.scene)
        assert volume is not None
        data = volume.data.name
        directory = output_directory(context.scene.volillum.directory)

        def finish(path: Path) -> str:
            if data not in bpy.data.volumes or name not in bpy.data.materials:
                raise InputError(f"volume {data!r} is gone; expected it where the result belongs")
            bpy.data.volumes[data].filepath = relative(path)
            bpy.data.materials[name].volillum.applied = signature
            return f"{data}: {path.name}"

        def compute(control: Control) -> Path:
            if frames:
                return apply_frames(frames, function, directory, control)
            return apply(values, function, directory, control)

        return Work(compute, finish)


class VOLILLUM_OT_add_transfer(modal.WorkOperator, bpy.types.Operator):
    """Give the volume, or every frame of its sequence, a transfer function: a copy of its values is
    kept, and a medium made of them."""

    bl_idname = "volillum.add_transfer"
    bl_label = "Add a transfer function"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012

    @override
    def prepare(self, context: bpy.types.Context) -> Work[Any]:
        """Which files there are; they are read by the job."""
        scene = context.scene
        settings, volume = scene.volillum, work.chosen_volume(scene)
        if volume is None:
            raise InputError("no volume is chosen; expected one to give a transfer function")
        if volume_material(volume) is not None:
            raise InputError(f"{volume.name!r} has a material; expected none (remove it first)")
        if volume.data.library is not None:
            raise InputError(f"{volume.name!r} is linked from a library; expected one of this file "
                             "(Make Local)")  # fmt: skip
        files, data = importing.files_of(volume), volume.data.name
        options = Options(grid=settings.density_grid or None)
        directory = output_directory(settings.directory)

        def finish(imported: Imported) -> str:
            if data not in bpy.data.volumes:
                raise InputError(f"volume {data!r} is gone; expected it where the result belongs")
            importing.give(bpy.data.volumes[data], imported)
            return "; ".join([f"{data}: {imported.medium.name}", *imported.about.notes])

        return Work(
            lambda control: read_matter(files, directory, options=options, control=control),
            finish,
        )


class VOLILLUM_OT_load_transfer(modal.InstantOperator, bpy.types.Operator):
    """Take a transfer function from a preset; Apply makes the volume of it."""

    bl_idname = "volillum.load_transfer"
    bl_label = "Load a transfer function"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012

    filepath: bpy.props.StringProperty(subtype="FILE_PATH", options={"SKIP_SAVE"})
    menu_idname: bpy.props.StringProperty(options={"SKIP_SAVE", "HIDDEN"})

    @override
    def perform(self, context: bpy.types.Context) -> str:
        """A preset of the extension's, or one that was saved."""
        path, material = Path(self.filepath), _material(context)
        if path.suffix == ".json":
            transfer.write(material, load_file(path, transfer.about(material)))
        else:
            # Saved by Blender's preset system: a script that sets the text.
            transfer.from_preset(material, saved(path))
        VOLILLUM_MT_transfer_presets.bl_label = preset_name(str(path))
        return ""


def saved(path: Path) -> dict[str, Any]:
    """The entries of a preset that Blender saved: the text is read, and nothing is run."""
    import ast

    try:
        tree = ast.parse(path.read_text(encoding="utf-8"), str(path))
        for statement in tree.body:
            if isinstance(statement, ast.Assign) and ast.unparse(statement.targets[0]) == TEXT:
                found: dict[str, Any] = json.loads(ast.literal_eval(statement.value))
                return found
    except (OSError, ValueError, SyntaxError) as error:
        raise InputError(f"{path} cannot be read ({error}); expected a transfer function") from None
    raise InputError(f"{path} holds no transfer function; expected one that was saved here")


class VOLILLUM_MT_transfer_presets(bpy.types.Menu):
    """The presets there are: the extension's and the user's own."""

    bl_label = "Presets"
    preset_subdir = PRESET_FOLDER
    preset_operator = "volillum.load_transfer"
    preset_extensions = {".json", ".py"}  # noqa: RUF012

    def draw(self, _context: bpy.types.Context) -> None:
        """As Blender's own menus of presets, with other names."""
        self.path_menu(
            bpy.utils.preset_paths(self.preset_subdir),
            self.preset_operator,
            filter_ext=lambda suffix: suffix.lower() in self.preset_extensions,
            display_name=preset_name,
        )


def preset_name(path: str) -> str:
    """What a preset is called in the menu: `CT bone` for ct_bone.json."""
    words = bpy.path.display_name(Path(path).stem, title_case=False).split()
    words = [word.upper() if word.lower() in ABBREVIATIONS else word for word in words]
    name = " ".join(words)
    return name[:1].upper() + name[1:]


# What a saved preset sets.
MATERIAL, TEXT = "material", "material.volillum.text"


class VOLILLUM_OT_save_transfer(AddPresetBase, bpy.types.Operator):
    """Save the transfer function as a preset, a file that can be given to others, or remove one."""

    bl_idname = "volillum.save_transfer"
    bl_label = "Save a transfer function"
    preset_menu = "VOLILLUM_MT_transfer_presets"
    preset_subdir = PRESET_FOLDER
    preset_defines = [  # noqa: RUF012
        f"{MATERIAL} = bpy.context.scene.volillum.volume.active_material"
    ]
    preset_values = [TEXT]  # noqa: RUF012

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only for a volume that has one."""
        settings = context.scene.volillum
        return settings.volume is not None and transfer.material_of(context.scene) is not None


CLASSES = (
    VOLILLUM_OT_apply_transfer,
    VOLILLUM_OT_add_transfer,
    VOLILLUM_OT_load_transfer,
    VOLILLUM_MT_transfer_presets,
    VOLILLUM_OT_save_transfer,
)
