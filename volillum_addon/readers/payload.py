"""Voxels as one run of bytes, in one file or several, packed or not: read once, in order, exactly.

The libraries that read such headers unpack the whole file at once and trust its length; here only
what the header promises is unpacked, and a missing byte is an error that says where.
"""

from __future__ import annotations

import bz2
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Literal

import numpy as np

from ..core.errors import bad
from .source import Slab, check_unpacked, file_size, unreadable

Packing = Literal["", "deflate", "bzip2"]
# gzip or zlib, whichever the bytes are.
ANY_DEFLATE = 47
CHUNK = 1 << 20


@dataclass(frozen=True)
class Part:
    """A file's data from `offset` on, of which the first `skip` unpacked bytes are passed over."""

    path: Path
    offset: int = 0
    packing: Packing = ""
    skip: int = 0


@dataclass(frozen=True)
class Layout:
    """What the bytes are: `components` numbers a voxel, of which `chosen` is wanted; i fastest.

    With `planar` the channels follow one another as whole volumes instead.
    """

    shape: tuple[int, int, int]
    dtype: np.dtype[np.generic]
    components: int = 1
    chosen: int = 0
    planar: bool = False

    @property
    def layer_bytes(self) -> int:
        """Bytes of one layer of constant k as stored."""
        numbers = self.shape[0] * self.shape[1] * (1 if self.planar else self.components)
        return numbers * self.dtype.itemsize

    @property
    def total_bytes(self) -> int:
        """Bytes from the first voxel to the last one wanted."""
        volumes = self.chosen + 1 if self.planar else 1
        return self.layer_bytes * self.shape[2] * volumes

    @property
    def stored_bytes(self) -> int:
        """Bytes of all channels."""
        return self.layer_bytes * self.shape[2] * (self.components if self.planar else 1)

    def last_bytes(self, files: Sequence[Path]) -> list[Part]:
        """The ends of these files, which hold the voxels in equal shares."""
        each = self.stored_bytes // max(len(files), 1)
        return [Part(file, max(file_size(file) - each, 0)) for file in files]


def slabs(parts: Sequence[Part], layout: Layout) -> Callable[[int], Iterator[Slab]]:
    """A `Source.slabs` of these bytes; checks at once that they can be there."""
    _check_lengths(parts, layout)

    def read(depth: int) -> Iterator[Slab]:
        with _Run(parts, layout.total_bytes) as run:
            nx, ny, nz = layout.shape
            if layout.planar:
                run.pass_over(layout.chosen * layout.layer_bytes * nz)
            components = 1 if layout.planar else layout.components
            for begin in range(0, nz, depth):
                count = min(depth, nz - begin)
                data = run.read(count * layout.layer_bytes)
                values = np.frombuffer(data, layout.dtype)
                layers = values.reshape((components, nx, ny, count), order="F")
                yield layers[0 if layout.planar else layout.chosen]

    return read


def _check_lengths(parts: Sequence[Part], layout: Layout) -> None:
    have = 0
    for part in parts:
        size = file_size(part.path) - part.offset
        if part.packing == "deflate":
            check_unpacked(part.path, layout.total_bytes // len(parts), max(size, 0))
        elif not part.packing:
            have += max(size - part.skip, 0)
    if not any(part.packing for part in parts) and have < layout.total_bytes:
        where = parts[0].path if parts else Path()
        raise bad("its data", f"{have} bytes", f"{layout.total_bytes} ({_described(layout)})",
                  str(where))  # fmt: skip


def _described(layout: Layout) -> str:
    channels = f" x {layout.components} channels" if layout.components > 1 else ""
    return f"{' x '.join(map(str, layout.shape))} voxels{channels} of {layout.dtype.name}"


class _Run:
    """The unpacked bytes of the parts, one after another."""

    def __init__(self, parts: Sequence[Part], wanted: int) -> None:
        self._parts = list(parts)
        self._wanted = wanted
        self._given = 0
        self._file: BinaryIO | None = None
        self._part = self._parts[0] if self._parts else Part(Path())
        self._unpack: zlib._Decompress | bz2.BZ2Decompressor | None = None
        self._left = b""

    def __enter__(self) -> _Run:
        return self

    def __exit__(self, *_: object) -> None:
        if self._file is not None:
            self._file.close()

    def read(self, count: int) -> bytes:
        """Exactly `count` bytes, or an InputError."""
        pieces, missing = [], count
        while missing:
            piece = self._some(missing)
            if not piece:
                raise bad("its data", f"{self._given + count - missing} bytes and then an end",
                          f"{self._wanted} bytes", str(self._part.path))  # fmt: skip
            pieces.append(piece)
            missing -= len(piece)
        self._given += count
        return b"".join(pieces) if len(pieces) != 1 else pieces[0]

    def pass_over(self, count: int) -> None:
        """Read and forget."""
        while count:
            step = min(count, CHUNK)
            self.read(step)
            count -= step

    def _some(self, most: int) -> bytes:
        """1 to `most` bytes; none at the end of the last part."""
        while True:
            if self._file is None:
                if not self._parts:
                    return b""
                self._open(self._parts.pop(0))
            try:
                data = self._unpacked(most)
            except (OSError, EOFError, zlib.error, ValueError) as error:
                raise unreadable(
                    self._part.path, error, f"{self._wanted} bytes of voxels"
                ) from None
            if data:
                return data
            assert self._file is not None
            self._file.close()
            self._file = None

    def _open(self, part: Part) -> None:
        self._part = part
        try:
            self._file = part.path.open("rb")
            self._file.seek(part.offset)
        except OSError as error:
            raise unreadable(part.path, error, "a file of voxels") from None
        self._left = b""
        self._unpack = {"": lambda: None,
                        "deflate": lambda: zlib.decompressobj(ANY_DEFLATE),
                        "bzip2": bz2.BZ2Decompressor}[part.packing]()  # fmt: skip
        skip = part.skip
        while skip:
            passed = len(self._unpacked(min(skip, CHUNK)))
            if not passed:
                raise bad("its data", "over before it begins", f"{part.skip} bytes to skip",
                          str(part.path))  # fmt: skip
            skip -= passed

    def _unpacked(self, most: int) -> bytes:
        assert self._file is not None
        if self._unpack is None:
            return self._file.read(most)
        while not self._unpack.eof:
            if isinstance(self._unpack, bz2.BZ2Decompressor):
                fed = self._file.read(CHUNK) if self._unpack.needs_input else b""
                data = self._unpack.decompress(fed, most)
                ended = self._unpack.needs_input and not fed
            else:
                fed = self._left or self._file.read(CHUNK)
                data = self._unpack.decompress(fed, most)
                self._left = self._unpack.unconsumed_tail
                ended = not fed
            if data or ended:
                return data
        return b""
