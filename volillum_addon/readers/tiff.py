"""TIFF stacks through tifffile: a file of many pages, or a folder of one-page files in the order of
the numbers in their names.

x runs along the rows, y down the columns, z through the pages. ImageJ's and OME's voxel sizes are
taken; the resolution of other TIFF files is a printer's and is not.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from ..core.errors import InputError, bad
from .layers import stacked
from .source import (
    BoundedFile,
    Options,
    Slab,
    Source,
    check_number_type,
    check_shape,
    check_unpacked,
    choose_channel,
    file_size,
    library,
    unreadable,
)

EXPECTED = "a whole TIFF file"
SUFFIXES = (".tif", ".tiff")
UNITS = {"micron": "um", "microns": "um", "µm": "um", "μm": "um", r"\u00b5m": "um", "inch": "in",
         "pixel": "", "pixels": "", "voxel": ""}  # fmt: skip
# Names of the axes that can be the third one, the likeliest first.
DEPTH = "ZIQT"


def read(path: Path, options: Options) -> Source:
    """The volume of a TIFF file or of a folder of them; of several channels one."""
    if path.is_dir():
        return _folder(path, options)
    with library(path, EXPECTED) as complaints:
        import tifffile

        with BoundedFile(path) as file, tifffile.TiffFile(file) as tiff:
            series = _series(tiff)
            axes, sizes = str(series.axes), tuple(int(n) for n in series.shape)
            dtype = np.dtype(series.dtype)
            spacing, unit, notes = _spacing(tiff)
            begin, order = series.dataoffset, tiff.byteorder
    if complaints.errors:
        # tifffile makes do with the pages that it finds; a volume that lacks some is not whole.
        raise unreadable(path, ValueError(complaints.errors[0]), EXPECTED)
    if not axes.endswith(("YX", "YXS")) or len(axes) != len(sizes):
        raise bad("its axes", repr(axes), "pages of rows and columns (YX)", str(path))
    check_number_type(dtype, path)
    leading = axes[: axes.index("YX")]
    depth = next((leading.index(name) for name in DEPTH if name in leading),
                 int(np.argmax(sizes[: len(leading)])) if leading else -1)  # fmt: skip
    ny, nx = sizes[len(leading) : len(leading) + 2]
    nz = sizes[depth] if leading else 1
    check_shape((nx, ny, nz), path)
    claimed = math.prod(sizes) * dtype.itemsize
    check_unpacked(path, claimed, file_size(path))
    samples = sizes[-1] if axes.endswith("S") else 1
    others = [n for axis, n in enumerate(sizes[: len(leading)]) if axis != depth]
    channel = choose_channel(math.prod(others) * samples, options, path)
    chosen = [int(n) for n in np.unravel_index(channel // samples, others)] if others else []
    pages = _pages(sizes[: len(leading)], depth, chosen, nz)
    page = Page(ny, nx, samples, channel % samples, dtype.newbyteorder(order))
    if begin is None:
        slabs = _packed(path, pages, page)
    elif int(begin) + claimed <= file_size(path):
        slabs = stacked(nz, lambda k: page.at(path, int(begin) + pages[k] * page.bytes))
    else:
        raise bad("its data", f"{file_size(path)} bytes", f"{claimed} of voxels", str(path))
    return Source(path, "TIFF", (nx, ny, nz), np.diag([*spacing, 1.0]), dtype, slabs,
                  kind="microscopy" if unit in ("um", "nm") else "", length_unit=unit,
                  notes=notes)  # fmt: skip


@dataclass(frozen=True)
class Page:
    """The numbers of a page, [row, column, sample], and the sample that is wanted."""

    rows: int
    columns: int
    samples: int
    sample: int
    dtype: np.dtype[np.generic]

    @property
    def bytes(self) -> int:
        """Bytes of a page."""
        return self.rows * self.columns * self.samples * self.dtype.itemsize

    def layer(self, numbers: Any) -> Slab:
        """The page as a layer [i, j]."""
        layer: Slab = numbers.reshape(self.rows, self.columns, self.samples)[..., self.sample].T
        return layer

    def at(self, path: Path, offset: int) -> Slab:
        """The layer whose numbers lie plain in the file."""
        with library(path, EXPECTED):
            count = self.bytes // self.dtype.itemsize
            return self.layer(np.fromfile(path, self.dtype, count, offset=offset))


def _packed(path: Path, pages: Sequence[int], page: Page) -> Callable[[int], Iterator[Slab]]:
    def slabs(depth: int) -> Iterator[Slab]:
        with library(path, EXPECTED):
            import tifffile

            file = BoundedFile(path)
        with file:
            with library(path, EXPECTED):
                stored = _series(tifffile.TiffFile(file)).pages

            def layer(k: int) -> Slab:
                with library(path, EXPECTED):
                    try:
                        return page.layer(stored[pages[k]].asarray())
                    except ValueError as error:
                        # LZW and others are in a companion of tifffile's that is not bundled.
                        if "imagecodecs" not in str(error):
                            raise
                        return page.layer(_by_pillow(path, stored[pages[k]].index))

            yield from stacked(len(pages), layer)(depth)

    return slabs


def _by_pillow(path: Path, index: int) -> Any:
    """The numbers of a page as libtiff, which is a part of Pillow, unpacks them."""
    from PIL import Image

    with Image.open(path) as image:
        image.seek(int(index))
        return np.asarray(image)


def _series(tiff: Any) -> Any:
    """The largest series: others are thumbnails."""
    return max(tiff.series, key=lambda each: each.size)


def _pages(sizes: Sequence[int], depth: int, chosen: Sequence[int], layers: int) -> list[int]:
    """The number of the page of each layer, where the pages run over `sizes`."""
    if not sizes:
        return [0]
    places = [[*chosen[:depth], k, *chosen[depth:]] for k in range(layers)]
    return [int(np.ravel_multi_index(place, sizes)) for place in places]


def _folder(folder: Path, options: Options) -> Source:
    files = sorted((file for file in folder.iterdir() if file.suffix.lower() in SUFFIXES),
                   key=_in_order)  # fmt: skip
    if not files:
        raise InputError(f"{folder} holds no TIFF files; expected one for each layer")
    first = read(files[0], options)
    if first.shape[2] != 1:
        raise bad(files[0].name, f"{first.shape[2]} pages", "one: a folder holds one file a layer",
                  str(folder))  # fmt: skip

    def layer(k: int) -> Slab:
        source = first if k == 0 else read(files[k], options)
        if (source.shape, source.dtype) != (first.shape, first.dtype):
            raise bad(files[k].name, f"{source.shape[0]} x {source.shape[1]} of {source.dtype}",
                      f"{first.shape[0]} x {first.shape[1]} of {first.dtype} as in {files[0].name}",
                      str(folder))  # fmt: skip
        return next(iter(source.slabs(1)))[:, :, 0]

    return Source(folder, "TIFF", (*first.shape[:2], len(files)), first.index_to_world,
                  first.dtype, stacked(len(files), layer), kind=first.kind,
                  length_unit=first.length_unit, notes=first.notes)  # fmt: skip


def _in_order(file: Path) -> list[tuple[int, str]]:
    """Names with their numbers as numbers: 2 before 10."""
    return [(int(part), "") if part.isdecimal() else (0, part)
            for part in re.split(r"(\d+)", file.name)]  # fmt: skip


def _spacing(tiff: Any) -> tuple[list[float], str, tuple[str, ...]]:
    """Voxel sizes along x, y, z, their unit, and what is to be said about them."""
    spacing, unit = [1.0, 1.0, 1.0], ""
    if tiff.ome_metadata:
        spacing, unit = _ome(tiff.ome_metadata)
    elif tiff.imagej_metadata:
        tags = tiff.pages[0].tags
        for axis, name in enumerate(("XResolution", "YResolution")):
            value = tags[name].value if name in tags else (0, 1)
            if value[0] > 0 and value[1] > 0:
                spacing[axis] = value[1] / value[0]
        spacing[2] = float(tiff.imagej_metadata.get("spacing", 1.0)) or 1.0
        unit = str(tiff.imagej_metadata.get("unit", ""))
    else:
        return spacing, "", ("the file tells no voxel size: voxels are taken as cubes of length 1",)
    spacing = [abs(each) if math.isfinite(each) and each else 1.0 for each in spacing]
    return spacing, UNITS.get(unit.lower(), unit), ()


def _ome(text: str) -> tuple[list[float], str]:
    """PhysicalSizeX, Y, Z of the first image, in the unit of the first."""
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise ValueError("OME metadata with entities")
    root = ElementTree.fromstring(text)
    pixels = next((each for each in root.iter() if each.tag.endswith("}Pixels")), None)
    if pixels is None:
        return [1.0, 1.0, 1.0], ""
    spacing = [float(pixels.get(f"PhysicalSize{axis}", 1.0)) for axis in "XYZ"]
    units = [pixels.get(f"PhysicalSize{axis}Unit", "µm") for axis in "XYZ"]
    if len(set(units)) > 1:
        raise ValueError(f"voxel sizes in different units, {', '.join(units)}")
    return spacing, units[0] if pixels.get("PhysicalSizeX") else ""
