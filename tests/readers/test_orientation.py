"""Every voxel at its own place in the world: what SimpleITK writes, rotated, flipped, oblong, of
every type and byte order, is read with the same values at the same positions."""

from __future__ import annotations

from pathlib import Path

import nibabel
import numpy as np
import pytest
import SimpleITK
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from volillum_addon.readers.formats import read_volume

SHAPE = (5, 7, 4)
SPACING = (0.7, 1.9, 3.1)
ORIGIN = (12.5, -40.25, 101.0)
TYPES = (np.uint8, np.int8, np.uint16, np.int16, np.uint32, np.int32, np.float32, np.float64)


def directions(name: str) -> NDArray[np.float64]:
    """World directions of the index axes as columns."""
    return {
        "straight": np.eye(3),
        "flipped": np.diag([1.0, -1.0, -1.0]),
        "mirrored": np.diag([-1.0, 1.0, 1.0]),
        "swapped": np.eye(3)[:, [1, 2, 0]],
        "rotated": Rotation.from_euler("zyx", [30, -20, 75], degrees=True).as_matrix(),
    }[name]


def image(direction: NDArray[np.float64], dtype: type) -> SimpleITK.Image:
    """Random voxels over the whole range of the type."""
    rng = np.random.default_rng(7)
    if np.issubdtype(dtype, np.integer):
        info = np.iinfo(dtype)
        # float32 has 24 bits: larger integers would differ by their rounding.
        low, high = max(info.min, -(2**24)), min(info.max, 2**24)
        values = rng.integers(low, high, SHAPE[::-1], endpoint=True).astype(dtype)
    else:
        values = rng.normal(0, 1e4, SHAPE[::-1]).astype(np.float32).astype(dtype)
    made = SimpleITK.GetImageFromArray(values)
    made.SetSpacing(SPACING)
    made.SetOrigin(ORIGIN)
    made.SetDirection(direction.ravel().tolist())
    return made


def check(path: Path, made: SimpleITK.Image, atol: float) -> None:
    grid, about = read_volume(path)
    np.testing.assert_array_equal(grid.values, SimpleITK.GetArrayFromImage(made).T)
    for index in np.ndindex(2, 2, 2):
        corner = np.array(index) * (np.array(SHAPE) - 1)
        expected = made.TransformIndexToPhysicalPoint([int(n) for n in corner])
        np.testing.assert_allclose(grid.to_world(corner.astype(float)), expected, atol=atol)
    assert (about.space, about.shape) == ("LPS", SHAPE)
    assert about.stored == SimpleITK.GetArrayFromImage(made).dtype.name


@pytest.mark.parametrize("compressed", [False, True], ids=["plain", "packed"])
@pytest.mark.parametrize("suffix", [".nrrd", ".nhdr", ".mha", ".mhd", ".nii", ".nii.gz"])
@pytest.mark.parametrize("way", ["straight", "flipped", "mirrored", "swapped", "rotated"])
def test_positions_are_kept(tmp_path: Path, way: str, suffix: str, compressed: bool) -> None:
    made = image(directions(way), np.int16)
    path = tmp_path / f"volume{suffix}"
    SimpleITK.WriteImage(made, str(path), useCompression=compressed)
    # NIfTI keeps a quaternion and an origin in single precision.
    check(path, made, atol=1e-4 if ".nii" in suffix else 1e-9)


@pytest.mark.parametrize("suffix", [".nrrd", ".mha", ".nii"])
@pytest.mark.parametrize("dtype", TYPES, ids=lambda each: each.__name__)
def test_types_are_kept(tmp_path: Path, dtype: type, suffix: str) -> None:
    made = image(np.eye(3), dtype)
    path = tmp_path / f"volume{suffix}"
    SimpleITK.WriteImage(made, str(path))
    check(path, made, atol=1e-4)


@pytest.mark.parametrize("order", ["<", ">"], ids=["little", "big"])
def test_slope_and_intercept_and_byte_order_of_nifti(tmp_path: Path, order: str) -> None:
    stored = np.arange(-60, 60, dtype=np.int16).reshape(4, 5, 6)
    header = nibabel.Nifti1Header(endianness=order)
    header.set_data_dtype(np.dtype(order + "i2"))
    header.set_data_shape(stored.shape)
    header.set_slope_inter(2.5, -1000.0)
    header.set_xyzt_units("micron")
    made = nibabel.Nifti1Image(stored, np.diag([2.0, 3.0, 4.0, 1.0]), header)
    path = tmp_path / "scaled.nii"
    # Written by hand after nibabel's header: nibabel would choose a scale of its own.
    with path.open("wb") as file:
        head = made.header.copy()
        head["scl_slope"], head["scl_inter"], head["magic"] = 2.5, -1000.0, b"n+1"
        head["vox_offset"] = 352
        file.write(head.binaryblock + bytes(4))
        file.write(stored.astype(order + "i2").tobytes(order="F"))
    grid, about = read_volume(path)
    np.testing.assert_array_equal(grid.values, stored * 2.5 - 1000)
    assert about.length_unit == "um"
    assert (about.low, about.high) == (-1150, -852.5)


def test_nifti_without_a_world_keeps_its_axes(tmp_path: Path) -> None:
    made = nibabel.Nifti1Image(np.ones((3, 4, 5), np.uint8), None)
    made.header["pixdim"][1:4] = 0.5, 0.25, 2
    made.header["qform_code"] = made.header["sform_code"] = 0
    made.to_filename(tmp_path / "bare.nii")
    grid, about = read_volume(tmp_path / "bare.nii")
    np.testing.assert_array_equal(grid.index_to_world, np.diag([0.5, 0.25, 2, 1]))
    assert about.space == ""


@pytest.mark.parametrize(
    ("space", "signs"),
    [
        ("right-anterior-superior", (-1, -1, 1)),
        ("left-anterior-superior", (1, -1, 1)),
        ("left-posterior-superior", (1, 1, 1)),
    ],
)
def test_nrrd_spaces_become_one(tmp_path: Path, space: str, signs: tuple[int, int, int]) -> None:
    values = np.arange(24, dtype=">i2").reshape((2, 3, 4), order="F")
    header = (
        "NRRD0004\n# a comment\ntype: short\ndimension: 3\nsizes: 2 3 4\nencoding: raw\n"
        f"endian: big\nspace: {space}\nspace directions: (0,2,0) (3,0,0) (0,0,-5)\n"
        'space origin: (10,20,30)\nspace units: "mm" "mm" "mm"\nsample units: "HU"\n\n'
    )
    path = tmp_path / "world.nrrd"
    path.write_bytes(header.encode() + values.tobytes(order="F"))
    grid, about = read_volume(path)
    np.testing.assert_array_equal(grid.values, values)
    place = np.array([10, 20, 30]) + 1 * np.array([0, 2, 0]) + 2 * np.array([3, 0, 0])
    np.testing.assert_allclose(grid.to_world(np.array([1.0, 2, 0])), place * signs)
    assert (about.unit, about.length_unit, about.space) == ("HU", "mm", "LPS")
