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
