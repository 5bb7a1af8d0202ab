"""MetaImage (.mha, .mhd): ITK's own format. Its header is a few lines of text, and ITK itself would
be 50 MB: read here.

The world is a patient's (LPS, ITK's), lengths are millimetres. `TransformMatrix` lists the world
directions of the index axes one after another.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from ..core.errors import bad
from . import payload
from .payload import Layout, Part
from .source import Options, Source, affine, check_shape, choose_channel
from .text_header import beside, head, numbers

TYPES = {
    "MET_CHAR": "i1", "MET_UCHAR": "u1", "MET_SHORT": "i2", "MET_USHORT": "u2", "MET_INT": "i4",
    "MET_UINT": "u4", "MET_LONG": "i4", "MET_ULONG": "u4", "MET_LONG_LONG": "i8",
    "MET_ULONG_LONG": "u8", "MET_FLOAT": "f4", "MET_DOUBLE": "f8",
}  # fmt: skip
LINE = re.compile(rb"[ \t\r]*([A-Za-z_ ]+?)[ \t]*=[ \t]*([^\n]*)\n")
# Several keys mean the same; the last in a row that is there counts.
ALIASES = {
    "spacing": ("ElementSize", "ElementSpacing"),
    "origin": ("Origin", "Position", "Offset"),
    "direction": ("Orientation", "Rotation", "TransformMatrix"),
    "msb": ("ElementByteOrderMSB", "BinaryDataByteOrderMSB"),
}


def read(path: Path, options: Options) -> Source:
    """The volume of a MetaImage; of several components or time steps one."""
    fields, end = _fields(path)
    if fields.get("BinaryData", "True").lower() != "true":
        raise bad("its BinaryData", "False (numbers as text)", "True", str(path))
    dimensions = numbers(_need(fields, "NDims", path), int, 1, "its NDims", path)[0]
    if not 2 <= dimensions <= 4:
        raise bad("its NDims", dimensions, "2 to 4", str(path))
    sizes = numbers(_need(fields, "DimSize", path), int, dimensions, "its DimSize", path)
    type_name = _need(fields, "ElementType", path)
    components = numbers(fields.get("ElementNumberOfChannels", "1"), int, 1, "its channels", path)[
        0
    ]
    if type_name.removesuffix("_ARRAY") not in TYPES:
        raise bad("its ElementType", type_name, "one of " + ", ".join(TYPES), str(path))
    if components < 1:
        raise bad("its ElementNumberOfChannels", components, "at least 1", str(path))
    order = ">" if _first(fields, "msb", "False").lower() in ("true", "1") else "<"
    dtype = np.dtype(order + TYPES[type_name.removesuffix("_ARRAY")])
    shape = [*sizes[:3], *([1] * (3 - dimensions))]
    check_shape(shape, path)
    steps = sizes[3] if dimensions == 4 else 1
    if steps > 1 and components > 1:
        raise bad(path.name, f"{components} channels at {steps} times", "one of the two", str(path))
    planar = steps > 1
    count = steps if planar else components
    layout = Layout(
        (shape[0], shape[1], shape[2]), dtype, count, choose_channel(count, options, path), planar
    )
    parts = _parts(path, fields, end, layout)
    return Source(
        path, "MetaImage", layout.shape, _world(fields, dimensions, path), dtype,
        payload.slabs(parts, layout), kind={"MET_MOD_CT": "ct", "MET_MOD_MR": "mr"}.get(
            fields.get("Modality", ""), ""),
        length_unit="mm", space="LPS",
    )  # fmt: skip


def _fields(path: Path) -> tuple[dict[str, str], int]:
    """The header's entries, and where it ends."""
    data = head(path)
    found: dict[str, str] = {}
    place = 0
    while "ElementDataFile" not in found:
        line = LINE.match(data, place)
        if line is None:
            raise bad(str(path), "not a MetaImage",
                      "lines `key = value` up to ElementDataFile")  # fmt: skip
        found[line[1].decode("latin-1")] = line[2].decode("latin-1").strip()
        place = line.end()
    return found, place


def _need(fields: dict[str, str], name: str, path: Path) -> str:
    if name not in fields:
        raise bad(f"its {name}", "missing", "an entry of the header", str(path))
    return fields[name]


def _first(fields: dict[str, str], what: str, otherwise: str) -> str:
    return next((fields[key] for key in reversed(ALIASES[what]) if key in fields), otherwise)


def _world(fields: dict[str, str], dimensions: int, path: Path) -> np.ndarray:
    n = dimensions
    spacing = numbers(_first(fields, "spacing", "1 " * n), float, n, "its spacing", path)
    origin = numbers(_first(fields, "origin", "0 " * n), float, n, "its origin", path)
    text = _first(fields, "direction", " ".join(str(x) for x in np.eye(n).ravel()))
    direction = np.eye(max(n, 3))
    direction[:n, :n] = np.array(numbers(text, float, n * n, "its TransformMatrix", path)
                                 ).reshape(n, n)  # fmt: skip
    pad = [1.0] * (3 - n)
    return affine(direction[:3, :3], [*spacing[:3], *pad], [*origin[:3], *(0 * x for x in pad)],
                  path)  # fmt: skip


def _parts(path: Path, fields: dict[str, str], end: int, layout: Layout) -> list[Part]:
    packed = fields.get("CompressedData", "False").lower() == "true"
    skip = numbers(fields.get("HeaderSize", "0"), int, 1, "its HeaderSize", path)[0]
    if skip < -1 or (packed and skip):
        raise bad("its HeaderSize", skip, "0 or more, and 0 for packed data", str(path))
    name = fields["ElementDataFile"]
    if name.upper() == "LOCAL":
        return [Part(path, end, "deflate" if packed else "")]
    if name.upper().startswith("LIST"):
        lines = head(path)[end:].decode("latin-1").split("\n")
        files = [beside(path, line.strip()) for line in lines if line.strip()]
    elif pattern := re.fullmatch(r"(\S*%0?\d?d\S*) (\d+) (\d+) (\d+)", name):
        first, last, step = (int(pattern[n]) for n in (2, 3, 4))
        if step < 1 or (last - first) // step > 1 << 16:
            raise bad("its data files", repr(name), "a first, last and step that end", str(path))
        files = [beside(path, pattern[1] % n) for n in range(first, last + 1, step)]
    else:
        files = [beside(path, name)]
    if skip == -1:
        return layout.last_bytes(files)
    return [Part(file, skip, "deflate" if packed else "") for file in files]
