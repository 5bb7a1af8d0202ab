"""A light of no strength is not computed, not stored, not named as left out."""

from dataclasses import replace

import numpy as np
import pytest
from media import smooth_random

from volillum_addon.bake.hashing import input_digests
from volillum_addon.core.camera import Camera
from volillum_addon.core.lights import (
    AreaLight,
    DistantLight,
    EnvironmentLight,
    Light,
    PointLight,
    SpotLight,
    shines,
)
from volillum_addon.core.scene import Scene
from volillum_addon.models.illuminate import illuminate, left_out, relight
from volillum_addon.models.registry import MODELS, get

DARK: list[Light] = [
    DistantLight((0, 0, 1), 0.0),
    PointLight((0, 0, 9), 0.0),
    SpotLight((0, 0, 9), (0, 0, -1), 0.0),
    AreaLight((0, 0, 9), (0, 0, -1), 0.0),
    EnvironmentLight(0.0),
    EnvironmentLight(np.zeros((2, 4, 3))),
]
SUN = DistantLight((0.3, -0.5, 0.8), 2.0)
FEW = {"directions": 8, "passes": 4, "photons": 500}


@pytest.mark.parametrize("light", DARK, ids=lambda light: light.kind)
def test_no_strength_is_dark(light: Light) -> None:
    assert not shines(light)


def test_any_strength_shines() -> None:
    image = np.zeros((2, 4, 3))
    image[1, 2, 0] = 1e-9
    for light in (SUN, EnvironmentLight(image), PointLight((0, 0, 9), (0, 0, 1e-6))):
        assert shines(light)


@pytest.mark.parametrize("model", MODELS)
def test_dark_lights_change_nothing(model: str) -> None:
    """Bit for bit, with as many channels, under the same digests."""
    medium = smooth_random((8, 9, 7), 2)
    camera = Camera(medium.sigma_t.centre - np.array([0.0, 4.0, 0.0]), medium.sigma_t.centre)
    plain = Scene(medium, (SUN,), camera)
    # Before and after, so that the lights' numbers would show a difference.
    mixed = replace(plain, lights=(DARK[0], *DARK[3:], SUN, *DARK[:3]))
    given = {p.name: FEW[p.name] for p in get(model).parameters if p.name in FEW}
    first, second = illuminate(plain, model, given), illuminate(mixed, model, given)
    assert list(first.channels) == list(second.channels)
    for name, grid in first.channels.items():
        np.testing.assert_array_equal(grid.values, second.channels[name].values)
    np.testing.assert_array_equal(
        relight(second, mixed.lights).in_scattered().values, first.in_scattered().values
    )
    assert left_out(mixed, model) == left_out(plain, model)
    values = get(model).values(given)
    digests = [input_digests(each, get(model), values, half=False) for each in (plain, mixed)]
    assert digests[0] == digests[1]
