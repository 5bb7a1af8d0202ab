"""A demonstration scene from a volume and a preset: sun, sky, camera, a plain readable material."""

from __future__ import annotations

import math
from pathlib import Path

import bpy
import numpy as np
from mathutils import Matrix

from ..bake.grids import grid_names
from ..bake.store import complain, prepare
from ..core.control import Control
from ..core.errors import bad
from ..readers.frames import VolumeFiles
from ..readers.matter import Imported
from ..readers.medium_file import EMISSION, is_medium
from . import importing, preset_objects
from .extent import Extent, extent_of
from .medium_builder import medium_material
from .scene_presets import Axis, ScenePreset, Substance


def check_target(target: Path) -> None:
    """Raise an InputError for a name that no scene's file has."""
    if target.suffix != ".blend":
        raise bad("the scene's file", repr(target.name), "a name that ends in .blend")


def save_scene(
    files: VolumeFiles,
    preset: ScenePreset,
    target: Path,
    grid: str | None = None,
    imported: Imported | None = None,
    control: Control | None = None,
) -> None:
    """Make the scene in a new, empty file and save it as the .blend `target`: of VDB files by the
    grid named (`density`, or the first), or of what was `imported` with its transfer function. A
    sequence's frames are those of the scene.

    What was open in this Blender is left, as by File > New. Raises InputError for an unusable
    volume, StorageError for a target that cannot be written, Cancelled.
    """
    check_target(target)
    save_scene_of(files, extent_of(files, grid, control or Control()), preset, target, imported)


def save_scene_of(
    files: VolumeFiles,
    extent: Extent,
    preset: ScenePreset,
    target: Path,
    imported: Imported | None = None,
) -> None:
    """`save_scene` for a volume that is read already. A preset without a medium is for files that
    bring one (readers/medium_file.py)."""
    target = target.absolute()
    prepare(target.parent)
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    data = build_scene(bpy.context.scene, files, extent, preset, imported is None)
    if imported is not None:
        importing.give(data, imported, target.parent)
    _look_through_the_camera()
    # Saved beside its final place, so that relative paths in it hold after the rename.
    temporary = target.with_name(f".{target.stem}.partial.blend")
    try:
        bpy.ops.wm.save_as_mainfile(filepath=str(temporary), relative_remap=True, copy=True)
        temporary.replace(target)
    except (OSError, RuntimeError) as error:
        raise complain(target.parent, temporary) from error
    finally:
        temporary.unlink(missing_ok=True)


def build_scene(
    scene: bpy.types.Scene,
    files: VolumeFiles,
    extent: Extent,
    preset: ScenePreset,
    material: bool = True,
) -> bpy.types.Volume:
    """Fill an empty scene; the volume, which is given a `material` or will be."""
    name = files.stem
    upright = _upright(preset.up)
    scene.name = name
    data = bpy.data.volumes.new(name)
    data.filepath = str(files.path.absolute())
    if files.frames:
        importing.play(data, tuple(files.frames))
        scene.frame_start, scene.frame_end = min(files.frames), max(files.frames)
        scene.frame_current = scene.frame_start
    if material:
        data.materials.append(_material(name, files.path, extent, preset.medium))
    body = bpy.data.objects.new(name, data)
    body.matrix_world = upright
    sun = preset_objects.sun(preset)
    camera = preset_objects.camera(extent.points @ np.array(upright)[:3, :3].T, preset)
    for item in (body, sun, camera):
        scene.collection.objects.link(item)
    scene.world = preset_objects.sky(preset)
    scene.camera = camera
    _image(scene, preset)
    return data


def _look_through_the_camera() -> None:
    """Let every 3D view of the file open on what will be rendered, quickly: EEVEE, in the scene's
    own light. A rendered view would start Cycles' full scattering as soon as the file is open."""
    for screen in bpy.data.screens:
        spaces = (space for area in screen.areas for space in area.spaces)
        for space in spaces:
            if space.type == "VIEW_3D":
                space.region_3d.view_perspective = "CAMERA"
                space.shading.type = "MATERIAL"
                space.shading.use_scene_lights = space.shading.use_scene_world = True


def _upright(up: Axis) -> Matrix:
    """The rotation that turns the file's `up` axis to z and keeps right-handedness."""
    turns = {
        "x": Matrix.Rotation(-math.pi / 2, 4, "Y"),
        "y": Matrix.Rotation(math.pi / 2, 4, "X"),
        "z": Matrix.Identity(4),
        "-x": Matrix.Rotation(math.pi / 2, 4, "Y"),
        "-y": Matrix.Rotation(-math.pi / 2, 4, "X"),
        "-z": Matrix.Rotation(math.pi, 4, "X"),
    }
    return turns[up]


def _material(
    name: str, volume: Path, extent: Extent, medium: Substance | None
) -> bpy.types.Material:
    """What the file brings, or else Principled Volume with black absorption colour: sigma_t =
    density, albedo = colour."""
    if is_medium(volume):
        return medium_material(name, glows=EMISSION in grid_names(volume))
    if medium is None:
        raise bad("the preset's medium", "missing", f"one for {name}, which brings none")
    material = bpy.data.materials.new(name)
    tree = material.node_tree
    tree.nodes.clear()
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    shader = tree.nodes.new("ShaderNodeVolumePrincipled")
    shader.location = (-320, 0)
    shader.inputs["Density Attribute"].default_value = extent.grid
    shader.inputs["Density"].default_value = medium.optical_depth / extent.column
    shader.inputs["Color"].default_value = (*medium.albedo, 1)
    shader.inputs["Absorption Color"].default_value = (0, 0, 0, 1)
    tree.links.new(shader.outputs["Volume"], output.inputs["Volume"])
    return material


def _image(scene: bpy.types.Scene, preset: ScenePreset) -> None:
    scene.render.engine = "CYCLES"
    scene.render.resolution_x = preset.image.width
    scene.render.resolution_y = preset.image.height
    scene.render.resolution_percentage = 100
    scene.render.film_transparent = preset.image.background == "transparent"
