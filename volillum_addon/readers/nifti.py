"""NIfTI-1 and -2 (.nii, .nii.gz, .hdr + .img), and Analyze, through nibabel.

The world is the sform's, else the qform's (right-anterior-superior), turned into LPS; with neither
code set the axes are as stored, scaled by the voxel sizes. Values are scaled by scl_slope and
scl_inter.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ..core.errors import bad
from .source import (
    Options,
    Slab,
    Source,
    check_number_type,
    check_shape,
    check_unpacked,
    choose_channel,
    file_size,
    library,
    to_lps,
)

EXPECTED = "a whole NIfTI file"
UNITS = {"meter": "m", "mm": "mm", "micron": "um"}


def read(path: Path, options: Options) -> Source:
    """The volume of a NIfTI file; of a time series one step."""
    with library(path, EXPECTED):
        import nibabel

        # Kept open: the layers of a packed file are read in one pass.
        image: Any = nibabel.load(path, mmap=False, keep_file_open=True)
        header = image.header
        stored = image.dataobj
        sizes = tuple(int(n) for n in stored.shape)
        dtype = np.dtype(stored.dtype)
        matrix, space, codes = np.array(image.affine, np.float64), "", (0, 0)
        length_unit = ""
        if hasattr(header, "get_xyzt_units"):
            codes = int(header["qform_code"]), int(header["sform_code"])
            length_unit = UNITS.get(header.get_xyzt_units()[0], "")
        sides = [float(side) for side in header.get_zooms()[:3]]
    sizes += (1,) * (3 - len(sizes))
    check_shape(sizes[:3], path)
    check_number_type(dtype, path)
    data = Path(image.file_map["image"].filename)
    claimed = math.prod(sizes) * dtype.itemsize
    if data.suffix in (".gz", ".bz2"):
        check_unpacked(data, claimed, file_size(data))
    elif file_size(data) < claimed:
        raise bad("its data", f"{file_size(data)} bytes", f"{claimed}", str(data))
    if any(codes):
        matrix, space = to_lps(matrix, "RAS"), "LPS"
    else:
        matrix = np.diag([*sides, *([1.0] * (3 - len(sides))), 1.0])
    channel = choose_channel(math.prod(sizes[3:]), options, path, "time steps or channels")
    chosen = np.unravel_index(channel, sizes[3:], order="F") if sizes[3:] else ()
    nz = sizes[2]

    def slabs(depth: int) -> Iterator[Slab]:
        for begin in range(0, nz, depth):
            layers = slice(begin, min(begin + depth, nz))
            index: tuple[Any, ...] = (slice(None), slice(None), layers, *map(int, chosen))
            with library(path, EXPECTED):
                values = np.asarray(stored[index[: len(stored.shape)]])
            yield values.reshape(sizes[0], sizes[1], -1)

    return Source(path, "NIfTI", (sizes[0], sizes[1], nz), matrix, dtype, slabs,
                  length_unit=length_unit, space=space)  # fmt: skip
