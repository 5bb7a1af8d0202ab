"""Shadow propagation of point lights: against the exact solution, one ray, and a sun."""

from __future__ import annotations

import math

import numpy as np
import pytest
from media import coloured
from radiance_truth import REC_709

from volillum_addon.core.errors import InputError
from volillum_addon.core.lights import DistantLight, PointLight
from volillum_addon.core.medium import Medium
from volillum_addon.core.native import native
from volillum_addon.core.scene import Scene
from volillum_addon.models.exact import exact
from volillum_addon.models.illuminate import bake

MODEL = "shadow_propagation"


def lamp(
    medium: Medium, away: np.ndarray, rgb: tuple[float, float, float] = (1, 1, 1)
) -> PointLight:
    """A point light `away` from the medium's centre, where its unoccluded L_i is `rgb`."""
    centre = medium.sigma_t.centre
    return PointLight(tuple(centre + away), 4 * math.pi * float(away @ away) * np.array(rgb))


TOWARD = np.array([0.48, 0.36, 0.8])


# From afar; and so near that many rays end inside the medium. A narrow lobe too.
@pytest.mark.parametrize(("distance", "beta"), [(3.0, 10.0), (1.3, 10.0), (3.0, 200.0)])
def test_a_point_light_agrees_with_the_exact_solution(distance: float, beta: float) -> None:
    medium = coloured((24, 28, 20), seed=43)
    scene = Scene(medium, (lamp(medium, distance * TOWARD, (1.0, 0.8, 0.6)),))
    volume = bake(scene, MODEL, beta=beta, directions=16)
    lattice = volume.medium.sigma_t
    rng = np.random.default_rng(44)
    index = np.stack([rng.integers(0, n, 300) for n in lattice.shape], axis=-1)
    truth = exact(scene, MODEL, lattice.to_world(index.astype(float)), 512, beta=beta).value
    error = volume.in_scattered().values[tuple(index.T)] - truth
    # The specification's goal on smooth fields is 1 %.
    assert math.sqrt((error**2).sum() / (truth**2).sum()) < 0.01


def test_a_point_lights_luminance_is_that_of_its_single_ray() -> None:
    """The model's law: lambda(L_i) = lambda(F / (4 pi) T(x, lamp)), with exact depths."""
    medium = coloured((12, 14, 10), seed=45)
    light = lamp(medium, 2.0 * TOWARD, (1.0, 0.5, 0.2))
    found = bake(Scene(medium, (light,)), MODEL).in_scattered()
    position = np.asarray(light.position)
    for index in ((2, 3, 4), (8, 8, 5), (12, 15, 11)):
        place = found.to_world(np.array(index, float))
        away = position - place
        distance = float(np.linalg.norm(away))
        planes = medium.sigma_t.planes()
        # The lamp is outside: from it on there is nothing.
        depth = native.exact_optical_depth(
            planes, medium.sigma_t.index_to_world, place[None], away[None] / distance
        )[0]
        truth = REC_709 @ (light.fluence(place) / (4 * math.pi) * np.exp(-depth))
        assert REC_709 @ found.values[index] == pytest.approx(truth, rel=1e-5)


def test_a_far_point_light_is_a_sun() -> None:
    medium = coloured((14, 16, 12), seed=46)
    direction = (0.36, 0.48, 0.8)
    rgb = (1.0, 0.8, 0.6)
    far = bake(
        Scene(medium, (lamp(medium, 1e5 * np.array(direction), rgb),)), MODEL, directions=256
    )
    sun = DistantLight(direction, 4 * math.pi * np.array(rgb))
    near = bake(Scene(medium, (sun,)), MODEL, directions=256)
    a, b = far.in_scattered().values, near.in_scattered().values
    # The shadow's ray is exact for the lamp and the sweep's for the sun (0.1 % on this grid).
    assert math.sqrt(((a - b) ** 2).sum() / (b**2).sum()) < 3e-3


def test_a_point_light_that_cannot_be_followed_is_refused() -> None:
    medium = coloured((8, 8, 8), seed=1)
    inside = Scene(medium, (lamp(medium, np.array([0.0, 0.0, 1e-3])),))
    with pytest.raises(InputError, match=r"a point light is .*too fast .*move the light out"):
        bake(inside, MODEL)
    outside = Scene(medium, (lamp(medium, 3 * TOWARD),))
    with pytest.raises(InputError, match="published algorithm's light is a point light"):
        bake(outside, MODEL, algorithm="published")
