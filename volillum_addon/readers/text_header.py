"""Headers of lines `key = value`, before which or in which the voxels' bytes may follow."""

from __future__ import annotations

import re
from pathlib import Path

from ..core.errors import InputError, bad
from .source import unreadable

# Longer headers are not headers.
LONGEST_HEADER = 1 << 20


def numbers[T: (int, float)](
    text: str, kind: type[T], count: int, what: str, path: Path
) -> list[T]:
    """`count` numbers separated by blanks or commas."""
    try:
        found = [kind(part) for part in re.split(r"[\s,]+", text.strip()) if part]
    except (ValueError, OverflowError):
        raise bad(what, repr(text[:80]), f"{count} numbers", str(path)) from None
    if len(found) != count:
        raise bad(what, repr(text[:80]), f"{count} numbers", str(path))
    return found


def head(path: Path, size: int = LONGEST_HEADER) -> bytes:
    """The file's first bytes."""
    try:
        with path.open("rb") as file:
            return file.read(size)
    except OSError as error:
        raise unreadable(path, error, "a file") from None


def beside(path: Path, name: str) -> Path:
    """The data file `name` of a header at `path`: in the header's folder or below.

    A header from elsewhere must not make us read any file of the machine.
    """
    target = Path(name.replace("\\", "/"))
    if target.is_absolute() or ".." in target.parts or "\0" in name:
        raise bad(f"{path.name}'s data file", repr(name), "a file beside the header", str(path))
    found = path.parent / target
    if not found.is_file():
        raise InputError(f"{path.name} names the data file {name!r}, which is not there; expected "
                         f"it in {path.parent}")  # fmt: skip
    return found
