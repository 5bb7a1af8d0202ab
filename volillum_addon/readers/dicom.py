"""DICOM series through pydicom: a folder of slices, one file of the series, or a multi-frame file.

Slices are ordered along their normal; the affine is the slices' own, so a tilted gantry is kept as
a sheared grid. Values are in the modality's unit (Hounsfield for a CT). The world is LPS, mm.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError, bad
from .layers import stacked
from .source import (
    BoundedFile,
    Options,
    Slab,
    Source,
    check_unpacked,
    choose_channel,
    file_size,
    library,
)

EXPECTED = "whole DICOM images"
KINDS = {"CT": "ct", "MR": "mr"}
# Distances between slices may differ by this share of their mean (positions are rounded text).
EVEN = 0.02
# Files of one folder that are looked at: a folder of more is not a series.
MOST_FILES = 20000
TAGS = [
    "SOPClassUID", "SeriesInstanceUID", "SeriesDescription", "Modality", "Rows", "Columns",
    "BitsAllocated", "PixelRepresentation", "SamplesPerPixel", "NumberOfFrames", "PixelSpacing",
    "ImageOrientationPatient", "ImagePositionPatient", "InstanceNumber", "RescaleSlope",
    "RescaleIntercept", "RescaleType", "Units", "PhotometricInterpretation", "SliceThickness",
    "SpacingBetweenSlices", "SharedFunctionalGroupsSequence", "PerFrameFunctionalGroupsSequence",
]  # fmt: skip


@dataclass(frozen=True, eq=False)
class Slice:
    """One layer: its file and frame, and where its first voxel lies."""

    path: Path
    frame: int
    position: NDArray[np.float64]
    slope: float
    intercept: float


def read(path: Path, options: Options) -> Source:
    """The series of a folder (there may be one only) or the one that a file belongs to."""
    with library(path, EXPECTED):
        series = _series(path)
        first = series[0][1]
        slices = [each for file, header in series for each in _slices(file, header)]
        rows, columns = int(first.Rows), int(first.Columns)
        samples = int(getattr(first, "SamplesPerPixel", 1))
        bits = int(first.BitsAllocated)
        across, down, spacing = _plane(first)
        sign = "i" if int(getattr(first, "PixelRepresentation", 0)) else "u"
        dtype = np.dtype(f"{sign}{max(bits // 8, 1)}")
        same = all((int(h.Rows), int(h.Columns), int(h.BitsAllocated)) == (rows, columns, bits)
                   for _, h in series)  # fmt: skip
        modality = str(getattr(first, "Modality", ""))
        unit = "HU" if modality == "CT" else str(
            getattr(first, "RescaleType", "") or getattr(first, "Units", "") or "")  # fmt: skip
        inverted = str(getattr(first, "PhotometricInterpretation", "")) == "MONOCHROME1"
    if not same:
        raise bad("the series", "of slices of different sizes", "one size", str(path))
    normal = np.cross(across, down)
    slices.sort(key=lambda each: float(each.position @ normal))
    step = _step(slices, normal, first, path)
    for file in {each.path for each in slices}:
        frames = sum(1 for each in slices if each.path == file)
        check_unpacked(file, rows * columns * samples * dtype.itemsize * frames, file_size(file))
    channel = choose_channel(samples, options, path)
    matrix = np.eye(4)
    matrix[:3, 0], matrix[:3, 1] = across * spacing[1], down * spacing[0]
    matrix[:3, 2], matrix[:3, 3] = step, slices[0].position
    held: dict[Path, Any] = {}

    def layer(k: int) -> Slab:
        one = slices[k]
        with library(one.path, EXPECTED):
            if one.path not in held:
                held.clear()
                held[one.path] = _pixels(one.path)
            pixels = held[one.path]
            frames = pixels.reshape(-1, rows, columns, samples)
            values = frames[one.frame, :, :, channel].T
        if (one.slope, one.intercept) == (1, 0):
            return values  # type: ignore[no-any-return]
        scaled: Slab = values * one.slope + one.intercept
        return scaled

    return Source(
        path, "DICOM", (columns, rows, len(slices)), matrix, dtype, stacked(len(slices), layer),
        kind=KINDS.get(modality, ""), unit=unit, length_unit="mm", space="LPS",
        notes=("values are stored inverted (MONOCHROME1): dark means much",) if inverted else (),
    )  # fmt: skip


def _series(path: Path) -> list[tuple[Path, Any]]:
    """The files of the series with their headers."""
    folder = path if path.is_dir() else path.parent
    own = None if path.is_dir() else _header(path)
    if own is not None and not _is_image(own):
        raise bad(str(path), "without an image", "a DICOM image")
    if own is not None and int(getattr(own, "NumberOfFrames", 1) or 1) > 1:
        return [(path, own)]
    groups: dict[str, list[tuple[Path, Any]]] = defaultdict(list)
    for file in _files(folder):
        try:
            header = _header(file)
        except InputError:
            if file == path:
                raise
            continue  # what else lies in the folder is not of the series
        if _is_image(header):
            groups[str(getattr(header, "SeriesInstanceUID", ""))].append((file, header))
    if own is not None:
        return groups[str(getattr(own, "SeriesInstanceUID", ""))]
    if not groups:
        names = ", ".join(file.name for file in _files(folder)[:3]) or "no file"
        raise bad(str(folder), f"a folder without DICOM images (there is {names})",
                  "a series' folder or TIFF stack's, or the name of one file")  # fmt: skip
    if len(groups) > 1:
        several = "; ".join(
            f"{getattr(files[0][1], 'SeriesDescription', '') or 'no name'} ({len(files)} images, "
            f"{files[0][0].name})" for files in groups.values())  # fmt: skip
        raise bad(f"{folder}", f"a folder of {len(groups)} DICOM series: {several}",
                  "one, or a file of the one that is wanted")  # fmt: skip
    return next(iter(groups.values()))


def _files(folder: Path) -> list[Path]:
    files = [file for file in sorted(folder.iterdir()) if file.is_file()]
    if len(files) > MOST_FILES:
        raise bad(str(folder), f"a folder of {len(files)} files", f"at most {MOST_FILES}")
    return files


def _header(path: Path) -> Any:
    with library(path, "a DICOM file"):
        from pydicom import dcmread

        with BoundedFile(path) as file:
            return dcmread(file, stop_before_pixels=True, specific_tags=TAGS)


def _pixels(path: Path) -> Any:
    from pydicom import dcmread

    with BoundedFile(path) as file:
        return dcmread(file).pixel_array


def _is_image(header: Any) -> bool:
    return all(getattr(header, name, None) for name in ("Rows", "Columns", "BitsAllocated"))


def _slices(path: Path, header: Any) -> Iterator[Slice]:
    frames = int(getattr(header, "NumberOfFrames", 1) or 1)
    if frames == 1:
        yield Slice(path, 0, _three(header, "ImagePositionPatient"), *_rescale(header))
        return
    groups = getattr(header, "PerFrameFunctionalGroupsSequence", None)
    if groups is None or len(groups) != frames:
        raise ValueError(f"{frames} frames without a position each")
    for frame, group in enumerate(groups):
        place = group.PlanePositionSequence[0]
        values = getattr(group, "PixelValueTransformationSequence", None)
        yield Slice(path, frame, _three(place, "ImagePositionPatient"),
                    *_rescale(values[0] if values else header))  # fmt: skip


def _rescale(header: Any) -> tuple[float, float]:
    slope = getattr(header, "RescaleSlope", None)
    intercept = getattr(header, "RescaleIntercept", None)
    return 1.0 if slope is None else float(slope), 0.0 if intercept is None else float(intercept)


def _plane(header: Any) -> tuple[NDArray[np.float64], NDArray[np.float64], list[float]]:
    """Directions along a row and down a column, and the distances of rows and of columns."""
    orientation, measures = header, header
    shared = getattr(header, "SharedFunctionalGroupsSequence", None)
    first = getattr(header, "PerFrameFunctionalGroupsSequence", None)
    for group in (*(shared or ())[:1], *(first or ())[:1]):
        orientation = next(iter(getattr(group, "PlaneOrientationSequence", ())), orientation)
        measures = next(iter(getattr(group, "PixelMeasuresSequence", ())), measures)
    cosines = [float(x) for x in orientation.ImageOrientationPatient]
    spacing = [float(x) for x in measures.PixelSpacing]
    if len(cosines) != 6 or len(spacing) != 2 or min(spacing) <= 0:
        raise ValueError(f"orientation {cosines} and pixel spacing {spacing}")
    across, down = np.array(cosines[:3]), np.array(cosines[3:])
    lengths = float(np.linalg.norm(across)), float(np.linalg.norm(down))
    if min(lengths) < 0.5:
        raise ValueError(f"orientation {cosines}")
    return across / lengths[0], down / lengths[1], spacing


def _step(
    slices: Sequence[Slice], normal: NDArray[np.float64], header: Any, path: Path
) -> NDArray[np.float64]:
    """The vector from one slice to the next; InputError where they are not evenly spaced."""
    if len(slices) == 1:
        with library(path, EXPECTED):
            return normal * float(getattr(header, "SliceThickness", None) or 1.0)
    places = np.array([float(each.position @ normal) for each in slices])
    gaps = np.diff(places)
    mean = float(gaps.mean())
    if mean <= 0 or np.any(gaps < EVEN * mean):
        raise bad(
            "the series",
            f"{len(slices)} slices of which several lie at one place",
            "one slice at each (several times or echoes are several series)",
            str(path),
        )
    uneven = np.abs(gaps - np.median(gaps)) > EVEN * np.median(gaps)
    if np.any(uneven):
        at = int(np.flatnonzero(uneven)[0])
        raise bad("the distance of its slices", f"{gaps[at]:g} mm after {slices[at].path.name}",
                  f"{float(np.median(gaps)):g} mm as between the others (is one missing?)",
                  str(path))  # fmt: skip
    step: NDArray[np.float64] = (slices[-1].position - slices[0].position) / (len(slices) - 1)
    return step


def _three(header: Any, name: str) -> NDArray[np.float64]:
    values = np.array([float(x) for x in getattr(header, name)])
    if values.shape != (3,) or not np.all(np.isfinite(values)):
        raise ValueError(f"{name} of {values.tolist()}")
    return values
