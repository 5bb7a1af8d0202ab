"""The files of a sequence: names that end in _<frame>.vdb, which Blender plays as one."""

from __future__ import annotations

import re
from pathlib import Path

from ..core.errors import InputError, bad

# How Blender finds the number of a sequence's frame, at the end of a file's stem.
NUMBERED = re.compile(r"^(?P<name>.*)_(?P<frame>\d+)$")


def frame_of(file: Path) -> int:
    """The number of the frame that the file is of."""
    return int(_numbered(file)["frame"])


def name_of(file: Path) -> str:
    """What the files of the sequence have in common, without the underscore."""
    return _numbered(file)["name"]


def frame_file(file: Path, frame: int) -> Path:
    """The file of another frame of the same sequence."""
    match = _numbered(file)
    return file.with_name(f"{match['name']}_{frame:0{len(match['frame'])}d}{file.suffix}")


def numbered(directory: Path, name: str, frame: int) -> Path:
    """The VDB file of a frame."""
    return directory / f"{name}_{frame:04d}.vdb"


def files(first: Path) -> dict[int, Path]:
    """The files of the sequence that begins with `first`, by frame, up to the first gap."""
    found, frame = {}, frame_of(first)
    while (path := frame_file(first, frame)).is_file():
        found[frame] = path
        frame += 1
    if not found:
        raise InputError(f"{first} is not there; expected the first file of a sequence")
    return found


def _numbered(file: Path) -> re.Match[str]:
    match = NUMBERED.match(file.stem)
    if match is None:
        raise bad("a sequence's file", file.name, "a name that ends in _<frame>.vdb")
    return match
