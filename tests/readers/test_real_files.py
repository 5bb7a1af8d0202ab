"""The product's readers beside other people's, or a few lines by hand, on real volumes."""

from __future__ import annotations

import csv
import gzip
import json
from pathlib import Path

import numpy as np
import pytest
import SimpleITK
from expected_skips import third_party_data
from numpy.typing import NDArray
from PIL import Image

from volillum_addon.readers.formats import read_volume

Values = NDArray[np.float64]


def itk(path: Path) -> tuple[Values, Values]:
    """Values [i, j, k] and index to world (LPS) by SimpleITK."""
    image = SimpleITK.ReadImage(str(path))
    matrix = np.eye(4)
    matrix[:3, :3] = np.array(image.GetDirection()).reshape(3, 3) * image.GetSpacing()
    matrix[:3, 3] = image.GetOrigin()
    return SimpleITK.GetArrayFromImage(image).T.astype(np.float64), matrix


def with_dotted(directory: Path, name: str) -> Path:
    """A copy of a detached pair where SimpleITK finds it (it wants to write nowhere)."""
    for file in third_party_data(name).iterdir():
        (directory / file.name).write_bytes(file.read_bytes())
    return directory


@pytest.mark.parametrize(
    "name", ["pelvis_ct/example_ct.nii.gz", "engine_ct/engine.nii.gz", "fuel_sim/fuel.nii.gz"]
)
def test_nifti_is_as_itk_reads_it(name: str) -> None:
    path = third_party_data(name)
    values, matrix = itk(path)
    grid, about = read_volume(path)
    np.testing.assert_array_equal(grid.values, values)
    # NIfTI stores the matrix as float32, and ITK takes it from the quaternion where there is one.
    np.testing.assert_allclose(grid.index_to_world, matrix, rtol=0, atol=1e-4)
    assert about.space == "LPS"


def test_the_pelvis_is_in_hounsfield_units() -> None:
    grid, about = read_volume(third_party_data("pelvis_ct/example_ct.nii.gz"))
    assert (about.unit, about.kind, about.low, about.high) == ("HU", "ct", -1207, 3382)
    # The corners of the picture are air.
    assert np.all(np.abs(grid.values[:3, :3] + 1000) < 100)


@pytest.mark.parametrize("name", ["engine_ct/engine.nii.gz", "headsq_ct/index.json"])
def test_volumes_of_other_scales_are_not_called_hounsfield(name: str) -> None:
    assert read_volume(third_party_data(name))[1].unit == ""


def test_the_big_endian_tooth_is_as_itk_reads_it() -> None:
    path = third_party_data("tooth_ct/tooth.nhdr")
    grid, about = read_volume(path)
    np.testing.assert_array_equal(grid.values, itk(path)[0])
    by_hand = np.fromfile(path.with_name("tooth.raw"), ">u2").reshape((103, 94, 161), order="F")
    np.testing.assert_array_equal(grid.values, by_hand)
    np.testing.assert_array_equal(grid.index_to_world, np.eye(4))
    assert about.stored == "uint16"


def test_the_head_is_turned_by_30_degrees() -> None:
    folder = third_party_data("headsq_ct")
    grid, _ = read_volume(folder / "index.json")
    data = gzip.decompress(next(folder.glob("*.gz")).read_bytes())
    by_hand = np.frombuffer(data, "<i2").reshape((64, 64, 93), order="F")
    np.testing.assert_array_equal(grid.values, by_hand)
    # By hand: stepping along i goes (cos 30, sin 30, 0), along j (-sin 30, cos 30, 0), as written
    # in the file with three digits.
    step = grid.to_world(np.eye(3)) - grid.to_world(np.zeros(3))
    expected = [3.2 * np.array([0.866, 0.5, 0]), 3.2 * np.array([-0.5, 0.866, 0]), [0, 0, 1.5]]
    np.testing.assert_allclose(step, expected, atol=1e-12)
    header = json.loads((folder / "index.json").read_text())
    assert header["direction"][:2] == [0.866, 0.5]


