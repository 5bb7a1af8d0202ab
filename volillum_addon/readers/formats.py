"""The one list of formats, and reading a file as what it is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import cast

import numpy as np
from numpy.typing import NDArray

from ..core.control import Control
from ..core.errors import InputError, bad
from ..core.grid import Grid
from .gather import gather
from .imported import BINS, About, write_imported
from .source import Options, Source, file_size
from .text_header import head

# A DICOM file has this at byte 128, and often no suffix.
DICOM_MAGIC, DICOM_MAGIC_AT = b"DICM", 128

# Hounsfield units of air and of soft tissue, the share of voxels that each has at least, and the
# least value there is (scanners mark what they have not seen by -3024).
AIR, TISSUE, SHARE, LEAST = (-1100, -850), (-200, 200), 0.05, -3100


@dataclass(frozen=True)
class Format:
    """A file format: how its files are named, and the function that reads them (module:name)."""

    id: str
    label: str
    suffixes: tuple[str, ...]
    reader: str

    @property
    def read(self) -> Callable[[Path, Options], Source]:
        """The reader; its module is loaded now."""
        module, name = self.reader.split(":")
        return cast(
            Callable[[Path, Options], Source],
            getattr(import_module(f".{module}", __package__), name),
        )


FORMATS = (
    Format("vdb", "OpenVDB", (".vdb",), "vdb:read"),
    Format("nifti", "NIfTI", (".nii", ".nii.gz", ".hdr", ".img"), "nifti:read"),
    Format("nrrd", "NRRD", (".nrrd", ".nhdr"), "nrrd:read"),
    Format("metaimage", "MetaImage", (".mha", ".mhd"), "metaimage:read"),
    Format("dicom", "DICOM series", (".dcm", ".dicom", ".ima"), "dicom:read"),
    Format("tiff", "TIFF stack", (".tif", ".tiff"), "tiff:read"),
    Format("numpy", "NumPy", (".npy", ".npz"), "raw:read_numpy"),
    Format("raw", "Raw voxels", (".raw",), "raw:read"),
    Format("vtkjs", "vtk.js image data", (".json",), "special:read_vtkjs"),
    Format("volvis", "VolVis", (".slc",), "special:read_slc"),
    Format("volpack", "VolPack", (".den",), "special:read_den"),
    Format("cloud", "Cloud table", (".txt",), "cloud_text:read"),
)
SUFFIXES = tuple(suffix for each in FORMATS for suffix in each.suffixes)


def format_of(path: Path) -> Format:
    """The format of a file or folder, by its name, or where that tells nothing by its first bytes.

    Raises InputError for one that is not there or is none of FORMATS.
    """
    by_id = {each.id: each for each in FORMATS}
    if path.is_dir():
        return by_id[_folder_format(path)]
    file_size(path)
    name = path.name.lower()
    matches = [(len(suffix), each) for each in FORMATS for suffix in each.suffixes
               if name.endswith(suffix)]  # fmt: skip
    if matches:
        return max(matches, key=lambda match: match[0])[1]
    start = head(path, DICOM_MAGIC_AT + len(DICOM_MAGIC))
    if start[DICOM_MAGIC_AT:] == DICOM_MAGIC:
        return by_id["dicom"]
    raise bad(path.name, "of no known format", "one of " + " ".join(SUFFIXES), str(path))


def _folder_format(folder: Path) -> str:
    if (folder / "index.json").is_file():
        return "vtkjs"
    try:
        suffixes = [file.suffix.lower() for file in folder.iterdir() if file.is_file()]
    except OSError as error:
        raise InputError(f"{folder} cannot be read ({error.strerror}); expected a folder") from None
    tiffs = sum(suffix in (".tif", ".tiff") for suffix in suffixes)
    return "tiff" if 2 * tiffs > len(suffixes) else "dicom"


def stem_of(path: Path) -> str:
    """The name of a volume's file without what says its format: `ct` of ct.nii.gz."""
    name = path.name
    matches = [suffix for suffix in SUFFIXES if name.lower().endswith(suffix)]
    longest = max(map(len, matches), default=0)
    return name[: len(name) - longest] if longest and longest < len(name) else path.stem


