"""Files that are nothing but voxels: `.raw` with its layout given, in a JSON file beside it, or in
its name as `name_256x256x128_uint8.raw`; and NumPy arrays, which know their own type and size.

The sidecar is `name.json` or `name.raw.json`, an object of:

    dims, type               sizes along x, y, z; uint8, int16, float32, ... (a NumPy array's own)
    byte_order               "little" (the default) or "big"
    offset                   bytes before the first voxel
    spacing, origin          three numbers each, in length_unit
    direction                nine: the world directions of the axes, one after another
    axes                     "xyz": x is fastest, "zyx": slowest (NumPy: [x, y, z] or [z, y, x])
    slope, intercept         value = stored * slope + intercept
    unit, length_unit, kind  words
"""

from __future__ import annotations

import json
import math
import re
import zipfile
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..core.errors import bad
from . import payload
from .layers import sliced
from .payload import Layout, Part
from .source import (
    BoundedFile,
    Options,
    RawLayout,
    Slab,
    Source,
    affine,
    check_number_type,
    check_shape,
    check_unpacked,
    choose_channel,
    file_size,
    library,
)
from .text_header import head

TYPES = ("uint8", "int8", "uint16", "int16", "uint32", "int32", "uint64", "int64", "float16",
         "float32", "float64")  # fmt: skip
BYTE_ORDERS = {"little": "<", "big": ">"}
NAME = re.compile(r"_(\d+)x(\d+)x(\d+)_([a-z]+\d+)$")
WORDS = ("unit", "length_unit", "kind")
# The sidecar's entries and how many numbers each is; 0 for one alone.
NUMBERS = {"dims": 3, "offset": 0, "spacing": 3, "origin": 3, "direction": 9, "slope": 0,
           "intercept": 0}  # fmt: skip


def read(path: Path, options: Options) -> Source:
    """The volume of a raw file; its layout from `options`, its sidecar or its name."""
    layout = options.raw or guessed(path)
    if layout is None:
        raise bad(path.name, "a raw file of unknown layout",
                  "sizes and a type: in the import's settings (--dims, --type), in "
                  f"{path.stem}.json, or in its name (volume_256x256x128_uint8.raw)")  # fmt: skip
    check_shape(layout.shape, path)
    wanted = math.prod(layout.shape) * layout.dtype.itemsize + layout.offset
    if file_size(path) != wanted:
        size = " x ".join(map(str, layout.shape))
        raise bad(path.name, f"{file_size(path)} bytes long",
                  f"{wanted} for {size} voxels of {layout.dtype.name} after {layout.offset} bytes",
                  str(path))  # fmt: skip
    if layout.axes == "xyz":
        parts = [Part(path, layout.offset)]
        slabs = payload.slabs(parts, Layout(layout.shape, layout.dtype))
    else:
        with library(path, "a raw file"):
            values = np.memmap(path, layout.dtype, "r", layout.offset, layout.shape)
        slabs = sliced(values)
    return _source(path, "raw", layout, slabs)


def read_numpy(path: Path, options: Options) -> Source:
    """An array of a .npy or .npz file, [x, y, z] unless a sidecar says zyx; a fourth axis, first or
    last, is of channels."""
    with library(path, "a NumPy file of numbers"):
        array = _member(path, options.grid) if path.suffix == ".npz" else _mapped(path)
    check_number_type(array.dtype, path)
    if array.ndim == 4:
        last = array.shape[3] <= 4
        channel = choose_channel(array.shape[3 if last else 0], options, path)
        array = array[..., channel] if last else array[channel]
    check_shape(array.shape, path)
    layout = guessed(path, array)
    assert layout is not None
    if layout.axes == "zyx":
        array = array.T
    return _source(path, "NumPy", layout, sliced(array))


def guessed(path: Path, array: Slab | None = None) -> RawLayout | None:
    """What a file's sidecar, or else its name, tells of it; `array` is what is known already."""
    for name in (f"{path.name}.json", f"{path.stem}.json"):
        sidecar = path.with_name(name)
        if sidecar.is_file() and sidecar != path:
            return from_json(_json(sidecar), sidecar, array)
    if array is not None:
        return from_json({}, path, array)
    found = NAME.search(path.stem)
    if found is None:
        return None
    entry = {"dims": [int(found[n]) for n in (1, 2, 3)], "type": found[4]}
    return from_json(entry, path)


