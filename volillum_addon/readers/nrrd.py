"""NRRD, attached and detached (.nrrd, .nhdr): the header through pynrrd, the data as `payload`.

pynrrd itself would unpack a file whole before it looks at its length.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.errors import bad
from . import payload
from .payload import Layout, Packing, Part
from .source import TO_LPS, Options, Source, affine, check_shape, choose_channel, library, to_lps
from .text_header import LONGEST_HEADER, beside, head

EXPECTED = "a whole NRRD file"
PACKINGS: dict[str, Packing] = {"raw": "", "gzip": "deflate", "gz": "deflate", "bzip2": "bzip2",
                                "bz2": "bzip2"}  # fmt: skip
TYPES = {
    "i1": ("signed char", "int8", "int8_t"),
    "u1": ("uchar", "unsigned char", "uint8", "uint8_t"),
    "i2": ("short", "short int", "signed short", "signed short int", "int16", "int16_t"),
    "u2": ("ushort", "unsigned short", "unsigned short int", "uint16", "uint16_t"),
    "i4": ("int", "signed int", "int32", "int32_t"),
    "u4": ("uint", "unsigned int", "uint32", "uint32_t"),
    "i8": ("longlong", "long long", "long long int", "signed long long", "signed long long int",
           "int64", "int64_t"),
    "u8": ("ulonglong", "unsigned long long", "unsigned long long int", "uint64", "uint64_t"),
    "f4": ("float",),
    "f8": ("double",),
}  # fmt: skip
# The axes of a volume; a file that names no kinds has nothing else.
SPATIAL = {"domain", "space", "???", "none"}
SPACES = {
    "left-posterior-superior": "LPS", "right-anterior-superior": "RAS",
    "left-anterior-superior": "LAS", "left-posterior-superior-time": "LPS",
    "right-anterior-superior-time": "RAS", "left-anterior-superior-time": "LAS",
}  # fmt: skip
# How other programs write some units.
LENGTHS = {"millimeter": "mm", "micron": "um", "micrometer": "um", "µm": "um", "μm": "um"}


def read(path: Path, options: Options) -> Source:
    """The volume of a NRRD file; of one with a further axis (colour, time) one channel."""
    _check_header_ends(path)
    with library(path, EXPECTED):
        import nrrd

        with path.open("rb") as file:
            header: Mapping[str, Any] = nrrd.read_header(file)
            attached = file.tell()
        sizes = [int(n) for n in header["sizes"]]
        dtype = _number_type(header)
        encoding = str(header["encoding"]).lower()
        skips = int(header.get("line skip", 0) or 0), int(header.get("byte skip", 0) or 0)
        kinds = [str(kind).lower() for kind in header.get("kinds", [])]
        directions = _directions(header, len(sizes))
    if encoding not in PACKINGS:
        raise bad("its encoding", repr(encoding), "raw, gzip or bzip2", str(path))
    spatial = _spatial_axes(sizes, kinds, directions, path)
    others = [axis for axis in range(len(sizes)) if axis not in spatial]
    if len(others) > 1 or (others and others[0] not in (0, len(sizes) - 1)):
        raise bad(
            "its axes", f"{len(sizes)}", "three, and one more before or after them", str(path)
        )
    components = sizes[others[0]] if others else 1
    shape = [sizes[axis] for axis in spatial]
    shape += [1] * (3 - len(shape))
    check_shape(shape, path)
    layout = Layout(
        (shape[0], shape[1], shape[2]), dtype, components,
        choose_channel(components, options, path), planar=bool(others) and others[0] > 0,
    )  # fmt: skip
    parts = _parts(path, header, attached, PACKINGS[encoding], skips, layout)
    matrix, space = _world(header, spatial, directions, path)
    units = [_plain(unit) for unit in header.get("space units", header.get("units", []))]
    units = [unit for unit in units if unit]
    return Source(
        path, "NRRD", layout.shape, matrix, dtype, payload.slabs(parts, layout),
        unit=_plain(header.get("sample units", "")),
        length_unit=units[0] if units else "", space=space,
    )  # fmt: skip


def _check_header_ends(path: Path) -> None:
    first = head(path, LONGEST_HEADER)
    if not first.startswith(b"NRRD000"):
        raise bad(str(path), "not a NRRD file", "one that begins with NRRD000 and its version")


def _number_type(header: Mapping[str, Any]) -> np.dtype[np.generic]:
    name = str(header["type"]).lower()
    code = next((code for code, names in TYPES.items() if name in names), None)
    endian = str(header.get("endian", "little")).lower()
    if code is None or endian not in ("little", "big"):
        raise ValueError(f"voxels of type {name}, {endian} endian")
    return np.dtype((">" if endian == "big" else "<") + code)


def _directions(header: Mapping[str, Any], axes: int) -> NDArray[np.float64] | None:
    """World directions of every axis, NaN for one that has none; None where the file gives none."""
    given = header.get("space directions")
    if given is None:
        return None
    rows = [[np.nan] * 3 if row is None else [float(x) for x in row] for row in given]
    if len(rows) != axes or any(len(row) != 3 for row in rows):
        raise ValueError(f"space directions for {len(rows)} axes of {axes}, in three dimensions")
    return np.array(rows)


def _spatial_axes(
    sizes: list[int], kinds: list[str], directions: NDArray[np.float64] | None, path: Path
) -> list[int]:
    axes = list(range(len(sizes)))
    if directions is not None:
        axes = [axis for axis in axes if np.all(np.isfinite(directions[axis]))]
    elif len(kinds) == len(sizes):
        axes = [axis for axis in axes if kinds[axis] in SPATIAL]
    elif len(sizes) == 4:
        # The rarer: three colours a voxel. The usual: steps of time.
        axes = axes[1:] if sizes[0] <= 4 else axes[:3]
    if not 2 <= len(axes) <= 3:
        raise bad("its axes in space", len(axes), "three", str(path))
    return axes


def _world(
    header: Mapping[str, Any],
    spatial: list[int],
    directions: NDArray[np.float64] | None,
    path: Path,
) -> tuple[NDArray[np.float64], str]:
    if directions is not None and len(spatial) == 3:
        origin = header.get("space origin")
        matrix = affine(directions[spatial], 1.0 * np.ones(3),
                        np.zeros(3) if origin is None else origin, path)  # fmt: skip
        name = str(header.get("space", "")).lower()
        space = SPACES.get(name, name.upper() if name.upper() in TO_LPS else "")
        return (to_lps(matrix, space), "LPS") if space else (matrix, "")
    spacings = [float(x) for x in header.get("spacings", [])]
    origin = [float(x) for x in header.get("axis mins", [])]
    steps = [spacings[a] if a < len(spacings) else np.nan for a in spatial]
    begin = [origin[a] if a < len(origin) else np.nan for a in spatial]
    steps, begin = steps + [1.0] * (3 - len(steps)), begin + [0.0] * (3 - len(begin))
    return affine(np.eye(3), np.where(np.isfinite(steps), steps, 1.0),
                  np.where(np.isfinite(begin), begin, 0.0), path), ""  # fmt: skip


def _parts(
    path: Path,
    header: Mapping[str, Any],
    attached: int,
    packing: Packing,
    skips: tuple[int, int],
    layout: Layout,
) -> list[Part]:
    name = header.get("data file", header.get("datafile"))
    lines, skip = skips
    if name is None:
        files, offset = [path], attached
    else:
        files, offset = _data_files(path, str(name)), 0
    if lines < 0 or skip < -1 or (skip == -1 and packing):
        raise bad("its line and byte skip", f"{lines} and {skip}", "0 or more", str(path))
    if skip == -1:
        return layout.last_bytes(files)
    result = []
    for file in files:
        begin = offset
        if lines:
            start = head(file, offset + LONGEST_HEADER)
            for _ in range(lines):
                begin = start.find(b"\n", begin) + 1
                if not begin:
                    raise bad("its line skip", lines, "no more than there are lines", str(file))
        result.append(Part(file, begin, packing, skip))
    return result


def _data_files(path: Path, text: str) -> list[Path]:
    """The file named, or all of `name%03d.raw first last step`, or of a LIST."""
    if text.upper().startswith("LIST"):
        lines = head(path).decode("latin-1").split("\n")
        start = next(n for n, line in enumerate(lines) if re.match(r"data ?file:", line.lower()))
        return [beside(path, line.strip()) for line in lines[start + 1 :] if line.strip()]
    pattern = re.fullmatch(r"(\S*%0?\d?d\S*) (-?\d+) (-?\d+) (-?\d+)(?: \d+)?", text)
    if pattern is None:
        return [beside(path, text)]
    form, first, last, step = pattern[1], *(int(pattern[n]) for n in (2, 3, 4))
    if step == 0 or abs(last - first) // abs(step) > 1 << 16:
        raise bad("its data files", repr(text), "a first, last and step that end", str(path))
    return [beside(path, form % n) for n in range(first, last + (1 if step > 0 else -1), step)]


def _plain(unit: object) -> str:
    text = str(unit or "").strip().strip('"')
    return LENGTHS.get(text.lower(), text)
