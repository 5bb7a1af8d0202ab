"""Volumes written to VDB files and read back."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bake.conftest import blob, random_values, volume
from scipy.ndimage import binary_dilation

from volillum_addon.bake import vdb
from volillum_addon.bake.openvdb_module import openvdb
from volillum_addon.core.errors import InputError
from volillum_addon.core.grid import Grid
from volillum_addon.core.medium import Medium
from volillum_addon.models.angular import Moment, Phase
from volillum_addon.models.registry import MODELS
from volillum_addon.models.volume import IlluminationVolume

# Rounding to half precision, relative; below 2^-14 it would be absolute (no such value here).
HALF = 2.0**-11


def near(medium: Medium) -> np.ndarray:
    """Voxels within 2 of matter, by scipy's morphology."""
    matter = (medium.sigma_t.values != 0).reshape(*medium.sigma_t.shape, -1).any(-1)
    if medium.emission is not None:
        matter |= (medium.emission.values != 0).reshape(*matter.shape, -1).any(-1)
    return binary_dilation(matter, np.ones((3, 3, 3), bool), iterations=2)


def round_trip(given: IlluminationVolume, folder: Path, half: bool = False) -> IlluminationVolume:
    vdb.write_vdb(given, folder / "volume.vdb", half=half)
    return vdb.read_vdb(folder / "volume.vdb")


def assert_same(read: IlluminationVolume, given: IlluminationVolume, digits: float = 0.0) -> None:
    """Everything equal, values to `digits` (relative), channels as far as they are kept."""
    for field in ("model", "parameters", "radiance", "image_emission", "cost", "notes"):
        assert getattr(read, field) == getattr(given, field)
    assert read.medium.g == given.medium.g
    np.testing.assert_array_equal(
        read.medium.sigma_t.index_to_world, given.medium.sigma_t.index_to_world
    )
    np.testing.assert_allclose(
        read.medium.sigma_t.values, given.medium.sigma_t.values, rtol=digits, atol=0
    )
    # A constant albedo is a number of the file: one multiplication in float32, on rounded values.
    np.testing.assert_allclose(
        read.medium.sigma_s.values, given.medium.sigma_s.values, rtol=digits + 1e-6, atol=0
    )
    if given.medium.emission is None:
        assert read.medium.emission is None
    else:
        assert read.medium.emission is not None
        np.testing.assert_allclose(
            read.medium.emission.values, given.medium.emission.values, rtol=digits, atol=0
        )
    assert list(read.channels) == list(given.channels)
    kept = near(given.medium)
    assert not kept.all()
    for name, channel in given.channels.items():
        expected = np.where(kept.reshape(*kept.shape, *[1] * (channel.values.ndim - 3)),
                            channel.values, 0)  # fmt: skip
        np.testing.assert_allclose(read.channels[name].values, expected, rtol=digits, atol=0)
        assert read.channels[name].name == name


def media(transform: np.ndarray) -> dict[str, Medium]:
    grey, chromatic = blob(transform), blob(transform, 3)
    emission = np.zeros((*grey.shape, 3), np.float32)
    emission[7:9, 1, 2] = (1, 2, 3)
    share = random_values(*grey.shape, seed=9)
    return {
        "grey": Medium.from_density(grey, 2.0, 0.9),
        "coloured albedo": Medium.from_density(grey, 0.3, (1.0, 0.8, 0.0)),
        "chromatic": Medium.from_density(chromatic, (1, 2, 3), (0.9, 0.8, 0.7)),
        "one scattering of three": Medium(
            chromatic, grey.with_values(chromatic.values.min(axis=-1)), g=0.5
        ),
        "varying albedo": Medium(grey, grey.with_values(grey.values * share)),
        "emission": Medium(grey, grey, grey.with_values(emission)),
        "emission alone": Medium(
            grey.with_values(grey.values * 0), grey.with_values(grey.values * 0),
            grey.with_values(emission)),
    }  # fmt: skip


@pytest.mark.parametrize("kind", media(np.eye(4)))
def test_volume_round_trip(kind: str, transform: np.ndarray, tmp_path: Path) -> None:
    given = volume(media(transform)[kind])
    assert_same(round_trip(given, tmp_path), given)


def test_terms_that_depend_on_the_view_round_trip(tmp_path: Path) -> None:
    given = volume(Medium.from_density(blob(), 2.0, 0.9))
    dependences = (
        Phase(0.3, direction=(0.48, -0.6, 0.64)),
        Phase(-0.7, position=(1 / 3, 2e-30, -1e30)),
        Moment(7),
        None,
    )
    terms = tuple(replace(given.radiance[0], angular=angular) for angular in dependences)
    given = given.with_radiance(terms)
    read = round_trip(given, tmp_path)
    assert_same(read, given)
    assert [term.angular for term in read.radiance] == list(dependences)


