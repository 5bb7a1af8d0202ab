"""The outer layout of a .vdb file: metadata and where each grid ends.

OpenVDB's writer does not notice a full disk, and its reader does not notice that the last bytes of
a file are missing. Both show in the table of grids: each one's end is written after its data. See
openvdb/io/Archive.cc (header) and io/GridDescriptor.cc (per grid).
"""

from __future__ import annotations

import os
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from ..core.errors import InputError, bad

MAGIC = 0x56444220
UUID_LENGTH = 36
# Before this version the header's flags are laid out differently (OpenVDB 1.0, 2012).
OLDEST_VERSION = 222
# Longer names or more entries than this mean that the bytes are not what they seem.
LONGEST_NAME, MOST_ENTRIES = 1 << 16, 1 << 16


@dataclass(frozen=True)
class Text:
    """A string of the file's metadata: its bytes' place, and the value."""

    offset: int
    value: str


def metadata(path: Path) -> dict[str, Text]:
    """The file's own strings by name. Raises InputError when this is no VDB file."""
    with _open(path) as file:
        return _header(file, path)[0]


def check_whole(path: Path) -> None:
    """Raise an InputError when a grid does not end within the file (or this is no VDB file).

    A streamed or very old file has no table of grids and cannot be checked: it passes.
    """
    with _open(path) as file:
        size = os.fstat(file.fileno()).st_size
        if not _header(file, path)[1]:
            return
        count = _integer(file, "<i", path)
        if not 0 <= count <= MOST_ENTRIES:
            raise _cut(path, size, "a table of grids")
        for _ in range(count):
            for _ in range(3):  # name, type, instance parent
                _string(file, path)
            begin = file.tell()
            _, _, end = (_integer(file, "<q", path) for _ in range(3))
            if not begin < end <= size:
                raise _cut(path, size, f"{end} bytes" if end > size else "a table of grids")
            file.seek(end)


def _header(file: BinaryIO, path: Path) -> tuple[dict[str, Text], bool]:
    """The file's strings, and whether a table of grids follows."""
    if _integer(file, "<q", path) != MAGIC:
        raise bad(f"{path}", "not a VDB file", "an OpenVDB file (.vdb)")
    version = _integer(file, "<I", path)
    file.seek(8, 1)  # the writing library's version
    if version < OLDEST_VERSION:
        return {}, False
    has_table = _integer(file, "<b", path) == 1
    file.seek(UUID_LENGTH, 1)
    found: dict[str, Text] = {}
    for _ in range(min(_integer(file, "<I", path), MOST_ENTRIES)):
        name, kind = _string(file, path), _string(file, path)
        length = _integer(file, "<I", path)
        offset = file.tell()
        if kind == "string":
            found[name] = Text(offset, _exactly(file, length, path).decode(errors="replace"))
        else:
            file.seek(length, 1)
    return found, has_table


def _open(path: Path) -> BinaryIO:
    try:
        return path.open("rb")
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror}; expected a VDB file") from None


def _exactly(file: BinaryIO, count: int, path: Path) -> bytes:
    # No more than there is: reading allocates first, and a damaged length may be anything.
    data = file.read(min(count, max(os.fstat(file.fileno()).st_size - file.tell(), 0)))
    if len(data) != count:
        if file.tell() < struct.calcsize("<q"):
            raise bad(f"{path}", "not a VDB file", "an OpenVDB file (.vdb)")
        raise _cut(path, file.tell(), "more")
    return data


def _integer(file: BinaryIO, form: str, path: Path) -> int:
    value = struct.unpack(form, _exactly(file, struct.calcsize(form), path))[0]
    assert isinstance(value, int)
    return value


def _string(file: BinaryIO, path: Path) -> str:
    length = _integer(file, "<I", path)
    if length > LONGEST_NAME:
        raise _cut(path, file.tell(), "a shorter name in its table")
    return _exactly(file, length, path).decode(errors="replace")


def _cut(path: Path, size: int, expected: str) -> InputError:
    return InputError(f"{path} is cut off or damaged at {size} bytes; expected {expected}")
