"""Compositions: the bakes add, the judges add, the glow counts once, and bad ones are refused."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from media import smooth_random

from volillum_addon.bake.run import bake_file, baked_volume
from volillum_addon.core.camera import Camera
from volillum_addon.core.errors import InputError
from volillum_addon.core.lights import DistantLight, EnvironmentLight, PointLight
from volillum_addon.core.medium import Medium
from volillum_addon.core.scene import Scene
from volillum_addon.models.composition import GROUPS, Composition
from volillum_addon.models.exact import exact
from volillum_addon.models.illuminate import bake, illuminate, left_out, relight
from volillum_addon.models.image import line_integral
from volillum_addon.models.registry import MODELS, get

SUN = DistantLight((0.3, -0.5, 0.8), (3.0, 2.5, 2.0), 0.2)
SKY = EnvironmentLight((0.2, 0.3, 0.5))
PAIR = {"sun": "multidirectional_occlusion", "sky": "spherical_harmonics"}
PAIRS = [
    {"sun": sun.id, "sky": sky.id}
    for sun, sky in product(MODELS.values(), MODELS.values())
    if sun.lights & GROUPS["sun"] and sky.lights & GROUPS["sky"]
]
# Small settings for models that have such parameters.
QUICK = {"directions": 16, "near": 0, "passes": 4, "photons": 2000, "noise_seed": 7}


def scene(glow: float = 0.0, g: float = 0.0) -> Scene:
    medium = smooth_random((12, 14, 10), 3)
    sigma_t = medium.sigma_t
    emission = sigma_t.with_values(sigma_t.values * np.float32(glow)) if glow else None
    medium = Medium(sigma_t, sigma_t.with_values(sigma_t.values * np.float32(0.8)), emission, g)
    centre = sigma_t.centre
    return Scene(medium, (SUN, SKY), Camera(centre - np.array([0.0, 3.0, -0.4]), centre))


def quick(model: str) -> dict[str, object]:
    return {p.name: QUICK[p.name] for p in get(model).parameters if p.name in QUICK}


def quick_parts(pair: dict[str, str]) -> dict[str, object]:
    return {f"{g}_{name}": v for g, model in pair.items() for name, v in quick(model).items()}


def alone(whole: Scene, kind: str, glows: bool = False) -> Scene:
    medium = whole.medium if glows else replace(whole.medium, emission=None)
    return replace(whole, medium=medium, lights=tuple(x for x in whole.lights if x.kind == kind))


@pytest.mark.parametrize("pair", PAIRS, ids=lambda pair: "+".join(pair.values()))
def test_the_bakes_of_the_parts_add(pair: dict[str, str]) -> None:
    """To float32 rounding of sums of a few terms, bands and moments, clamped together only."""
    both = scene(g=0.3)
    whole = illuminate(both, pair, quick_parts(pair))
    camera = both.need_camera()
    parts = [
        illuminate(alone(both, kind), pair[group], quick(pair[group])).in_scattered(
            view=camera, clamped=False
        )
        for group, kind in (("sun", "distant"), ("sky", "environment"))
    ]
    total = parts[0].values + parts[1].values
    seen = whole.in_scattered(view=camera, clamped=False).values
    np.testing.assert_allclose(seen, total, rtol=1e-4, atol=3e-6 * float(total.max()))


def test_the_exact_solution_is_the_sum_of_the_parts_own() -> None:
    both = scene()
    points = both.medium.sigma_t.to_world(np.array([[6.0, 7, 5], [3, 4, 6], [9, 10, 2]]))
    whole = exact(both, PAIR, points, 4096)
    sun = exact(alone(both, "distant"), PAIR["sun"], points, 4096, seed=11)
    sky = exact(alone(both, "environment"), PAIR["sky"], points, 4096, seed=12)
    spread = np.sqrt(whole.standard_error**2 + sun.standard_error**2 + sky.standard_error**2)
    # |t| of 7 degrees of freedom exceeds 7 in 2e-4 of cases; 9 values.
    assert np.all(np.abs(whole.value - sun.value - sky.value) < 7 * spread + 1e-7)
    # A composition is not what either part alone makes of all lights.
    everything = exact(both, PAIR["sky"], points, 4096, seed=13)
    assert np.abs(everything.value - whole.value).max() > 20 * spread.max()


def test_the_bake_converges_to_the_exact_solution() -> None:
    both = scene()
    index = np.array([[6, 7, 5], [5, 6, 4], [7, 8, 6]])
    points = both.medium.sigma_t.to_world(index.astype(float))
    fine = {"sun_directions": 256, "sun_near": 8, "sky_directions": 512, "sky_near": 8}
    volume = illuminate(both, PAIR, fine)
    offset = np.rint(volume.medium.sigma_t.to_index(points)).astype(int)
    baked = volume.in_scattered().values[tuple(offset.T)]
    truth = exact(both, PAIR, points, 16384)
    # The engines' second-order error on a field of 10 voxels across: below 1 % (docs/accuracy.md).
    assert np.all(np.abs(baked - truth.value) < 0.01 * truth.value + 5 * truth.standard_error)


@pytest.mark.parametrize("pair", [PAIR, {"sun": "shadow_propagation", "sky": "photon_mapping"}])
def test_the_glow_counts_once(pair: dict[str, str]) -> None:
    """The image with a glow minus that without is the glow itself, through the medium, and what
    of it the part that it belongs to scatters: never twice."""
    both = scene(glow=0.5)
    chosen = get(pair)
    assert isinstance(chosen, Composition)
    assert [part.glows for part in chosen.parts] == [False, True]
    assert chosen.shows_emission(chosen.values({}))
    volume = illuminate(both, pair, quick_parts(pair))
    separate = [
        illuminate(alone(both, "distant"), pair["sun"], quick(pair["sun"])),
        illuminate(alone(both, "environment", glows=True), pair["sky"], quick(pair["sky"])),
    ]
    images = [line_integral(v, both.need_camera(), 8, 8)[0] for v in (volume, *separate)]
    np.testing.assert_allclose(images[0], images[1] + images[2], rtol=1e-3, atol=1e-6)
    assert len(chosen.equations(both, chosen.values({}))) == 2
    glows = [e.scene.medium.emission is not None for e in chosen.equations(both, chosen.values({}))]
    assert glows == [False, True]


def test_it_is_stored_and_found_like_any_model(tmp_path: Path) -> None:
    both = scene()
    baked = bake_file(both, get(PAIR).id, tmp_path, "cloud", quick_parts(PAIR))
    assert bake_file(both, get(PAIR).id, tmp_path, "cloud", quick_parts(PAIR)).found
    read = baked_volume(both, baked.path)
    direct = illuminate(both, PAIR, quick_parts(PAIR))
    assert read.model == direct.model == get(PAIR).id
    matter = direct.medium.sigma_t.values > 0
    np.testing.assert_array_equal(
        read.in_scattered().values[matter], direct.in_scattered().values[matter]
    )
    assert len(read.channels) + 1 <= 15


def test_new_lights_of_the_same_kinds_need_no_new_bake() -> None:
    both = scene()
    volume = illuminate(both, PAIR, quick_parts(PAIR))
    brighter = (replace(SUN, irradiance=np.asarray(SUN.irradiance) * 2), SKY)
    again = illuminate(replace(both, lights=brighter), PAIR, quick_parts(PAIR))
    np.testing.assert_allclose(
        relight(volume, brighter).in_scattered().values, again.in_scattered().values, rtol=1e-6
    )


def test_the_noise_of_stochastic_parts_is_kept() -> None:
    both = scene()
    pair = {"sun": "photon_mapping", "sky": "photon_mapping"}
    volume = illuminate(both, pair, quick_parts(pair))
    noise = volume.relative_standard_error()
    assert noise is not None
    assert 0 < noise < 1


def test_lights_that_no_part_serves_are_named() -> None:
    lamp = PointLight((0.0, 0.0, 5.0), 10.0)
    both = scene()
    notes = left_out(replace(both, lights=(*both.lights, lamp)), get(PAIR).id)
    assert any("point" in note for note in notes)


@pytest.mark.parametrize(
    ("model", "complaint"),
    [
        ({"sun": "half_angle"}, "at least 2"),
        ({"sun": "half_angle", "moon": "half_angle"}, "'moon'"),
        ({"sun": "half_angle", "sky": "nothing"}, "'nothing'"),
        ({"sun": "half_angle", "sky": "half_angle"}, "one that knows it"),
        ("sun=half_angle,sun=half_angle", "composition"),
        ("sun=half_angle,sky", "composition"),
    ],
)
def test_bad_compositions_are_refused(model: str | dict[str, str], complaint: str) -> None:
    with pytest.raises(InputError, match=complaint):
        get(model)


def test_a_scene_without_its_lights_is_refused() -> None:
    lamp = PointLight((0.0, 0.0, 5.0), 10.0)
    with pytest.raises(InputError, match="composition"):
        bake(replace(scene(), lights=(lamp,)), PAIR)


def test_the_order_of_the_kinds_makes_no_other_composition() -> None:
    assert (
        get("sky=spherical_harmonics, sun=half_angle").id
        == "sun=half_angle,sky=spherical_harmonics"
    )


def test_a_first_look_is_the_parts_first_look() -> None:
    chosen = get({"sun": "half_angle", "sky": "photon_mapping"})
    look = chosen.values(chosen.first_look)
    assert look["sky_seconds"] == get("photon_mapping").first_look["seconds"]
    assert look["sun_directions"] == get("half_angle").ladder[0]["directions"]
