"""A DICOM series as a scanner would write it, for tests."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pydicom
from numpy.typing import NDArray
from pydicom.uid import CTImageStorage, ExplicitVRLittleEndian, RLELossless, generate_uid
from scipy.spatial.transform import Rotation

ROWS, COLUMNS, SLICES = 5, 8, 6
SERIES = generate_uid()


def write_slice(
    folder: Path,
    number: int,
    pixels: NDArray[np.int16],
    axes: NDArray[np.float64],
    position: NDArray[np.float64],
    **changes: Any,
) -> Path:
    """A CT slice; `axes` are the directions along a row and down a column."""
    data = pydicom.Dataset()
    data.file_meta = pydicom.dataset.FileMetaDataset()
    data.file_meta.TransferSyntaxUID = ExplicitVRLittleEndian
    data.file_meta.MediaStorageSOPClassUID = data.SOPClassUID = CTImageStorage
    data.file_meta.MediaStorageSOPInstanceUID = data.SOPInstanceUID = generate_uid()
    data.SeriesInstanceUID, data.StudyInstanceUID = SERIES, SERIES
    data.Modality, data.InstanceNumber = "CT", number
    data.Rows, data.Columns = pixels.shape
    data.SamplesPerPixel, data.PhotometricInterpretation = 1, "MONOCHROME2"
    data.BitsAllocated, data.BitsStored, data.HighBit = 16, 16, 15
    data.PixelRepresentation = 1
    data.RescaleSlope, data.RescaleIntercept = 2, -1024
    data.PixelSpacing = [0.8, 0.5]
    data.ImageOrientationPatient = [round(float(x), 10) for x in axes.ravel()]
    data.ImagePositionPatient = [round(float(x), 10) for x in position]
    data.PixelData = pixels.astype("<i2").tobytes()
    for name, value in changes.items():
        setattr(data, name, value)
    path = folder / f"IM{len(list(folder.iterdir())):04d}.dcm"
    if changes.get("packed"):
        del data.packed
        data.compress(RLELossless)
    data.save_as(path, enforce_file_format=True)
    return path


def series(folder: Path, skew: float = 0.0, **changes: Any) -> NDArray[np.int16]:
    """Slices under names of another order than theirs; their numbers [slice, row, column].

    `skew`: how far each slice lies further down than the one before (a tilted gantry), mm.
    """
    rng = np.random.default_rng(11)
    pixels = rng.integers(-500, 2000, (SLICES, ROWS, COLUMNS)).astype(np.int16)
    turn = Rotation.from_euler("xz", [20, 30], degrees=True).as_matrix()
    for k in rng.permutation(SLICES):
        position = np.array([-100.0, 50, 7]) + turn @ (0, skew * k, 2.5 * k)
        write_slice(folder, SLICES - int(k), pixels[k], turn[:, :2].T, position, **changes)
    return pixels
