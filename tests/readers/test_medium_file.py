"""From a volume and a transfer function to the coefficients that are rendered and baked."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from volillum_addon.bake.grids import read_grid
from volillum_addon.core.control import Cancelled, Control
from volillum_addon.core.errors import InputError
from volillum_addon.core.grid import Grid
from volillum_addon.core.transfer_function import TransferFunction
from volillum_addon.readers import transfer_presets
from volillum_addon.readers.formats import import_volume, read_volume, stem_of
from volillum_addon.readers.frames import VolumeFiles
from volillum_addon.readers.imported import About
from volillum_addon.readers.matter import as_it_is, read_matter
from volillum_addon.readers.medium_file import apply, is_medium, medium_of, write_medium

RAMP = TransferFunction(
    values=[-1000, 0, 500], density=[0, 0.25, 1], albedo=[[0.2, 0.4, 0.8]] * 2 + [[1, 0.9, 0.5]],
    per_voxel=2.0,
)  # fmt: skip


def volume(directory: Path) -> Path:
    """An array with a border of 0, which is not clear here, in voxels of 1 x 1 x 1."""
    values = np.zeros((8, 6, 4), np.float32)
    values[2:6, 2:4, 1:3] = np.linspace(-1100, 600, 16).reshape(4, 2, 2)
    np.save(directory / "ct.npy", values)
    return directory / "ct.npy"


def full(path: Path, name: str, shape: tuple[int, int, int]) -> np.ndarray:
    """A grid of the file on the whole lattice."""
    grid = read_grid(path, name)
    low = np.round(grid.index_to_world[:3, 3]).astype(int)
    result = np.zeros((*shape, *grid.values.shape[3:]), np.float32)
    result[tuple(slice(a, a + n) for a, n in zip(low, grid.shape, strict=True))] = grid.values
    return result


def test_the_file_holds_the_transfer_functions_medium(tmp_path: Path) -> None:
    grid, about = read_volume(volume(tmp_path))
    path = write_medium((grid, about), RAMP, tmp_path, "ct")
    medium = RAMP.medium(grid)
    np.testing.assert_array_equal(full(path, "density", grid.shape), medium.sigma_t.values)
    np.testing.assert_array_equal(full(path, "scattering", grid.shape), medium.sigma_s.values)
    absorbed = medium.sigma_t.values[..., None] - medium.sigma_s.values
    np.testing.assert_array_equal(full(path, "absorption", grid.shape), np.maximum(absorbed, 0))
    assert is_medium(path)
    # The border's 0 is water and not nothing: it is matter here.
    assert medium.sigma_t.values[0, 0, 0] == np.float32(0.5)
    assert read_grid(path, "density").shape == grid.shape


def test_the_same_is_found_and_another_is_another_file(tmp_path: Path) -> None:
    source = read_volume(volume(tmp_path))
    path = write_medium(source, RAMP, tmp_path, "ct")
    time = path.stat().st_mtime_ns
    assert write_medium(source, replace(RAMP, summary="other words"), tmp_path, "ct") == path
    assert path.stat().st_mtime_ns == time
    assert write_medium(source, replace(RAMP, per_voxel=3.0), tmp_path, "ct") != path
    other = source[0].with_values(source[0].values + 1)
    assert write_medium((other, source[1]), RAMP, tmp_path, "ct") != path


def test_a_coarser_level_keeps_the_optical_depth(tmp_path: Path) -> None:
    np.save(tmp_path / "even.npy", np.full((8, 8, 8), 500, np.float32))
    depths = []
    for level in (0, 1, 2):
        medium = medium_of(*read_volume(tmp_path / "even.npy", level), RAMP)
        sigma_t = medium.sigma_t
        depths.append(float(sigma_t.values[0, 0].sum() * sigma_t.voxel_size[2]))
    np.testing.assert_allclose(depths, 8 * 2.0, rtol=1e-6)


def test_a_physical_function_is_an_extinction(tmp_path: Path) -> None:
    np.save(tmp_path / "cloud.npy", np.full((3, 3, 3), 0.125, np.float32))
    (tmp_path / "cloud.json").write_text(
        '{"spacing": [20, 20, 40], "unit": "1/m", "length_unit": "m", "kind": "cloud"}'
    )
    grid, about = read_volume(tmp_path / "cloud.npy")
    assert transfer_presets.default_name(about) == "cloud"
    medium = medium_of(grid, about, transfer_presets.load("cloud", about))
    np.testing.assert_allclose(medium.sigma_t.values, 0.125, rtol=1e-6)
    np.testing.assert_allclose(medium.sigma_s.values, 0.999 * 0.125, rtol=1e-6)


def test_an_imported_file_is_seen_as_its_source(tmp_path: Path) -> None:
    path = volume(tmp_path)
    import_volume(path, tmp_path / "in.vdb")
    seen = apply(tmp_path / "in.vdb", RAMP, tmp_path / "out")
    direct = write_medium(read_volume(path), RAMP, tmp_path, "in")
    assert seen.name == direct.name
    for name in ("density", "scattering", "absorption"):
        np.testing.assert_array_equal(read_grid(seen, name).values, read_grid(direct, name).values)


def test_nothing_left_is_said_and_nothing_written(tmp_path: Path) -> None:
    path = volume(tmp_path)
    clear = replace(RAMP, values=[5000, 6000, 7000])
    with pytest.raises(InputError, match=r"makes all of ct\.npy clear.*between -1100 and 600"):
        write_medium(read_volume(path), clear, tmp_path / "out", "ct")
    assert not (tmp_path / "out").exists()


def test_cancelling_leaves_nothing(tmp_path: Path) -> None:
    source = read_volume(volume(tmp_path))
    control = Control()
    control.cancel()
    with pytest.raises(Cancelled):
        write_medium(source, RAMP, tmp_path / "out", "ct", control)
    assert not (tmp_path / "out").exists()


def test_a_vdb_without_a_transfer_function_is_lit_as_it_is(tmp_path: Path) -> None:
    path = volume(tmp_path)
    medium = VolumeFiles(write_medium(read_volume(path), RAMP, tmp_path, "ct"))
    assert as_it_is(medium, 0, None)
    assert not as_it_is(medium, 1, None)
    assert not as_it_is(medium, 0, "smoke")
    assert not as_it_is(VolumeFiles(path), 0, None)
    # An import's values are Hounsfield units here, and no densities.
    import_volume(path, tmp_path / "in.vdb")
    assert not as_it_is(VolumeFiles(tmp_path / "in.vdb"), 0, None)


def test_values_and_medium_are_written_together_or_not_at_all(tmp_path: Path) -> None:
    files, out = VolumeFiles(volume(tmp_path)), tmp_path / "out"
    made = read_matter(files, out, transfer="ct_skin")
    assert sorted(out.iterdir()) == sorted([made.values, made.medium])
    assert made.medium.name.startswith("ct.")
    assert made.files.stem == "ct"
    np.save(tmp_path / "dark.npy", np.full((3, 3, 3), -1000, np.float32))
    with pytest.raises(InputError, match=r"makes all of dark\.npy clear"):
        read_matter(VolumeFiles(tmp_path / "dark.npy"), tmp_path / "none", transfer="ct_bone")
    assert not (tmp_path / "none").exists()


def about(counts: tuple[int, ...], low: float, high: float) -> About:
    return About("x", "x", (1, 1, 1), "int16", low, high, kind="mr", histogram=counts)


def test_a_relative_preset_ends_at_the_bright_voxels() -> None:
    # A background of half the voxels, 1000 of tissue in the second interval of 0 to 4000, and one
    # speck at the top, which is less than the share that is left out.
    found = transfer_presets.load("mri", about((1001, 1000, 0, 1), 0.0, 4000.0))
    assert np.asarray(found.values)[0] == 0
    assert np.asarray(found.values)[-1] == 2000
    # Air that is not 0 but what there is most of: its value is where the function begins.
    air = transfer_presets.load("solid", about((5, 1000, 30, 200, 200, 100, 20, 0), 0.0, 800.0))
    assert np.asarray(air.values)[0] == 100
    # What there is most of may also be the matter.
    matter = transfer_presets.load("solid", about((5, 10, 10, 5, 9000, 100, 20, 0), 0.0, 800.0))
    assert np.asarray(matter.values)[0] == 0
    # In a volume of one value there is no scale; it must still be a function.
    flat = transfer_presets.load("mri", about((8, 0, 0, 0), 5.0, 5.0))
    assert np.all(np.diff(np.asarray(flat.values)) > 0)


@pytest.mark.parametrize("name", transfer_presets.names())
def test_presets_fit_any_volume(name: str) -> None:
    found = transfer_presets.load(name, about((10, 20, 5, 1), -3.0, 40.0))
    assert found.summary.endswith(".")
    assert TransferFunction.from_json(found.as_json()).as_json() == found.as_json()


@pytest.mark.parametrize("kind", ["bone", "skin", "lung"])
def test_hounsfield_presets_keep_air_clear(kind: str) -> None:
    found = transfer_presets.load(f"ct_{kind}", about((1,), 0, 1))
    # Air, and the scanner's mark for what it has not seen; then compact bone.
    assert not found.densities(np.float32([-3024, -1024, -1000, -950])).any()
    assert found.densities(np.float32([1200]))[0] > 0


@pytest.mark.parametrize(
    ("kind", "unit", "stored", "name"),
    [
        ("ct", "HU", "int16", "ct_bone"),
        ("ct", "", "int16", "solid"),
        ("mr", "", "uint8", "mri"),
        ("microscopy", "", "uint16", "microscopy"),
        ("", "", "float32", "smoke"),
        ("", "", "uint8", "solid"),
    ],
)
def test_what_a_kind_of_data_is_seen_through(kind: str, unit: str, stored: str, name: str) -> None:
    known = replace(about((1,), 0, 1), kind=kind, unit=unit, stored=stored)
    assert transfer_presets.default_name(known) == name


def test_a_damaged_preset_is_named(tmp_path: Path) -> None:
    path = tmp_path / "mine.json"
    for text in ("{", "[]", '{"points": [[1, 2]], "per_voxel": 1}', '{"points": 5}'):
        path.write_text(text)
        with pytest.raises(InputError, match=r"mine\.json"):
            transfer_presets.load_file(path, about((1,), 0, 1))


@pytest.mark.parametrize(
    ("name", "stem"),
    [("a.nii.gz", "a"), ("b.c.nrrd", "b.c"), ("ct", "ct"), ("IM0001", "IM0001"), (".vdb", ".vdb")],
)
def test_stems(name: str, stem: str) -> None:
    assert stem_of(Path(name)) == stem


def test_a_grid_of_vectors_is_no_data() -> None:
    grid = Grid(np.zeros((2, 2, 2, 3), np.float32), np.eye(4), "velocity")
    with pytest.raises(InputError, match="velocity's channels is 3"):
        medium_of(grid, about((1,), 0, 1), RAMP)