def test_the_brain_is_what_follows_62_bytes() -> None:
    path = third_party_data("brainsmall_mri/brainsmall.den")
    by_hand = np.fromfile(path, np.uint8, offset=62).reshape((84, 128, 128)).T
    np.testing.assert_array_equal(read_volume(path)[0].values, by_hand)


def test_the_confocal_stack_is_as_pillow_reads_it() -> None:
    path = third_party_data("flybrain_confocal/flybrain.tif")
    grid, about = read_volume(path)
    with Image.open(path) as stack:
        for k in range(stack.n_frames):
            stack.seek(k)
            np.testing.assert_array_equal(grid.values[:, :, k], np.asarray(stack).T)
        # Pixels per unit along a row, in a tag, and ImageJ's words for the rest.
        across = 1 / float(stack.tag_v2[282])
        words = stack.tag_v2[270]
    assert grid.shape == (256, 256, 57)
    assert "unit=um" in words
    assert f"spacing={grid.voxel_size[2]:.10g}"[:16] in words
    np.testing.assert_allclose(grid.voxel_size[:2], across, rtol=1e-6)
    assert (about.length_unit, about.kind) == ("um", "microscopy")


def test_the_protein_has_its_known_statistics() -> None:
    # From the data's own listing: least, greatest and mean value.
    grid, _ = read_volume(third_party_data("neghip_sim/neghip.slc"))
    values = grid.values.astype(np.float64)
    assert grid.shape == (66, 66, 66)
    assert (values.min(), values.max()) == (0, 255)
    assert values.mean() == pytest.approx(16.78, abs=0.005)
    # A slice out of step would show: in all directions neighbours are equally alike.
    rough = [float(np.abs(np.diff(values, axis=axis)).mean()) for axis in range(3)]
    assert max(rough) < 1.5 * min(rough)


def test_the_cloud_is_its_droplets_extinction() -> None:
    path = third_party_data("rico_cloud/rico122x106x39.txt")
    grid, about = read_volume(path)
    with path.open(newline="") as file:
        rows = list(csv.reader(file))[5:]
    found = np.zeros(grid.shape)
    for i, j, k, water, radius in rows:
        # Geometric optics: sigma = 3 LWC / (2 rho r); g/m^3 of water of 1e6 g/m^3, micrometres.
        found[int(i), int(j), int(k)] = 3 * float(water) / (2 * 1e6 * float(radius) * 1e-6)
    np.testing.assert_allclose(grid.values, found, rtol=1e-6)
    np.testing.assert_allclose(grid.voxel_size, (20, 20, 40))
    np.testing.assert_allclose(grid.to_world(np.zeros(3)), (0, 0, 440))
    assert (about.unit, about.length_unit, about.kind) == ("1/m", "m", "cloud")


@pytest.mark.parametrize(
    ("name", "grid", "shape"),
    [
        ("smoke_vdb/smoke.vdb", None, (111, 222, 112)),
        ("density_heat_vdb/densityAndHeat.vdb", None, (23, 23, 42)),
        ("density_heat_vdb/densityAndHeat.vdb", "heat", (22, 21, 32)),
    ],
)
def test_vdb_is_as_openvdb_probes_it(
    name: str, grid: str | None, shape: tuple[int, int, int]
) -> None:
    from volillum_addon.bake.openvdb_module import openvdb
    from volillum_addon.readers.source import Options

    path = third_party_data(name)
    volume, _ = read_volume(path, options=Options(grid=grid))
    assert volume.shape == shape
    stored = openvdb().read(str(path), grid or "density")
    access, (low, _) = stored.getConstAccessor(), stored.evalActiveVoxelBoundingBox()
    rng = np.random.default_rng(1)
    for index in rng.integers(0, shape, (500, 3)):
        place = tuple(int(a + b) for a, b in zip(index, low, strict=True))
        assert volume.values[tuple(index)] == np.float32(access.getValue(place))
        np.testing.assert_allclose(
            volume.to_world(index.astype(float)), stored.transform.indexToWorld(place), rtol=1e-6
        )
    del stored, access