def from_json(entry: Mapping[str, Any], path: Path, array: Slab | None = None) -> RawLayout:
    """A layout of a sidecar's entries. Raises InputError."""
    entry = dict(entry)
    order = entry.pop("byte_order", "little")
    if order not in BYTE_ORDERS:
        raise bad("byte_order", repr(order), "little or big", str(path))
    axes = entry.get("axes", "xyz")
    if axes not in ("xyz", "zyx"):
        raise bad("axes", repr(axes), "xyz or zyx", str(path))
    if array is not None:
        sizes = array.shape[::-1] if axes == "zyx" else array.shape
        entry.update(dims=list(sizes), type=array.dtype.name)
    known = {*NUMBERS, *WORDS, "type", "axes"}
    if unknown := sorted(set(entry) - known):
        raise bad("its entries", ", ".join(unknown), "some of " + ", ".join(sorted(known)),
                  str(path))  # fmt: skip
    for name in ("dims", "type"):
        if name not in entry:
            raise bad(f"its {name}", "missing", "an entry", str(path))
    if entry["type"] not in TYPES:
        raise bad("its type", repr(entry["type"]), "one of " + ", ".join(TYPES), str(path))
    fields: dict[str, Any] = {"axes": axes}
    for name in set(entry) & set(NUMBERS):
        fields[name] = _numbers(name, entry[name], path)
    for name in set(entry) & set(WORDS):
        fields[name] = str(entry[name])
    dims = tuple(int(n) for n in fields.pop("dims"))
    if fields.get("offset", 0) < 0:
        raise bad("its offset", fields["offset"], "0 or more", str(path))
    fields["offset"] = int(fields.get("offset", 0))
    dtype = np.dtype(entry["type"]).newbyteorder(BYTE_ORDERS[order])
    return RawLayout(shape=(dims[0], dims[1], dims[2]), dtype=dtype, **fields)


def _numbers(name: str, value: object, path: Path) -> Any:
    count = NUMBERS[name]
    given = value if isinstance(value, list | tuple) else [value]
    plain = all(isinstance(each, int | float) and not isinstance(each, bool) for each in given)
    if len(given) != max(count, 1) or not plain or not all(map(math.isfinite, given)):
        raise bad(f"its {name}", repr(value)[:80], f"{count or 1} finite numbers", str(path))
    return tuple(given) if count else given[0]


def _json(path: Path) -> Mapping[str, Any]:
    try:
        found = json.loads(head(path))
    except (ValueError, RecursionError) as error:
        raise bad(str(path), f"not JSON ({error})", "a sidecar of a raw file") from None
    if not isinstance(found, dict):
        raise bad(str(path), "not an object", "a sidecar of a raw file")
    return found


def _mapped(path: Path) -> Any:
    """The array of an .npy file. NumPy allocates the header's length before it reads it, so it is
    read from a file first that gives no more than it has."""
    with BoundedFile(path) as file:
        _array_header(file)
    return np.load(path, mmap_mode="r", allow_pickle=False)


def _array_header(file: Any) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    """Shape, whether the first axis runs fastest, and the type of numbers."""
    version = np.lib.format.read_magic(file)
    read = (np.lib.format.read_array_header_1_0 if version == (1, 0)
            else np.lib.format.read_array_header_2_0)  # fmt: skip
    shape, fortran, dtype = read(file)
    return shape, fortran, dtype


def _member(path: Path, name: str | None) -> Any:
    """An array of an .npz file, which may not claim to unpack to more than it can."""
    with BoundedFile(path) as file, zipfile.ZipFile(file) as members:
        names = [each.removesuffix(".npy") for each in members.namelist()]
        wanted = name or (names[0] if len(names) == 1 else "")
        if wanted not in names:
            raise bad(path.name, f"arrays {', '.join(names)}", "a choice of one (--grid)")
        info = members.infolist()[names.index(wanted)]
        check_unpacked(path, info.file_size, info.compress_size)
        with members.open(info) as member:
            shape, fortran, dtype = _array_header(member)
            count = math.prod(shape)
            if not 0 <= count * dtype.itemsize <= info.file_size:
                raise bad("its data", f"{info.file_size} bytes", f"{count} {dtype}", str(path))
            values = np.frombuffer(member.read(count * dtype.itemsize), dtype)
            return values.reshape(shape, order="F" if fortran else "C")


def _source(
    path: Path, form: str, layout: RawLayout, slabs: Callable[[int], Iterator[Slab]]
) -> Source:
    def scaled(depth: int) -> Iterator[Slab]:
        for slab in slabs(depth):
            yield slab.astype(np.float64) * layout.slope + layout.intercept

    plain = (layout.slope, layout.intercept) == (1, 0)
    return Source(
        path, form, layout.shape,
        affine(layout.direction, layout.spacing, layout.origin, path), layout.dtype,
        slabs if plain else scaled, kind=layout.kind, unit=layout.unit,
        length_unit=layout.length_unit,
    )  # fmt: skip
