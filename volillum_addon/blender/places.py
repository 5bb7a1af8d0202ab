"""Where files go: the user's output directory."""

from __future__ import annotations

from pathlib import Path

import bpy

from ..core.errors import InputError

FOLDER = "volillum"


def output_directory(setting: str) -> Path:
    """The directory that the setting means; the extension's own where the file is not saved yet.

    Raises InputError when it is relative to a file that is not saved and there is no such place.
    """
    if not setting:
        raise InputError("the output directory is empty; expected a directory to write to")
    if not setting.startswith("//") or bpy.data.filepath:
        return Path(bpy.path.abspath(setting))
    root = __package__.split(".")[:3]
    if root[0] != "bl_ext":
        raise InputError(
            f"the output directory is {setting}, beside a file that is not saved; expected a saved "
            "file or an absolute directory"
        )
    return Path(bpy.utils.extension_path_user(".".join(root), path=FOLDER, create=True))


def relative(path: Path, folder: Path | None = None) -> str:
    """The path as Blender keeps it: relative to the file, or the folder that it will be saved in,
    where there is one."""
    if not bpy.data.filepath and folder is None:
        return str(path)
    try:
        return str(bpy.path.relpath(str(path), start=None if folder is None else str(folder)))
    except ValueError:  # another drive
        return str(path)


def block_file(data: bpy.types.Volume) -> Path:
    """The file that a volume data-block names, which may be linked from a library."""
    return Path(bpy.path.abspath(data.filepath, library=data.library))


def keep_found(scene: bpy.types.Scene) -> None:
    """Keep where the last two bakes are found now: before what is shown, which tells it, goes."""
    settings = scene.volillum
    if not settings.baked.path:
        return
    folder = baked_file(scene).parent
    for kept in (settings.baked, settings.other):
        path = folder / Path(bpy.path.abspath(kept.path)).name
        if not Path(bpy.path.abspath(kept.path)).is_file() and path.is_file():
            kept.path = relative(path)


def baked_file(scene: bpy.types.Scene) -> Path:
    """The file of the scene's last bake (of a sequence, the first one). Where it is not as it was
    kept (a file that was saved elsewhere, an appended scene), it is beside what is shown, whose
    path Blender itself takes along."""
    baked = scene.volillum.baked
    path = Path(bpy.path.abspath(baked.path))
    if not path.is_file() and baked.shown is not None:
        beside = block_file(baked.shown.data).with_name(path.name)
        if beside.is_file():
            return beside
    return path
