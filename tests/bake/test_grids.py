"""Grids of stock VDB files: what is read, and what is refused in one line."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bake.conftest import blob, random_values

from volillum_addon.bake.grids import grid_names, read_grid, to_vdb
from volillum_addon.bake.openvdb_module import openvdb
from volillum_addon.core.errors import InputError
from volillum_addon.core.grid import Grid
from volillum_addon.core.medium import Medium


def write(path: Path, *grids: Any) -> Path:
    openvdb().write(str(path), list(grids))
    return path


def stock(kind: str, values: np.ndarray, name: str = "density") -> Any:
    grid = getattr(openvdb(), kind)()
    grid.copyFromArray(np.ascontiguousarray(values))
    grid.name = name
    return grid


@pytest.mark.parametrize("channels", [1, 3])
def test_grid_round_trip(channels: int, transform: np.ndarray, tmp_path: Path) -> None:
    shape = (5, 7, 11) if channels == 1 else (5, 7, 11, 3)
    given = Grid(random_values(*shape) - 0.5, transform, "heat")
    read = read_grid(write(tmp_path / "x.vdb", to_vdb(given, "heat")))
    np.testing.assert_array_equal(read.values, given.values)
    assert read.name == "heat"
    # The linear part is found to a few epsilons of itself and of the origin / 2^20; the origin to
    # its own epsilon.
    voxel = given.voxel_size.max()
    origin = np.abs(transform[:3, 3]).max()
    np.testing.assert_allclose(
        read.index_to_world[:3, :3], transform[:3, :3], rtol=0, atol=1e-15 * (4 * voxel + origin)
    )
    np.testing.assert_allclose(read.index_to_world[:3, 3], transform[:3, 3], rtol=1e-15)


def test_the_box_of_active_voxels_lies_where_it_was(transform: np.ndarray, tmp_path: Path) -> None:
    given = blob(transform)
    read = read_grid(write(tmp_path / "x.vdb", to_vdb(given, "density")))
    assert read.shape == (8, 5, 9)  # 2 to 9, 3 to 7, 4 to 12
    assert read.values[7, 1, 8] == 0.5
    expected = given.to_world(np.array([9.0, 4.0, 12.0]))
    # Rounding of coordinates up to 3e5.
    np.testing.assert_allclose(read.to_world(np.array([7.0, 1.0, 8.0])), expected, atol=1e-10)


def test_double_and_half_grids_become_float(tmp_path: Path) -> None:
    values = random_values(3, 4, 5).astype(np.float64) + 1e-12
    read = read_grid(write(tmp_path / "d.vdb", stock("DoubleGrid", values)))
    np.testing.assert_array_equal(read.values, values.astype(np.float32))
    half = stock("FloatGrid", values.astype(np.float32))
    half.saveFloatAsHalf = True
    read = read_grid(write(tmp_path / "h.vdb", half))
    np.testing.assert_allclose(read.values, values, rtol=2.0**-11)


def test_the_grid_is_the_only_one_or_density_or_named(tmp_path: Path) -> None:
    a, b = random_values(2, 3, 4), random_values(3, 4, 5)
    path = write(tmp_path / "x.vdb", stock("FloatGrid", a, "heat"), stock("FloatGrid", b))
    assert sorted(grid_names(path)) == ["density", "heat"]
    assert read_grid(path).shape == (3, 4, 5)
    assert read_grid(path, "heat").shape == (2, 3, 4)
    with pytest.raises(InputError, match=r"grid 'mist' is missing; expected one of .*'heat'"):
        read_grid(path, "mist")
    assert read_grid(write(tmp_path / "y.vdb", stock("FloatGrid", a, "heat"))).shape == (2, 3, 4)


def level_set() -> Any:
    return openvdb().createLevelSetSphere(radius=5.0)


def with_value(value: float) -> Callable[[], Any]:
    def make() -> Any:
        grid = stock("FloatGrid", random_values(3, 4, 5))
        # copyFromArray would make a NaN the background.
        grid.getAccessor().setValueOn((1, 2, 3), value)
        return grid

    return make


def frustum() -> Any:
    grid = stock("FloatGrid", random_values(3, 4, 5))
    grid.transform = openvdb().createFrustumTransform(
        (0, 0, 0), (8, 8, 8), taper=0.5, depth=1.0, voxelSize=0.1
    )
    return grid


def endless() -> Any:
    grid = openvdb().FloatGrid(0.3)
    grid.copyFromArray(random_values(3, 4, 5))
    return grid


def far_apart() -> Any:
    grid = openvdb().FloatGrid()
    for place in (0, 100000):
        grid.fill((place, place, place), (place + 1, place + 1, place + 1), 1.0)
    return grid


BAD_GRIDS = {
    "NaN": (with_value(np.nan), r"holds 1 NaN voxel, first at \(1, 2, 3\); expected finite"),
    "infinite": (with_value(np.inf), r"holds 1 infinite voxel, first at \(1, 2, 3\); expected"),
    "Vec3d": (
        lambda: stock("Vec3DGrid", random_values(3, 4, 5, 3).astype(np.float64)),
        r"type is vec3d; expected a Vec3S grid",
    ),
    "integer": (
        lambda: stock("Int32Grid", np.ones((3, 4, 5), np.int32)),
        "type is int32; expected a float or Vec3S grid",
    ),
    "empty": (lambda: stock("FloatGrid", np.zeros((3, 4, 5), np.float32)), "is empty; expected"),
    "level set": (level_set, r"is a level set .*; expected a density"),
    "frustum": (frustum, "transform is a frustum; expected a linear one"),
    "endless": (endless, r"background is 0\.3.*; expected 0"),
    "far apart": (far_apart, r"is 100002 x 100002 x 100002 voxels; expected at most"),
}


@pytest.mark.parametrize("kind", BAD_GRIDS)
def test_bad_grids_are_refused_in_one_line(kind: str, tmp_path: Path) -> None:
    make, message = BAD_GRIDS[kind]
    path = write(tmp_path / "bad.vdb", make())
    with pytest.raises(InputError, match=message) as caught:
        read_grid(path)
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)


def test_singular_transform_is_refused() -> None:
    flat = np.diag([1.0, 1.0, 0.0, 1.0])
    with pytest.raises(InputError, match=r"transform is .*; expected an invertible matrix"):
        Grid(random_values(3, 4, 5), flat)


def test_nearly_singular_transform_of_a_file_is_refused(tmp_path: Path) -> None:
    grid = stock("FloatGrid", random_values(3, 4, 5))
    grid.transform = openvdb().createLinearTransform(
        [[1, 0, 0, 0], [0, 1, 0, 0], [1, 1, 1e-12, 0], [0, 0, 0, 1]]
    )
    path = write(tmp_path / "x.vdb", grid)
    with pytest.raises(InputError, match="expected an invertible matrix"):
        read_grid(path)


def test_negative_density_is_refused_as_a_medium(tmp_path: Path) -> None:
    path = write(tmp_path / "x.vdb", with_value(-0.25)())
    with pytest.raises(InputError, match=r"density holds 1 negative voxel, first at \(1, 2, 3\)"):
        Medium.from_density(read_grid(path))


def test_files_that_are_not_vdb(tmp_path: Path) -> None:
    text, empty = tmp_path / "text.vdb", tmp_path / "empty.vdb"
    text.write_text("not at all a volume")
    empty.touch()
    for path in (text, empty):
        for read in (grid_names, read_grid):
            with pytest.raises(InputError, match="is not a VDB file; expected an OpenVDB file"):
                read(path)
    for path in (tmp_path / "missing.vdb", tmp_path):
        with pytest.raises(InputError, match=r"cannot be read: .*; expected a VDB file"):
            read_grid(path)


def test_every_truncation_is_noticed(tmp_path: Path) -> None:
    """OpenVDB's own reader accepts files that lack up to 70 of their last bytes."""
    path = write(tmp_path / "x.vdb", stock("FloatGrid", random_values(20, 30, 40)))
    whole = path.read_bytes()
    for length in [*range(0, len(whole), 997), *range(len(whole) - 80, len(whole))]:
        path.write_bytes(whole[:length])
        with pytest.raises(InputError, match=r"cut off|not a VDB file"):
            read_grid(path)
