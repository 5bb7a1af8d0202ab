"""Transfer functions: data values to a medium."""

import json
from pathlib import Path

import numpy as np
import pytest

from volillum_addon.core.errors import InputError
from volillum_addon.core.grid import Grid
from volillum_addon.core.transfer_function import TransferFunction
from volillum_addon.resources import PRESETS

RAMP = TransferFunction(
    values=[10, 20, 40], density=[0, 1, 0.5], albedo=[[0, 0, 0], [1, 1, 1], [0, 0.5, 1]],
    per_voxel=2.0,
)  # fmt: skip


def data(*values: float, spacing: tuple[float, float, float] = (1, 1, 1)) -> Grid:
    affine = np.diag([*spacing, 1.0])
    return Grid(np.array(values, np.float32).reshape(-1, 1, 1), affine, "data")


def test_the_medium_is_piecewise_linear_in_the_value_and_constant_beyond_its_ends() -> None:
    medium = RAMP.medium(data(-5, 10, 15, 20, 30, 40, 99))
    assert np.allclose(medium.sigma_t.values.ravel(), [0, 0, 1, 2, 1.5, 1, 1], atol=1e-6)
    albedo = [[0] * 3, [0] * 3, [0.5] * 3, [1] * 3, [0.5, 0.75, 1], [0, 0.5, 1], [0, 0.5, 1]]
    expected = medium.sigma_t.values[..., None] * np.reshape(albedo, (7, 1, 1, 3))
    assert np.allclose(medium.sigma_s.values, expected, atol=1e-6)


def test_the_optical_depth_of_a_voxel_does_not_depend_on_the_unit_of_length() -> None:
    small = RAMP.medium(data(20, spacing=(1e-3, 2e-3, 3e-3)))
    large = RAMP.medium(data(20, spacing=(1, 2, 3)))
    assert np.allclose(small.sigma_t.values * 2e-3, 2.0, rtol=1e-6)
    assert np.allclose(large.sigma_t.values * 2.0, 2.0, rtol=1e-6)


def test_a_grey_albedo_makes_one_channel() -> None:
    grey = TransferFunction([0, 1], [0, 1], [[0.5] * 3, [0.9] * 3], 1.0)
    assert grey.medium(data(0.5)).sigma_s.channels == 1


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"values": [10, 10, 40]}, "ascending"),
        ({"density": [0, -1, 0]}, "from 0 up"),
        ({"density": [0, 1]}, "one from 0 up per value"),
        ({"albedo": [[0, 0, 2]] * 3}, "RGB from 0 to 1"),
        ({"per_voxel": -1}, "per_voxel"),
        ({"values": [0, np.nan, 1]}, "finite"),
    ],
)
def test_wrong_points_are_refused_with_what_is_wrong(
    change: dict[str, object], message: str
) -> None:
    given = {"values": RAMP.values, "density": RAMP.density, "albedo": RAMP.albedo}
    with pytest.raises(InputError, match=message):
        TransferFunction(**({"per_voxel": 1.0} | given | change))  # type: ignore[arg-type]


def test_vector_data_are_refused() -> None:
    vectors = Grid(np.zeros((2, 2, 2, 3), np.float32), np.eye(4), "velocity")
    with pytest.raises(InputError, match="velocity's channels is 3"):
        RAMP.medium(vectors)


@pytest.mark.parametrize(
    "path", sorted((PRESETS / "transfer_functions").glob("*.json")), ids=lambda path: path.stem
)
def test_presets_load_and_say_what_they_are_for(path: Path) -> None:
    preset = TransferFunction.from_json(json.loads(path.read_text()))
    assert preset.summary
    assert preset.unit
    assert float(np.max(preset.density)) == 1.0


def test_a_preset_without_points_is_refused() -> None:
    with pytest.raises(InputError, match="points"):
        TransferFunction.from_json({"per_voxel": 1})
    with pytest.raises(InputError, match="density, r, g, b"):
        TransferFunction.from_json({"per_voxel": 1, "points": [[0, 1]]})
