"""The exact solution of a whole operator in a scene: rows whose equations have closed forms."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from media import half_space, smooth_random
from trilinear import affine

from volillum_addon.core.camera import Camera
from volillum_addon.core.errors import InputError
from volillum_addon.core.grid import Grid
from volillum_addon.core.lights import (
    AreaLight,
    DistantLight,
    EnvironmentLight,
    PointLight,
    SpotLight,
)
from volillum_addon.core.medium import Medium
from volillum_addon.core.scene import Scene
from volillum_addon.models.exact import exact, exact_image
from volillum_addon.models.operator import Operator
from volillum_addon.models.registry import MODELS

ROW = "row"
# 8 replicates: |t| of 7 degrees of freedom exceeds 7 in 2e-4 of cases.
SIGMAS = 7.0
Register = Callable[[Operator], None]


@pytest.fixture
def row(monkeypatch: pytest.MonkeyPatch) -> Register:
    """Registers an operator as a model of its own, for every kind of light."""

    def register(operator: Operator) -> None:
        model = replace(
            MODELS["directional_occlusion"],
            id=ROW,
            operator=lambda _: operator,
            lights=frozenset({"distant", "point", "spot", "area", "environment"}),
        )
        monkeypatch.setitem(MODELS, ROW, model)

    return register


def half_angle(degrees: float) -> Operator:
    return Operator(
        "cone", "light", "light", math.radians(degrees), order=math.inf, rescatter="lobe"
    )


def with_albedo(medium: Medium, albedo: float) -> Medium:
    sigma_s = medium.sigma_t.with_values(medium.sigma_t.values * np.float32(albedo))
    return replace(medium, sigma_s=sigma_s)


def test_half_angle_scales_with_its_lights_and_adds_them(row: Register) -> None:
    """Case D1 under two suns, each by F / (4 pi)."""
    row(half_angle(30))
    medium, point = half_space(2.0)
    suns = (DistantLight((0, 0, 1), (1, 2, 3)), DistantLight((0, 0, 1), (0.5, 0, 0), angle=0.4))
    scene = Scene(with_albedo(medium, 0.9), suns)
    found = exact(scene, ROW, point[None], samples=32768)
    brightness = np.array([1 + 0.5 * 2 / (1 + math.cos(0.2)), 2, 3]) / (4 * math.pi)
    assert np.all(np.abs(found.value - 0.8069449955 * brightness) < SIGMAS * found.standard_error)
    assert np.all(found.standard_error < 3e-3 * brightness)
    assert found.neglected == 0


def test_half_angle_of_a_point_light_is_its_fluence_in_a_white_medium(row: Register) -> None:
    row(half_angle(40))
    medium = smooth_random((9, 10, 11), seed=3)
    points = medium.sigma_t.to_world(np.array([[2.0, 3, 4], [6, 5, 5]]))
    lamp = PointLight((0.4, 0.5, 2.0), (1, 2, 4))
    found = exact(Scene(medium, (lamp,)), ROW, points, samples=64)
    truth = np.array([lamp.fluence(point) for point in points]) / (4 * math.pi)
    np.testing.assert_allclose(found.value, truth, rtol=1e-12)
    camera = Camera((3, 2, 1), medium.sigma_t.centre)
    image = exact_image(Scene(medium, (lamp,), camera), ROW, 8, 8, points=2, directions=2)
    assert image.value.max() > 0
    assert np.all(np.isfinite(image.value))


def test_lights_without_a_direction_are_refused(row: Register) -> None:
    row(half_angle(30))
    medium, point = half_space(1.0)
    with pytest.raises(InputError, match="is environment; expected a distant or a point light"):
        exact(Scene(medium, (EnvironmentLight(1.0),)), ROW, point[None])


def test_more_work_than_is_bounded_is_an_error(row: Register) -> None:
    """A white half space 1e6 deep: every walk would scatter a million times."""
    row(half_angle(30))
    medium, point = half_space(1e6)
    with pytest.raises(InputError, match="still scatters after 16384 collisions is 1; expected"):
        exact(Scene(medium, (DistantLight((0, 0, 1), 1.0),)), ROW, point[None], samples=8)


def test_an_operator_that_no_evaluator_has_is_refused(row: Register) -> None:
    row(replace(half_angle(30), rescatter="none", order=2))
    medium, point = half_space(1.0)
    with pytest.raises(InputError, match="expected one that the exact evaluator knows"):
        exact(Scene(medium, (DistantLight((0, 0, 1), 1.0),)), ROW, point[None])


def occlusion(law: str, lobe: str = "sphere", **more: float) -> Operator:
    return Operator(lobe, "none", "constant", law=law, **more)  # type: ignore[arg-type]


def homogeneous(sigma: float, albedo: tuple[float, float, float], size: int = 24) -> Medium:
    grid = Grid(np.full((size,) * 3, sigma, np.float32), np.diag([0.1, 0.1, 0.1, 1.0]))
    colour = grid.values[..., None] * np.array(albedo, np.float32)
    return Medium(grid, grid.with_values(colour))


@pytest.mark.parametrize("law", ["linear", "bounded"])
@pytest.mark.parametrize("p", [1.0, 2.0])
def test_ambient_occlusion_deep_in_a_homogeneous_medium(row: Register, law: str, p: float) -> None:
    """1 - T + k T albedo, T = sigma R or the opacity of one reference length; without noise."""
    sigma, radius, length, gain = 1.5, 0.5, 0.2, 0.75
    albedo = np.array([0.9, 0.5, 0.0])
    row(occlusion(law, radius=radius, weight_p=p, reference_length=length, gathers_colour=gain))
    medium = homogeneous(sigma, (0.9, 0.5, 0.0))
    lights = (DistantLight((0, 0, 1), (1, 2, 3)), EnvironmentLight(0.5))
    found = exact(Scene(medium, lights), ROW, medium.sigma_t.centre[None], samples=64)
    depth = sigma * radius if law == "linear" else -math.expm1(-sigma * length)
    brightness = np.array([1, 2, 3]) / (4 * math.pi) + 0.5
    np.testing.assert_allclose(
        found.value[0], brightness * (1 - depth + gain * depth * albedo), rtol=1e-5
    )


def test_hemisphere_looks_away_from_matter(row: Register) -> None:
    """Extinction linear along a world direction n, oblique lattice: the half space of -n."""
    where, radius, slope = affine(4), 1.2, np.array([0.2, -0.1, 0.3])
    index = np.stack(np.meshgrid(*(np.arange(16.0),) * 3, indexing="ij"), axis=-1)
    place = index @ where[:3, :3].T + where[:3, 3]
    base = 1 - (place @ slope).min()
    grid = Grid((base + place @ slope).astype(np.float32), where)
    row(occlusion("linear", "hemisphere", radius=radius, weight_p=1.0))
    point = grid.centre
    found = exact(Scene(Medium(grid, grid), (EnvironmentLight(1.0),)), ROW, point[None], 16384)
    # Mean cosine 1/2 with -n: sigma R - |slope| / 2 R^2 (3 - p) / (4 - p).
    depth = (base + point @ slope) * radius - np.linalg.norm(slope) / 3 * radius**2
    assert np.all(found.standard_error < 1e-3)
    assert np.all(np.abs(found.value - (1 - depth)) < SIGMAS * found.standard_error + 1e-5)


def test_shadow_propagation_is_black_and_white_without_colour(row: Register) -> None:
    """Grey medium, grey light: lambda alone, exp(-t), per sun; the lobe leaves nothing."""
    row(
        Operator(
            "phong", "light", "light", math.radians(30), 10.0, gathers_colour=1.0,
            gathers_emission=True, split="luminance", image_emission=True,
        )
    )  # fmt: skip
    medium, point = half_space(0.7)
    suns = (DistantLight((0, 0, 1), 2.0), DistantLight((0, 0.6, 0.8), 1.0))
    found = exact(Scene(with_albedo(medium, 0.5), suns), ROW, point[None], samples=64)
    truth = (2 * math.exp(-0.7) + math.exp(-0.7 / 0.8)) / (4 * math.pi)
    np.testing.assert_allclose(found.value[0], truth, rtol=1e-5)


FULL = Operator(
    "phase", "none", "lights", order=math.inf, rescatter="phase", gathers_emission=True,
    image_emission=True,
)  # fmt: skip


def test_every_kind_of_light_has_its_fluence(row: Register) -> None:
    """Where nothing occludes, full scattering sees F / (4 pi) of every light."""
    row(FULL)
    values = np.zeros((9, 9, 9), np.float32)
    values[0, 0, 0] = 1e-9
    grid = Grid(values, np.eye(4))
    sky = np.random.default_rng(8).random((6, 12, 3))
    point = np.array([4.0, 4.0, 4.0])
    for light in (
        DistantLight((0, 0, 1), (1, 2, 3), angle=0.5),
        PointLight((4, 9, 5), (1, 2, 3)),
        SpotLight((4, 9, 5), (0.1, -1, -0.2), (1, 2, 3), angle=0.9, blend=0.9),
        AreaLight((4, 9, 5), (0.1, -1, 0), (1, 2, 3)),
        AreaLight((4, 9, 5), (0.1, -1, 0), (1, 2, 3), (5, 3), across=(0, 0, 1)),
        AreaLight((4, 9, 5), (0.1, -1, 0), (1, 2, 3), 6, True),
        EnvironmentLight((1, 2, 3)),
        EnvironmentLight(sky, rotation=np.eye(3)[[1, 2, 0]]),
    ):
        found = exact(Scene(Medium(grid, grid), (light,)), ROW, point[None], 4096)
        truth = light.fluence(point) / (4 * math.pi)
        assert np.all(np.abs(found.value - truth) < SIGMAS * found.standard_error + 1e-7)
        assert np.all(found.standard_error < 0.02 * truth)


def test_anisotropic_scattering_depends_on_the_view(row: Register) -> None:
    """Toward the camera by default; forward scattering is brighter against the light."""
    row(FULL)
    medium = replace(with_albedo(smooth_random((8, 9, 7), seed=5), 0.5), g=0.6)
    point = medium.sigma_t.centre
    eye = point + np.array([3.0, 1.0, -2.0])
    scene = Scene(medium, (DistantLight((0, 0, 1), 1.0),), Camera(eye, point))
    default = exact(scene, ROW, point[None])
    given = exact(scene, ROW, point[None], view=eye - point)
    assert np.array_equal(default.value, given.value)
    against, along = (exact(scene, ROW, point[None], view=(0, 0, z)) for z in (-1, 1))
    assert np.all(against.value > 3 * along.value)
    with pytest.raises(InputError, match="scene's camera is missing"):
        exact(replace(scene, camera=None), ROW, point[None])
    with pytest.raises(InputError, match="view's shape is"):
        exact(scene, ROW, point[None], view=np.ones((2, 3)))


def test_what_the_medium_emits_is_gathered(row: Register) -> None:
    """A thermal furnace through the scene: white world, emission (1 - albedo) sigma_t."""
    row(FULL)
    dark = with_albedo(smooth_random((8, 9, 7), seed=6), 0.25)
    glow = dark.sigma_t.with_values(dark.sigma_t.values - dark.sigma_s.values)
    scene = Scene(replace(dark, emission=glow), (EnvironmentLight(1.0),))
    found = exact(scene, ROW, dark.sigma_t.centre[None], 16384)
    assert np.all(found.standard_error < 0.02)
    assert np.all(np.abs(found.value - 1) < SIGMAS * found.standard_error + 1e-5)


def test_shadow_propagation_gathers_the_glow(row: Register) -> None:
    """A grey half space with a red glow of source function e: Q = T + e (1 - T), hue of that."""
    row(
        Operator(
            "phong", "light", "light", math.radians(1), 0.0, gathers_colour=1.0,
            gathers_emission=True, split="luminance", image_emission=True,
        )
    )  # fmt: skip
    medium, point = half_space(0.7)
    black = with_albedo(medium, 0.0)
    glow = np.stack([medium.sigma_t.values, *(0 * medium.sigma_t.values,) * 2], axis=-1)
    scene = Scene(
        replace(black, emission=medium.sigma_t.with_values(0.5 * glow)),
        (DistantLight((0, 0, 1), 4 * math.pi),),
    )
    found = exact(scene, ROW, point[None], samples=64)
    through = math.exp(-0.7)
    q = through + np.array([0.5, 0, 0]) * (1 - through)
    # A cone of one degree: its rays are 1 / cos(1 degree) longer at most, 1.5e-4.
    truth = through * q / (np.array([0.2126, 0.7152, 0.0722]) @ q)
    np.testing.assert_allclose(found.value[0], truth, rtol=2e-4)