def open_volume(path: Path | str, options: Options | None = None) -> Source:
    """What the file holds, without its voxels. Raises InputError."""
    where = Path(path)
    return format_of(where).read(where, options or Options())


def read_volume(
    path: Path | str,
    level: int = 0,
    options: Options | None = None,
    control: Control | None = None,
) -> tuple[Grid, About]:
    """The volume of a file of any of FORMATS, and what the file says of it.

    `level` 1 averages blocks of 2 x 2 x 2 voxels, 2 of 4 x 4 x 4, ... Values are in the unit of
    `About.unit`, positions in that of `About.length_unit`. Raises InputError for a file that is not
    whole or does not fit into the memory, Cancelled.
    """
    source = open_volume(path, options)
    grid = gather(source, level, control)
    low, high = float(grid.values.min()), float(grid.values.max())
    kind, unit, notes = source.kind, source.unit, source.notes
    if not kind and not unit and hounsfield(grid.values):
        kind, unit = "ct", "HU"
        notes += ("taken for a CT in Hounsfield units, because much of it has the value of air",)
    about = About(
        source=source.path.name,
        format=source.format,
        shape=grid.shape,
        stored=source.dtype.name,
        low=low,
        high=high,
        kind=kind,
        unit=unit,
        length_unit=source.length_unit,
        space=source.space,
        level=level,
        notes=notes,
        histogram=_histogram(grid.values, low, high, _bins(grid, source)),
    )
    return grid, about


def _histogram(values: NDArray[np.float32], low: float, high: float, bins: int) -> tuple[int, ...]:
    """Voxels in equal intervals, layer by layer: in shares of the range, because float32 cannot
    divide a range of a few of its own steps."""
    counts = np.zeros(bins, np.int64)
    for layer in values:
        shares = (layer.astype(np.float64) - low) / ((high - low) or 1.0)
        counts += np.histogram(shares, bins, (0.0, 1.0))[0]
    return tuple(counts.tolist())


def _bins(grid: Grid, source: Source) -> int:
    """Intervals of the histogram: one for each of few whole numbers, or it would be a comb."""
    span = float(np.ptp(grid.values))
    whole = source.dtype.kind in "iub" and span.is_integer() and grid.shape == source.shape
    return int(span) + 1 if whole and 0 < span < BINS else BINS


def hounsfield(values: NDArray[np.float32]) -> bool:
    """Whether values look like Hounsfield units: a good part at air's -1000, and some of tissue."""
    air = np.count_nonzero((values > AIR[0]) & (values < AIR[1]))
    tissue = np.count_nonzero((values > TISSUE[0]) & (values < TISSUE[1]))
    return bool(min(air, tissue) > SHARE * values.size and values.min() >= LEAST)


def import_volume(
    path: Path | str,
    target: Path | str,
    level: int = 0,
    options: Options | None = None,
    control: Control | None = None,
) -> About:
    """Turn a file of any of FORMATS into the VDB file `target`, whole or not at all.

    Raises InputError as `read_volume`, StorageError where the target cannot be written, Cancelled.
    """
    where = Path(target)
    if where.suffix != ".vdb":
        raise bad("the file to write", repr(where.name), "a name that ends in .vdb")
    if where.exists() and where.resolve() == Path(path).resolve():
        raise bad("the file to write", repr(where.name), "another one than is read")
    watch = control or Control()
    with watch.stage(0.0, 0.7, f"reading {Path(path).name}"):
        grid, about = read_volume(path, level, options, watch)
    with watch.stage(0.7, 1.0, f"writing {where.name}"):
        write_imported(grid, about, where, watch)
    return about
