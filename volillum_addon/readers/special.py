"""Small formats of well-known volumes: vtk.js image data, VolVis .slc, VolPack .den."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ..core.errors import InputError, bad
from . import payload
from .payload import Layout, Part
from .source import (
    Options,
    Slab,
    Source,
    affine,
    check_shape,
    check_unpacked,
    choose_channel,
    file_size,
    library,
)
from .text_header import head, numbers

ARRAYS = {"Int8Array": "i1", "Uint8Array": "u1", "Uint8ClampedArray": "u1", "Int16Array": "i2",
          "Uint16Array": "u2", "Int32Array": "i4", "Uint32Array": "u4", "Float32Array": "f4",
          "Float64Array": "f8"}  # fmt: skip
# VolPack's header: 29 numbers of 16 bits, the last 4 bytes a length in one of 32.
DEN_HEADER, DEN_SIZES = 62, 44
SLC_MAGIC, SLC_PLAIN, SLC_RUNS = b"11111", 0, 1


def read_vtkjs(path: Path, options: Options) -> Source:
    """vtk.js' index.json (or its folder): `direction` lists the world directions of the index axes
    one after another; the arrays lie in files beside it, packed or not."""
    index = path / "index.json" if path.is_dir() else path
    with library(index, "an index.json of vtk.js"):
        header = json.loads(head(index))
        arrays = [each["data"] for each in header["pointData"]["arrays"]]
        extent = [int(n) for n in header["extent"]]
        if len(extent) != 6 or not arrays:
            raise ValueError("no image of three dimensions")
        data = arrays[0]
        shape = tuple(extent[2 * a + 1] - extent[2 * a] + 1 for a in range(3))
        reference = data["ref"]
        names = [f"{reference['basepath']}/{reference['id']}", str(reference["id"])]
        order = ">" if reference["encode"] == "BigEndian" else "<"
        dtype = np.dtype(order + ARRAYS[data["dataType"]])
        components = int(data["numberOfComponents"])
        direction = header.get("direction", np.eye(3).ravel().tolist())
        matrix = affine(direction, header["spacing"], header["origin"], index)
        matrix[:3, 3] += matrix[:3, :3] @ np.array(extent[::2], np.float64)
    check_shape(shape, index)
    if any(".." in Path(name).parts or Path(name).is_absolute() for name in names):
        raise bad("its data's place", repr(names[0]), "a file beside it", str(index))
    places = [index.parent / f"{name}{suffix}" for name in names for suffix in ("", ".gz")]
    file = next((place for place in places if place.is_file()), None)
    if file is None:
        raise InputError(f"{index} names the data file {names[0]!r}, which is not there; expected "
                         f"it in {index.parent}")  # fmt: skip
    if components < 1:
        raise bad("its components", components, "at least 1", str(index))
    layout = Layout((shape[0], shape[1], shape[2]), dtype, components,
                    choose_channel(components, options, index))  # fmt: skip
    part = Part(file, 0, "deflate" if file.suffix == ".gz" else "")
    return Source(index, "vtk.js", layout.shape, matrix, dtype, payload.slabs([part], layout))


def read_den(path: Path, _options: Options) -> Source:
    """VolPack's .den: a header of 16-bit numbers in either byte order, then 8-bit voxels."""
    start = head(path, DEN_HEADER)
    order = next((o for o in "<>" if start[:2] == np.array(1, f"{o}i2").tobytes()), None)
    if order is None or len(start) < DEN_HEADER:
        raise bad(str(path), "not a VolPack volume", "one that begins with its version, 1")
    lows_highs = np.frombuffer(start, f"{order}i2", 28, 2).astype(int)
    # Three boxes of lowest, highest and sizes: the scan, what was cut out, what is stored.
    nx, ny, nz = (int(n) for n in lows_highs[24:27])
    check_shape((nx, ny, nz), path)
    layout = Layout((nx, ny, nz), np.dtype(np.uint8))
    length = int(np.frombuffer(start, f"{order}i4", 1, DEN_HEADER - 4)[0])
    if length != layout.total_bytes:
        raise bad("its length", length, f"{layout.total_bytes} for {nx} x {ny} x {nz}", str(path))
    slabs = payload.slabs([Part(path, DEN_HEADER)], layout)
    return Source(path, "VolPack", layout.shape, np.eye(4), layout.dtype, slabs)


def read_slc(path: Path, _options: Options) -> Source:
    """VolVis' .slc of 8-bit voxels, its slices plain or run-length coded."""
    data = head(path, file_size(path))
    lines = data.split(b"\n", 4)
    if len(lines) < 5 or lines[0].strip() != SLC_MAGIC:
        raise bad(str(path), "not a VolVis volume", f"one that begins with {SLC_MAGIC.decode()}")
    sizes, lengths, words = (line.decode("latin-1") for line in lines[1:4])
    nx, ny, nz, bits = numbers(sizes, int, 4, "its sizes", path)
    spacing = numbers(lengths, float, 3, "its spacing", path)
    coding = numbers(words, int, 4, "its types", path)[3]
    check_shape((nx, ny, nz), path)
    if bits != 8 or coding not in (SLC_PLAIN, SLC_RUNS):
        raise bad("its voxels", f"of {bits} bits, coding {coding}",
                  "of 8 bits, plain (0) or in runs (1)", str(path))  # fmt: skip
    check_unpacked(path, nx * ny * nz, len(data))
    begin = sum(len(line) + 1 for line in lines[:4])
    icon = numbers(data[begin : begin + 64].split(b"X")[0].decode("latin-1"), int, 2, "its icon",
                   path)  # fmt: skip
    if min(icon) < 0:
        raise bad("its icon's size", icon, "0 or more", str(path))
    begin = data.find(b"X", begin) + 1 + 3 * math.prod(icon)

    def slabs(depth: int) -> Iterator[Slab]:
        place = begin
        for first in range(0, nz, depth):
            layers = []
            for k in range(first, min(first + depth, nz)):
                layer, place = _slice(data, place, nx * ny, coding, k, path)
                layers.append(layer.reshape(ny, nx).T)
            yield np.stack(layers, axis=-1)

    return Source(path, "VolVis", (nx, ny, nz), affine(np.eye(3), spacing, np.zeros(3), path),
                  np.dtype(np.uint8), slabs)  # fmt: skip


def _slice(
    data: bytes, place: int, count: int, coding: int, k: int, path: Path
) -> tuple[np.ndarray, int]:
    """The voxels of one slice, and where the next begins."""
    coded, after = data[place : place + count], place + count
    if coding == SLC_RUNS:
        end = data.find(b"X", place, place + 32)
        length = data[place:end].strip() if end >= 0 else b""
        if not length.isdigit():
            raise bad(f"slice {k}'s length", repr(data[place : place + 16]), "a number and X",
                      str(path))  # fmt: skip
        after = end + 1 + int(length)
        coded = _runs(data[end + 1 : after], count)
    if len(coded) != count:
        raise bad(f"slice {k}", f"{len(coded)} voxels", str(count), str(path))
    return np.frombuffer(coded, np.uint8), after


def _runs(coded: bytes, count: int) -> bytes:
    """Run lengths: the high bit says literal bytes, otherwise one byte is repeated; 0 ends."""
    out = bytearray()
    place = 0
    while place < len(coded) and (length := coded[place] & 0x7F) and len(out) <= count:
        if coded[place] & 0x80:
            out += coded[place + 1 : place + 1 + length]
            place += 1 + length
        else:
            out += coded[place + 1 : place + 2] * length
            place += 2
    return bytes(out)
