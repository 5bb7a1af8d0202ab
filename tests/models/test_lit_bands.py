"""Spherical harmonics with `bands` = lit: bands without energy are neither computed nor stored."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from media import smooth_random

from volillum_addon.bake.run import plan_bake
from volillum_addon.core.errors import InputError
from volillum_addon.core.lights import DistantLight, EnvironmentLight, Light, latitude_longitude
from volillum_addon.core.medium import Medium
from volillum_addon.core.scene import Scene
from volillum_addon.models.illuminate import bake, relight
from volillum_addon.models.spherical_harmonics import coefficients

MODEL = "spherical_harmonics"
GREY = smooth_random((14, 12, 10), seed=3)
COLOURED = Medium(
    GREY.sigma_t.with_values(GREY.sigma_t.values[..., None] * np.float32([1, 1.5, 2])), GREY.sigma_s
)
UP = latitude_longitude(128, 256)[0][..., 2:]
EVEN = EnvironmentLight((0.5, 0.6, 0.7))
MAP_OF_ONE = EnvironmentLight(np.full((128, 256, 3), 0.7))
GRADED = EnvironmentLight(np.repeat(1 + 0.5 * UP, 3, axis=-1))
SUN = DistantLight((0.3, -0.5, 0.8), (3.0, 2.0, 1.0), 0.1)
STORED: dict[str, tuple[tuple[Light, ...], int]] = {
    "even sky": ((EVEN,), 1),
    "image of one radiance": ((MAP_OF_ONE,), 1),
    "graded sky": ((GRADED,), 4),
    "sun": ((SUN,), 16),
    "sun and even sky": ((SUN, EVEN), 16),
}


@pytest.mark.parametrize("lights", STORED)
@pytest.mark.parametrize("medium", [GREY, COLOURED], ids=["grey", "coloured"])
def test_the_same_light_from_fewer_coefficients(medium: Medium, lights: str) -> None:
    shining, count = STORED[lights]
    scene = Scene(medium, shining)
    every, lit = (bake(scene, MODEL, bands=bands, directions=64) for bands in ("all", "lit"))
    assert len(coefficients(every)) == 16
    assert len(coefficients(lit)) == count
    # One coefficient is summed in another order than several.
    assert np.allclose(coefficients(every)[:count], coefficients(lit), rtol=1e-6, atol=2e-6)
    # A dark band's coefficients are below 1e-4 of all, and so is what they add.
    found, expected = (each.in_scattered().values for each in (lit, every))
    assert np.allclose(found, expected, rtol=0, atol=2e-4 * expected.max())


def test_an_order_limits_what_is_lit() -> None:
    volume = bake(Scene(GREY, (SUN,)), MODEL, bands="lit", order=1, directions=64)
    assert len(coefficients(volume)) == 4


def test_lights_in_the_stored_bands_need_no_new_bake() -> None:
    volume = bake(Scene(GREY, (GRADED,)), MODEL, bands="lit", directions=64)
    turned = EnvironmentLight(np.repeat(2 - UP, 3, axis=-1))
    again = bake(Scene(GREY, (turned,)), MODEL, directions=64)
    found = relight(volume, (turned,)).in_scattered().values
    assert np.allclose(found, again.in_scattered().values, rtol=0, atol=2e-4)
    # Fewer bands than are stored, too.
    assert relight(volume, (EVEN,)).in_scattered().values.max() > 0


@pytest.mark.parametrize("lights", ["graded sky", "sun"])
def test_lights_in_other_bands_are_refused(lights: str) -> None:
    """Band 0 of a grey medium is one plane, whose other components do not exist."""
    volume = bake(Scene(GREY, (EVEN,)), MODEL, bands="lit", directions=64)
    with pytest.raises(InputError, match="bake again under them"):
        relight(volume, STORED[lights][0])


def test_the_bake_is_stale_when_other_bands_are_lit() -> None:
    def hash_of(lights: tuple[Light, ...], bands: str, model: str = MODEL, name: str = "bands"):  # noqa: ANN202
        scene = Scene(GREY, lights)
        return plan_bake(scene, model, "nowhere", "name", {name: bands}).hash

    moved = replace(SUN, direction=(0.0, 0.0, 1.0))
    assert hash_of((SUN,), "lit") == hash_of((moved,), "lit")
    assert hash_of((EVEN,), "lit") == hash_of((MAP_OF_ONE,), "lit")
    assert len({hash_of((light,), "lit") for light in (EVEN, GRADED, SUN)}) == 3
    assert len({hash_of((light,), "all") for light in (EVEN, GRADED, SUN)}) == 1
    both = f"sun=multidirectional_occlusion,sky={MODEL}"
    first, second = (hash_of((SUN, sky), "lit", both, "sky_bands") for sky in (EVEN, GRADED))
    assert first != second  # though the sun, which is not the sky's, lights all bands
