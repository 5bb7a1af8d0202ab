"""Bakes for a camera's view alone: the same image, and nothing where the camera does not look."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from media import smooth_random

from volillum_addon.bake.run import plan_bake
from volillum_addon.bake.scene_file import read_scene, write_scene
from volillum_addon.bake.vdb import read_vdb, write_vdb
from volillum_addon.core.camera import Camera
from volillum_addon.core.lights import DistantLight, EnvironmentLight, PointLight
from volillum_addon.core.medium import Medium
from volillum_addon.core.scene import Scene
from volillum_addon.models.illuminate import VOID_MARGIN, illuminate
from volillum_addon.models.image import line_integral
from volillum_addon.models.registry import MODELS

GREY = smooth_random((26, 30, 28), seed=8, depth=3.0)
TINT = np.float32([1.0, 0.8, 0.6])
SIGMA_T = GREY.sigma_t.with_values(GREY.sigma_t.values[..., None] * TINT)
COLOURED = Medium(SIGMA_T, SIGMA_T.with_values(SIGMA_T.values * np.float32([0.9, 0.5, 0.7])))
SUN = DistantLight((0.3, -0.5, 0.8), (2.0, 1.5, 1.0), 0.1)
SKY = EnvironmentLight((0.2, 0.3, 0.5))
LAMP = PointLight((1.5, -2.0, 3.0), 5.0)
WIDTH, HEIGHT = 24, 16
CENTRE = GREY.sigma_t.centre
# A part of the volume, from near by.
CLOSE = Camera((0.35, -2.5, 0.6), (0.33, 0.0, 0.62), fov=0.08, aspect=WIDTH / HEIGHT)
FLAT = replace(CLOSE, orthographic=True, height=0.25)
FEW = {"directions": 24}
CASES = {
    "directional_occlusion": ("directional_occlusion", FEW, CLOSE, (SUN,)),
    "directional_occlusion, orthographic": ("directional_occlusion", FEW, FLAT, (SUN,)),
    "multidirectional_occlusion": ("multidirectional_occlusion", FEW, CLOSE, (SUN, LAMP)),
    "multidirectional_occlusion, as published": (
        "multidirectional_occlusion",
        {"algorithm": "published"},
        CLOSE,
        (SUN,),
    ),
    "spherical_harmonics": ("spherical_harmonics", FEW, CLOSE, (SUN, SKY)),
    "spherical_harmonics, local": ("spherical_harmonics", FEW | {"radius": 0.2}, FLAT, (SKY,)),
    "half_angle": ("half_angle", FEW, CLOSE, (SUN,)),
    "shadow_propagation": ("shadow_propagation", FEW, CLOSE, (SUN,)),
    "ambient_occlusion": ("ambient_occlusion", {"bleeding": 0.5}, CLOSE, (SUN,)),
    "ambient_occlusion, linear": ("ambient_occlusion", {"opacity": "linear"}, CLOSE, (SKY,)),
    "ambient_occlusion, half balls": (
        "ambient_occlusion",
        {"neighbourhood": "hemisphere", "radius": 0.1, "bleeding": 0.3},
        FLAT,
        (SUN,),
    ),
    "photon_mapping": ("photon_mapping", {"passes": 2, "photons": 2000}, CLOSE, (SUN, SKY)),
    "composition": (
        "sun=multidirectional_occlusion,sky=spherical_harmonics",
        {"sun_directions": 24, "sky_directions": 24},
        CLOSE,
        (SUN, SKY),
    ),
}


def test_every_model_has_a_case() -> None:
    assert {model for model, *_ in CASES.values()} >= set(MODELS)


@pytest.mark.parametrize("medium", [GREY, COLOURED], ids=["grey", "coloured"])
@pytest.mark.parametrize("case", CASES)
def test_the_same_image(case: str, medium: Medium) -> None:
    model, given, camera, lights = CASES[case]
    scene = Scene(medium, lights, camera)
    whole = illuminate(scene, model, given)
    seen = illuminate(replace(scene, seen_only=True), model, given)
    expected, _ = line_integral(whole, camera, WIDTH, HEIGHT)
    found, _ = line_integral(seen, camera, WIDTH, HEIGHT)
    assert expected.min() > 0  # matter fills the view
    # Sums of positive terms in float32, each rounded otherwise where rows end elsewhere.
    assert np.allclose(found, expected, rtol=2e-6, atol=0)
    wanted = replace(scene, seen_only=True).trimmed(VOID_MARGIN).wanted
    assert wanted is not None
    inside = tuple(map(slice, *wanted))
    every = np.ones(whole.medium.sigma_t.shape, bool)
    assert every[inside].sum() < 0.4 * every.sum()
    for name, grid in seen.channels.items():
        outside = grid.values.copy()
        outside[inside] = 0
        assert not outside.any(), name
        assert whole.channels[name].values.shape == grid.values.shape


def test_files_hold_only_what_is_seen(tmp_path) -> None:  # noqa: ANN001
    scene = Scene(GREY, (SUN, SKY), CLOSE)
    sizes = {}
    for only in (False, True):
        volume = illuminate(replace(scene, seen_only=only), "spherical_harmonics", FEW)
        write_vdb(volume, tmp_path / "some.vdb")
        sizes[only] = (tmp_path / "some.vdb").stat().st_size
        again = read_vdb(tmp_path / "some.vdb")
        assert all(
            np.array_equal(grid.values, volume.channels[name].values)
            for name, grid in again.channels.items()
        )
    assert sizes[True] < 0.5 * sizes[False]


def test_another_process_knows_it(tmp_path) -> None:  # noqa: ANN001
    write_scene(Scene(GREY, (SUN,), CLOSE, seen_only=True), tmp_path / "scene.npz")
    again = read_scene(tmp_path / "scene.npz")
    assert again.seen_only
    assert again.camera is not None
    assert again.camera.aspect == CLOSE.aspect


def test_the_view_counts_only_then() -> None:
    def hash_of(camera: Camera, only: bool) -> str:
        scene = Scene(GREY, (SUN,), camera, only)
        return plan_bake(scene, "multidirectional_occlusion", "nowhere", "name").hash

    views = [
        CLOSE, FLAT, replace(CLOSE, fov=0.31), replace(CLOSE, aspect=1.0),
        replace(CLOSE, shift=(0.0, 0.1)), replace(CLOSE, look_at=(0.3, 0.0, 0.62)),
        replace(CLOSE, position=(0.35, -2.6, 0.6)), replace(CLOSE, up=(0.1, 0, 1)),
        replace(FLAT, height=0.3),
    ]  # fmt: skip
    assert len({hash_of(camera, True) for camera in views}) == len(views)
    assert len({hash_of(camera, False) for camera in views}) == 1
