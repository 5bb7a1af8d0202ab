"""DICOM series and TIFF stacks, written and read by others too."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import SimpleITK
import tifffile
from dicom_files import COLUMNS, ROWS, SLICES, series, write_slice
from PIL import Image
from pydicom.uid import generate_uid
from scipy.spatial.transform import Rotation

from volillum_addon.core.errors import InputError
from volillum_addon.readers.formats import open_volume, read_volume
from volillum_addon.readers.source import Options


def test_a_packed_series_is_the_same(tmp_path: Path) -> None:
    pixels = series(tmp_path, packed=True)
    np.testing.assert_array_equal(read_volume(tmp_path)[0].values, pixels.T * 2.0 - 1024)


def test_a_dicom_series_is_as_itk_reads_it(tmp_path: Path) -> None:
    pixels = series(tmp_path)
    grid, about = read_volume(tmp_path)
    reader = SimpleITK.ImageSeriesReader()
    reader.SetFileNames(reader.GetGDCMSeriesFileNames(str(tmp_path)))
    image = reader.Execute()
    np.testing.assert_array_equal(grid.values, SimpleITK.GetArrayFromImage(image).T)
    np.testing.assert_array_equal(grid.values, pixels.T * 2.0 - 1024)
    for corner in ([0, 0, 0], [COLUMNS - 1, 0, 0], [0, ROWS - 1, 0], [0, 0, SLICES - 1]):
        # Positions are text of ten digits.
        np.testing.assert_allclose(
            grid.to_world(np.array(corner, float)),
            image.TransformIndexToPhysicalPoint(corner),
            atol=1e-6,
        )
    assert (about.kind, about.unit, about.length_unit, about.space) == ("ct", "HU", "mm", "LPS")


def test_a_tilted_gantry_is_a_sheared_grid(tmp_path: Path) -> None:
    series(tmp_path, skew=0.7)
    grid, _ = read_volume(tmp_path)
    turn = Rotation.from_euler("xz", [20, 30], degrees=True).as_matrix()
    np.testing.assert_allclose(grid.index_to_world[:3, 2], turn @ (0, 0.7, 2.5), atol=1e-8)
    np.testing.assert_allclose(grid.index_to_world[:3, 0], turn[:, 0] * 0.5, atol=1e-8)
    np.testing.assert_allclose(grid.index_to_world[:3, 1], turn[:, 1] * 0.8, atol=1e-8)


def test_a_file_stands_for_its_series_and_other_files_are_left_alone(tmp_path: Path) -> None:
    series(tmp_path)
    (tmp_path / "notes.txt").write_text("nothing")
    other = write_slice(tmp_path, 1, np.ones((4, 4), np.int16), np.eye(3)[:2], np.zeros(3),
                        SeriesInstanceUID=generate_uid(), SeriesDescription="scout")  # fmt: skip
    with pytest.raises(InputError, match=r"2 DICOM series: .*scout \(1 images"):
        open_volume(tmp_path)
    one = next(file for file in tmp_path.glob("*.dcm") if file != other)
    assert read_volume(one)[0].shape == (COLUMNS, ROWS, SLICES)
    assert read_volume(other)[0].shape == (4, 4, 1)


def test_a_file_without_a_suffix_is_known_by_its_first_bytes(tmp_path: Path) -> None:
    series(tmp_path)
    for file in tmp_path.glob("*.dcm"):
        file.rename(file.with_suffix(""))
    assert open_volume(next(tmp_path.iterdir())).format == "DICOM"


def test_a_missing_slice_is_named(tmp_path: Path) -> None:
    pixels = np.zeros((4, 4), np.int16)
    for k in (0, 1, 2, 4, 5):
        write_slice(tmp_path, k, pixels, np.eye(3)[:2], np.array([0.0, 0, 3 * k]))
    with pytest.raises(InputError, match=r"6 mm after .*expected 3 mm.*missing"):
        read_volume(tmp_path)


def test_two_slices_at_one_place_are_refused(tmp_path: Path) -> None:
    pixels = np.zeros((4, 4), np.int16)
    for k in (0, 1, 1, 2):
        write_slice(tmp_path, k, pixels, np.eye(3)[:2], np.array([0.0, 0, 3 * k]))
    with pytest.raises(InputError, match="several lie at one place"):
        read_volume(tmp_path)


def test_a_slice_of_another_size_is_refused(tmp_path: Path) -> None:
    series(tmp_path)
    write_slice(tmp_path, 9, np.zeros((4, 4), np.int16), np.eye(3)[:2], np.zeros(3))
    with pytest.raises(InputError, match="different sizes"):
        read_volume(tmp_path)


STACK = np.random.default_rng(5).integers(0, 60000, (6, 5, 7)).astype(np.uint16)


@pytest.mark.parametrize("order", ["<", ">"], ids=["little", "big"])
@pytest.mark.parametrize("compression", [None, "zlib"])
def test_an_imagej_stack(tmp_path: Path, compression: str | None, order: str) -> None:
    path = tmp_path / "stack.tif"
    options: Any = {"imagej": order == ">", "byteorder": order, "compression": compression}
    if order == ">":  # ImageJ's own are big-endian
        options |= {"resolution": (4.0, 2.0), "metadata": {"spacing": 1.5, "unit": "um"}}
    tifffile.imwrite(path, STACK, photometric="minisblack", **options)
    grid, about = read_volume(path)
    np.testing.assert_array_equal(grid.values, STACK.T)
    size = (0.25, 0.5, 1.5) if order == ">" else (1, 1, 1)
    np.testing.assert_allclose(grid.voxel_size, size)
    assert about.length_unit == ("um" if order == ">" else "")
    assert bool(about.notes) == (order == "<")


@pytest.mark.parametrize("packing", ["tiff_lzw", "packbits", "tiff_adobe_deflate"])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_packings_that_others_write(tmp_path: Path, packing: str, dtype: type) -> None:
    stack = (STACK % 251).astype(dtype)
    first, *rest = (Image.fromarray(page) for page in stack)
    first.save(tmp_path / "a.tif", save_all=True, append_images=rest, compression=packing)
    np.testing.assert_array_equal(read_volume(tmp_path / "a.tif")[0].values, stack.T)


def test_an_ome_stack_of_channels(tmp_path: Path) -> None:
    path = tmp_path / "stack.ome.tif"
    channels = np.stack([STACK, 65535 - STACK])
    tifffile.imwrite(path, channels, ome=True, photometric="minisblack", metadata={
        "axes": "CZYX", "PhysicalSizeX": 0.1, "PhysicalSizeXUnit": "µm", "PhysicalSizeY": 0.2,
        "PhysicalSizeYUnit": "µm", "PhysicalSizeZ": 0.5, "PhysicalSizeZUnit": "µm"})  # fmt: skip
    with pytest.raises(InputError, match="2 channels; expected a choice"):
        read_volume(path)
    grid, about = read_volume(path, options=Options(channel=1))
    np.testing.assert_array_equal(grid.values, 65535 - STACK.T)
    np.testing.assert_allclose(grid.voxel_size, (0.1, 0.2, 0.5))
    assert (about.kind, about.length_unit) == ("microscopy", "um")


def test_a_folder_of_pages_is_in_the_order_of_its_numbers(tmp_path: Path) -> None:
    many = np.tile(STACK, (2, 1, 1))
    for k, page in enumerate(many):
        tifffile.imwrite(tmp_path / f"slice{k}.tif", page + np.uint16(k), compression="zlib")
    grid, _ = read_volume(tmp_path)
    expected = np.stack([page + np.uint16(k) for k, page in enumerate(many)])
    np.testing.assert_array_equal(grid.values, expected.T)


@pytest.mark.parametrize("axes", ["xyz", "zyx"])
def test_numpy_arrays_in_either_order(tmp_path: Path, axes: str) -> None:
    np.save(tmp_path / "a.npy", STACK)
    if axes == "zyx":
        (tmp_path / "a.json").write_text('{"axes": "zyx", "spacing": [1, 2, 3]}')
    grid, about = read_volume(tmp_path / "a.npy")
    np.testing.assert_array_equal(grid.values, STACK.T if axes == "zyx" else STACK)
    np.testing.assert_allclose(grid.voxel_size, (1, 2, 3) if axes == "zyx" else (1, 1, 1))
    assert about.stored == "uint16"


def test_an_npz_of_several_arrays_asks_which(tmp_path: Path) -> None:
    np.savez_compressed(tmp_path / "a.npz", first=STACK, second=STACK + 1)
    with pytest.raises(InputError, match="first, second"):
        read_volume(tmp_path / "a.npz")
    grid, _ = read_volume(tmp_path / "a.npz", options=Options(grid="second"))
    np.testing.assert_array_equal(grid.values, STACK + 1)
