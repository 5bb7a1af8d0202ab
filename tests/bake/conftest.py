"""Scenes and volumes that every asymmetry shows in: unequal sides, sheared, chromatic."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from volillum_addon.bake.cold import child_environment
from volillum_addon.core.camera import Camera
from volillum_addon.core.control import Control
from volillum_addon.core.grid import Grid
from volillum_addon.core.lights import DistantLight, EnvironmentLight
from volillum_addon.core.medium import Medium
from volillum_addon.core.scene import Scene
from volillum_addon.models.model import Values
from volillum_addon.models.registry import MODELS
from volillum_addon.models.volume import Cost, Factor, IlluminationVolume, RadianceTerm

TRANSFORMS = {
    "plain": np.eye(4),
    "oblong": np.diag([0.1, 0.25, 3.0, 1.0]),
    "far": np.array([[0.1, 0, 0, 1e5], [0, 0.1, 0, -2e5], [0, 0, 0.1, 3e5], [0, 0, 0, 1]]),
    "rotated": np.array(
        [[0.36, 0.48, -0.8, 1.5], [-0.8, 0.6, 0.0, -2.5], [0.48, 0.64, 0.6, 7.0], [0, 0, 0, 1]]
    ),
    "sheared": np.array(
        [[0.1, 0.02, 0.03, 5.0], [0, 0.2, 0.04, 6.0], [0.01, 0, 0.3, 7.0], [0, 0, 0, 1]]
    ),
    "mirrored": np.array(
        [[0, 0.2, 0, -1.0], [0.1, 0, 0.05, 2.0], [0, 0.03, 0.3, 3.0], [0, 0, 0, 1]]
    ),
}


def import_paths() -> list[str]:
    """sys.path for a child process: without what an imported bpy has added to this one's."""
    return child_environment()["PYTHONPATH"].split(os.pathsep)


@pytest.fixture(params=TRANSFORMS)
def transform(request: pytest.FixtureRequest) -> np.ndarray:
    return TRANSFORMS[request.param]


def random_values(*shape: int, seed: int = 0) -> np.ndarray:
    """Floats in [0.1, 1): none is 0."""
    return np.random.default_rng(seed).uniform(0.1, 1, shape).astype(np.float32)


def blob(transform: np.ndarray = TRANSFORMS["sheared"], channels: int = 1) -> Grid:
    """Matter in a corner of a larger empty box, [13, 9, 17]."""
    values = np.zeros((13, 9, 17, channels), np.float32)
    values[2:6, 3:8, 4:7] = random_values(4, 5, 3, channels, seed=channels)
    values[9, 4, 12] = 0.5
    return Grid(values if channels == 3 else values[..., 0], transform, "density")


def volume(
    medium: Medium, model: str = "directional_occlusion", wide: bool = False
) -> IlluminationVolume:
    """A volume with one scalar and one vector channel, both without zeros."""
    lattice = medium.sigma_t
    return IlluminationVolume(
        model=model,
        parameters=MODELS[model].values({}),
        medium=medium,
        channels={
            "visibility": lattice.with_values(random_values(*lattice.shape, seed=2), "visibility"),
            "colour": lattice.with_values(random_values(*lattice.shape, 3, seed=3), "colour"),
        },
        radiance=(
            RadianceTerm((Factor("visibility"), Factor("colour", 1)), (0.1, 1 / 3, 2e-30)),
            RadianceTerm((Factor("colour"),), (1e30, 0.25, 0.0)),
        ),
        image_emission=wide,
        cost=Cost(1.25, 123456789),
        notes=("what it leaves out: ünicode", "two"),
    )


@pytest.fixture
def scene() -> Scene:
    return Scene(
        Medium.from_density(blob(), 2.0, 0.9),
        (DistantLight((0.3, 0.4, 0.9), 3.0, 0.2), EnvironmentLight((0.1, 0.2, 0.3))),
        Camera((1, -9, 3), (5, 6, 8)),
    )


@pytest.fixture
def solved(monkeypatch: pytest.MonkeyPatch) -> Callable[[], int]:
    """All models solved by a plain function in place of their kernels; counts the solutions."""
    count = 0

    def solve(scene: Scene, values: Values, control: Control) -> dict[str, Grid]:
        nonlocal count
        count += 1
        control.check()
        lattice = scene.medium.sigma_t
        return {"visibility": lattice.with_values(random_values(*lattice.shape), "visibility")}

    for name, model in MODELS.items():
        monkeypatch.setitem(MODELS, name, replace(model, solve=solve))
    return lambda: count
