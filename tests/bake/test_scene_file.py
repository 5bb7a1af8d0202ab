"""Scenes written and read bit for bit."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from bake.conftest import blob, random_values

from volillum_addon.bake.scene_file import read_scene, write_scene
from volillum_addon.core.camera import Camera
from volillum_addon.core.errors import InputError
from volillum_addon.core.lights import (
    AreaLight,
    DistantLight,
    EnvironmentLight,
    PointLight,
    SpotLight,
)
from volillum_addon.core.medium import Medium
from volillum_addon.core.scene import LIGHT_TYPES, Scene

TURN = np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]])
LIGHTS = (
    DistantLight((0.1, 0.2, 0.3), (1, 2, 3), 0.1),
    PointLight((0.7, -0.1, 1e-9), 1 / 3),
    SpotLight((1, 2, 3), (0.1, -0.7, 0.3), (0, 1e-20, 1e20), 0.3, 0.0),
    AreaLight((1, 2, 3), (-0.3, 0.1, 0.9), 2.5),
    EnvironmentLight((0.1, 0.2, 0.3)),
    EnvironmentLight(random_values(5, 7, 3), TURN),
)
MEDIUM = Medium(blob(channels=3), blob(channels=3), blob(), g=0.3)
SCENES = {
    "everything": Scene(MEDIUM, LIGHTS, Camera((1, 2, 3), (0.1, 7, 3), shift=(0.1, -0.2))),
    "orthographic": Scene(MEDIUM, LIGHTS[:1], Camera((1, 2, 3), (4, 5, 6), orthographic=True)),
    "no camera": Scene(Medium(blob(), blob()), LIGHTS[1:2]),
    "no light": Scene(MEDIUM, ()),
}


def assert_equal(first: object, second: object) -> None:
    """Equal types and bits, through all dataclasses."""
    assert type(first) is type(second)
    if hasattr(first, "__dataclass_fields__"):
        for field in fields(first):  # type: ignore[arg-type]
            assert_equal(getattr(first, field.name), getattr(second, field.name))
    elif isinstance(first, tuple):
        assert len(first) == len(second)  # type: ignore[arg-type]
        for a, b in zip(first, second, strict=True):  # type: ignore[call-overload]
            assert_equal(a, b)
    elif isinstance(first, np.ndarray):
        assert isinstance(second, np.ndarray)
        assert first.dtype == second.dtype
        assert first.shape == second.shape
        assert first.tobytes() == second.tobytes()
    else:
        assert first == second


@pytest.mark.parametrize("name", SCENES)
def test_scene_round_trip_is_bit_exact(name: str, tmp_path: Path) -> None:
    write_scene(SCENES[name], tmp_path / "scene.npz")
    assert_equal(read_scene(tmp_path / "scene.npz"), SCENES[name])
    assert [p.name for p in tmp_path.iterdir()] == ["scene.npz"]


def test_all_light_types_are_tried() -> None:
    assert {type(light) for light in LIGHTS} == set(LIGHT_TYPES)


def test_normalising_again_changes_no_bit() -> None:
    for direction in np.random.default_rng(3).normal(size=(2000, 3)):
        once = DistantLight(direction, 1.0).direction
        np.testing.assert_array_equal(DistantLight(once, 1.0).direction, once)


def test_other_files_are_refused(tmp_path: Path) -> None:
    write_scene(SCENES["everything"], tmp_path / "scene.npz")
    whole = (tmp_path / "scene.npz").read_bytes()
    np.savez(tmp_path / "other.npz", a=np.ones(3))
    (tmp_path / "cut.npz").write_bytes(whole[: len(whole) // 2])
    (tmp_path / "text.npz").write_text("text")
    (tmp_path / "empty.npz").touch()
    for name in ("other", "cut", "text", "empty", "missing"):
        with pytest.raises(InputError, match=r"is not a scene file .*; expected a whole one"):
            read_scene(tmp_path / f"{name}.npz")