@pytest.mark.parametrize("kind", media(np.eye(4)))
def test_half_precision_keeps_eleven_bits(kind: str, tmp_path: Path) -> None:
    given = volume(media(np.eye(4))[kind], wide=True)
    assert_same(round_trip(given, tmp_path, half=True), given, HALF)


def test_half_precision_halves_the_file(tmp_path: Path) -> None:
    grid = Grid(random_values(40, 50, 60), np.eye(4))
    given = volume(Medium(grid, grid))
    for half in (False, True):
        vdb.write_vdb(given, tmp_path / f"{half}.vdb", half=half)
    full, small = ((tmp_path / f"{half}.vdb").stat().st_size for half in (False, True))
    # 23 + 2 random bits of each full float against 11: compression makes it 0.45 to 0.6.
    assert 0.4 < small / full < 0.65


@pytest.mark.parametrize("scale", [1e6, 1e-8])
def test_half_precision_refuses_what_it_cannot_hold(scale: float, tmp_path: Path) -> None:
    given = volume(Medium.from_density(blob(), scale))
    with pytest.raises(InputError, match=r"density's largest value is .*; expected .* for half"):
        vdb.write_vdb(given, tmp_path / "x.vdb", half=True)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("model", MODELS)
def test_every_model_s_parameters_round_trip(model: str, tmp_path: Path) -> None:
    given = volume(Medium.from_density(blob()), model)
    for parameter in MODELS[model].parameters:
        values = {parameter.default, *parameter.choices}
        if not parameter.choices:
            values |= {v for v in (parameter.minimum, parameter.maximum) if not math.isnan(v)}
        for value in values:
            changed = replace(given, parameters=MODELS[model].values({parameter.name: value}))
            read = round_trip(changed, tmp_path)
            assert read.parameters == changed.parameters
            assert [type(v) for v in read.parameters.values()] == [
                type(v) for v in changed.parameters.values()
            ]


def test_grid_names_and_active_voxels_of_the_file(tmp_path: Path) -> None:
    given = volume(media(np.eye(4))["varying albedo"])
    vdb.write_vdb(given, tmp_path / "x.vdb")
    names = ("density", "volillum_sigma_s", "volillum_visibility", "volillum_colour")
    assert sorted(vdb.grid_names(tmp_path / "x.vdb")) == sorted(names)
    grid = openvdb().read(str(tmp_path / "x.vdb"), "volillum_visibility")
    assert grid.activeVoxelCount() == np.count_nonzero(near(given.medium))
    constant = volume(media(np.eye(4))["grey"])
    vdb.write_vdb(constant, tmp_path / "y.vdb")
    assert "volillum_sigma_s" not in vdb.grid_names(tmp_path / "y.vdb")


def test_metadata_is_readable_json_with_what_the_caller_adds(tmp_path: Path) -> None:
    vdb.write_vdb(volume(Medium.from_density(blob())), tmp_path / "x.vdb", {"hash": "0123", "n": 5})
    entries = vdb.read_metadata(tmp_path / "x.vdb")
    assert entries["hash"] == "0123"
    assert entries["n"] == 5
    assert entries["seconds"] == 1.25
    assert 0 < entries["seconds_hand_over"] < 60
    raw = openvdb().readMetadata(str(tmp_path / "x.vdb"))
    assert raw["volillum_model"] == '"directional_occlusion"'


def test_channels_on_another_lattice_are_refused(tmp_path: Path) -> None:
    given = volume(Medium.from_density(blob()))
    small = {"visibility": Grid(random_values(3, 4, 5), np.eye(4))}
    with pytest.raises(InputError, match="channel visibility's lattice"):
        vdb.write_vdb(replace(given, channels=small), tmp_path / "x.vdb")


def test_stock_files_are_no_bakes(tmp_path: Path) -> None:
    grid = openvdb().FloatGrid()
    grid.copyFromArray(random_values(3, 4, 5))
    grid.name = "density"
    openvdb().write(str(tmp_path / "stock.vdb"), [grid])
    del grid
    with pytest.raises(InputError, match=r"stock\.vdb's volillum format is not there"):
        vdb.read_vdb(tmp_path / "stock.vdb")


def test_an_altered_transform_is_noticed(tmp_path: Path) -> None:
    vdb.write_vdb(volume(Medium.from_density(blob())), tmp_path / "x.vdb")
    grids, metadata = openvdb().readAll(str(tmp_path / "x.vdb"))
    for grid in grids:
        grid.transform.postTranslate((0.5, 0, 0))
    openvdb().write(str(tmp_path / "y.vdb"), grids, metadata=metadata)
    del grids, grid
    with pytest.raises(InputError, match="density's transform is another"):
        vdb.read_vdb(tmp_path / "y.vdb")
