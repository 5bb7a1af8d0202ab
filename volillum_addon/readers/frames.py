"""Which files a volume is: one of any format, or those of a sequence, whose names differ by a
number before the suffix, as Blender knows them. On a command line a sequence is `smoke_####.vdb`,
a # for each digit that all numbers have at least, or its files one by one."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import override

from ..core.errors import InputError, bad
from .formats import SUFFIXES, format_of, stem_of

# Blender's last frame.
LAST_FRAME = 1048574
# Things that a complaint names before it says how many more there are.
NAMED = 5
# Formats of which many files are one volume and not a sequence of them.
SLICES = ("dicom", "tiff")

_NUMBERED = re.compile(r"(.*?)([0-9]+)", re.DOTALL)
_HASHED = re.compile(r"([^#]*)(#+)([^#]*)")


@dataclass(frozen=True, eq=False)
class VolumeFiles:
    """One file (or folder) of any format, or the files of a sequence by frame, the first of which
    is `path`; and what the volume is called by, if not by its files."""

    path: Path
    frames: Mapping[int, Path] = field(default_factory=dict)
    called: str = ""

    @property
    def stem(self) -> str:
        """What the volume is called by: of a sequence, what its files' names have in common."""
        if self.called:
            return self.called
        name = Name.of(self.path) if self.frames else None
        return name.label if name else stem_of(self.path)

    @property
    def label(self) -> str:
        """The same for messages: the file's own name, or the sequence's."""
        return f"{self.stem}, {len(self.frames)} frames" if self.frames else self.path.name


@dataclass(frozen=True)
class Name:
    """What the names of a sequence's files have in common: all but the frame's number, which has
    `digits` digits at least."""

    folder: Path
    before: str
    digits: int
    after: str

    @classmethod
    def of(cls, path: Path) -> Name | None:
        """The name of a file with a number before its suffix; None where there is none."""
        stem = stem_of(path)
        found = _NUMBERED.fullmatch(stem)
        return found and cls(path.parent, found[1], len(found[2]), path.name[len(stem) :])

    @classmethod
    def hashed(cls, path: Path) -> Name | None:
        """The name with # for the number; None where there are none, or a file is called so.
        Raises InputError where they are not before a format's suffix."""
        if "#" not in path.name or path.exists():
            return None
        found = _HASHED.fullmatch(path.name)
        if found is None or found[3].lower() not in SUFFIXES:
            raise bad("a sequence's name", repr(path.name), "one # for each digit of the frame's "
                      "number, right before the suffix, as in smoke_####.vdb")  # fmt: skip
        return cls(path.parent, found[1], len(found[2]), found[3])

    @property
    def label(self) -> str:
        """A word for the sequence."""
        return self.before.rstrip("._-") or self.folder.name or "frames"

    @property
    def where(self) -> str:
        """The folder, for messages."""
        return str(self.folder.absolute())

    @override
    def __str__(self) -> str:
        return f"{self.before}{'#' * self.digits}{self.after}"

    def file(self, frame: int) -> Path:
        """The file of a frame."""
        return self.folder / f"{self.before}{frame:0{self.digits}d}{self.after}"

    def number(self, path: Path) -> str | None:
        """The digits in a file's name, of any length; None where it is called otherwise."""
        text = path.name[len(self.before) : len(path.name) - len(self.after)]
        named = path.name == f"{self.before}{text}{self.after}"
        return text if named and text.isascii() and text.isdecimal() else None

    def frames(self, paths: Iterable[Path]) -> dict[int, Path]:
        """Those of the files that are of this sequence, by frame."""
        numbers = {int(text) for path in paths if (text := self.number(path))
                   if self.file(int(text)).name == path.name}  # fmt: skip
        return {frame: self.file(frame) for frame in sorted(numbers)}

    def fitted(self, paths: Sequence[Path]) -> Name:
        """With as few digits as these files have: smoke_10.vdb may come after smoke_9.vdb."""
        lengths = [len(text) for path in paths if (text := self.number(path)) and text[0] != "0"]
        return Name(self.folder, self.before, min([self.digits, *lengths]), self.after)


def sequence_of(path: Path) -> VolumeFiles:
    """The unbroken sequence that a VDB file belongs to, or the file alone. Raises InputError for a
    file that is not there."""
    name = Name.of(path) if format_of(path).id == "vdb" else None
    if name is None:
        return VolumeFiles(path)
    files, own = _files(path.parent), name.number(path) or ""
    there = (name if own.startswith("0") else name.fitted(files)).frames(files)
    first = last = int(own)
    while first - 1 in there:
        first -= 1
    while last + 1 in there:
        last += 1
    if first == last or last > LAST_FRAME:
        return VolumeFiles(path)
    return VolumeFiles(there[first], {frame: there[frame] for frame in range(first, last + 1)})


def chosen(paths: Sequence[Path], frames: range | None = None) -> VolumeFiles:
    """What a command line names: a file, a sequence as `smoke_####.vdb`, or its files one by one;
    of a sequence only these `frames` where they are given.

    Raises InputError where no file has such a name, a frame is missing, or the files are not of one
    sequence.
    """
    first = paths[0]
    name = Name.hashed(first) if len(paths) == 1 else Name.of(first)
    if len(paths) > 1:
        name = name and name.fitted(paths)
        there = name.frames(paths) if name else {}
        if name is None or {*there.values()} != {*paths}:
            raise bad("the volume", f"{len(paths)} files ({_some(paths)})", "one, or those of a "
                      "sequence, whose names differ by a number before the suffix")  # fmt: skip
    elif name is not None:
        there = name.frames(_files(name.folder))
        if not there:
            others = [path for path in _files(name.folder) if path.name.endswith(name.after)]
            raise bad(f"what {name} names", f"no file (there {_are(others)})",
                      f"files such as {name.file(1).name}", name.where)  # fmt: skip
    elif frames is None:
        return VolumeFiles(first)
    else:
        raise bad("what to take frames of", f"{first.name}, one file", "a sequence, as "
                  "smoke_####.vdb, or no --frames")  # fmt: skip
    return _complete(name, there, frames or range(min(there), max(there) + 1))


def _complete(name: Name, there: Mapping[int, Path], wanted: range) -> VolumeFiles:
    if format_of(next(iter(there.values()))).id in SLICES:
        raise bad("the volume", f"{len(there)} files of slices ({name})", "their folder, which is "
                  "read as one volume", name.where)  # fmt: skip
    missing = [name.file(frame) for frame in wanted if frame not in there]
    if missing:
        raise bad(f"sequence {name}", f"without {_some(missing)}", f"every frame from {wanted[0]} "
                  f"to {wanted[-1]} (or fewer by --frames A-B)", name.where)  # fmt: skip
    if wanted[-1] > LAST_FRAME:
        raise bad(f"the last frame of {name}", wanted[-1], f"at most {LAST_FRAME}, Blender's last "
                  "(give the files other numbers)", name.where)  # fmt: skip
    return VolumeFiles(there[wanted[0]], {frame: there[frame] for frame in wanted})


def _files(folder: Path) -> list[Path]:
    try:
        return sorted(folder.iterdir())
    except OSError as error:
        raise InputError(f"{folder} cannot be read ({error.strerror}); expected a folder") from None


def _some(paths: Sequence[Path]) -> str:
    names = [path.name for path in paths[:NAMED]]
    return ", ".join(names) + (f" and {len(paths) - NAMED} more" if len(paths) > NAMED else "")


def _are(paths: Sequence[Path]) -> str:
    return f"are {_some(paths)}" if paths else "are none of this suffix"
