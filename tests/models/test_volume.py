"""View-dependent radiance: the phase function and its moments against their definitions."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from volillum_addon.core import harmonics
from volillum_addon.core.camera import Camera
from volillum_addon.core.directions import sphere_rule
from volillum_addon.core.errors import InputError
from volillum_addon.core.grid import Grid
from volillum_addon.core.lights import DistantLight
from volillum_addon.core.medium import Medium
from volillum_addon.core.scene import Scene
from volillum_addon.models.angular import Angular, Moment, Phase
from volillum_addon.models.illuminate import bake
from volillum_addon.models.image import line_integral
from volillum_addon.models.volume import Factor, IlluminationVolume, RadianceTerm

Vectors = NDArray[np.float64]
TOWARD = (0.48, -0.6, 0.64)


def henyey_greenstein(g: float, cosine: Vectors | float) -> Vectors:
    """Their phase function itself, which integrates to 1."""
    return (1 - g * g) / (4 * math.pi * (1 + g * g - 2 * g * np.asarray(cosine)) ** 1.5)


def lattice(shape: tuple[int, int, int] = (3, 4, 5)) -> Grid:
    affine = np.diag([0.5, 0.7, 0.3, 1.0])
    affine[:3, 3] = (1, -2, 3)
    return Grid(np.ones(shape, np.float32), affine, "density")


def volume(*terms: tuple[Angular | None, tuple[float, float, float]]) -> IlluminationVolume:
    """One scalar channel of its own for every term."""
    grid = lattice()
    rng = np.random.default_rng(2)
    channels = {
        f"c{n}": grid.with_values(rng.random(grid.shape, dtype=np.float32), f"c{n}")
        for n in range(len(terms))
    }
    radiance = tuple(
        RadianceTerm((Factor(f"c{n}"),), weight, angular)
        for n, (angular, weight) in enumerate(terms)
    )
    return IlluminationVolume("photon_mapping", {}, Medium(grid, grid), channels, radiance)


@pytest.mark.parametrize("g", [-0.6, 0.0, 0.4, 0.7])
def test_the_phase_function_keeps_energy_and_has_its_mean_cosine(g: float) -> None:
    """Over all eyes: mean 1 (p integrates to 1), mean cosine g, and 1 for g = 0."""
    views, weights = sphere_rule(8192)
    factor = Phase(g, direction=TOWARD).values(views, np.zeros_like(views))
    # 64 Gauss nodes a ring converge as g^128, but the axis is turned: 1e-9 measured at 0.7.
    assert weights @ factor == pytest.approx(1, abs=1e-8)
    assert weights @ (factor * -(views @ TOWARD)) == pytest.approx(g, abs=1e-8)
    if g == 0:
        assert np.all(factor == 1)


def test_forward_scattering_is_bright_toward_the_light() -> None:
    phase = Phase(0.5, direction=(0, 0, 2))
    assert phase.direction == (0, 0, 1)
    # An eye below looks up, toward the light above.
    below, above = phase.values(np.array([[0.0, 0, -1], [0, 0, 1]]), np.zeros((2, 3)))
    assert below == pytest.approx(0.75 / 0.5**3)
    assert above == pytest.approx(0.75 / 1.5**3)


def test_moments_scatter_as_the_phase_function_does() -> None:
    """L_s(v) = integral of p(-omega . v) L(omega), for a radiance of the bands 0 to 2."""
    g = 0.45
    omega, weights = sphere_rule(8192)
    rng = np.random.default_rng(3)
    radiance = harmonics.evaluate(omega)[:, :9] @ rng.normal(size=9)
    moments = 4 * math.pi * weights * radiance @ harmonics.evaluate(omega)[:, :9]
    for view in rng.normal(size=(4, 3)):
        v = view / np.linalg.norm(view)
        direct = 4 * math.pi * weights @ (henyey_greenstein(g, -omega @ v) * radiance)
        series = sum(
            g ** math.isqrt(n) * moments[n] * Moment(n).values(v[None], np.zeros((1, 3)))[0]
            for n in range(9)
        )
        assert series == pytest.approx(direct, abs=1e-9)


def test_in_scattered_seen_from_a_camera_and_from_far() -> None:
    position = (0.3, 1.0, 2.0)
    given = volume(
        (None, (0.1, 0.2, 0.3)),
        (Phase(0.6, direction=TOWARD), (1.0, 0.5, 0.25)),
        (Phase(-0.3, position=position), (0.2, 1.0, 0.4)),
    )
    grid = given.medium.sigma_t
    index = np.stack(np.meshgrid(*map(np.arange, grid.shape), indexing="ij"), -1)
    points = grid.to_world(index.astype(np.float64))
    eye = np.array([4.0, 3.0, 2.0])

    def expected(v: Vectors) -> Vectors:
        omega = np.asarray(position) - points
        omega /= np.linalg.norm(omega, axis=-1, keepdims=True)
        factors = (
            np.ones(grid.shape),
            4 * math.pi * henyey_greenstein(0.6, -(v @ np.asarray(TOWARD))),
            4 * math.pi * henyey_greenstein(-0.3, -(omega * v).sum(-1)),
        )
        return sum(
            (given.channels[f"c{n}"].values * factor)[..., None] * np.asarray(term.weight)
            for n, (factor, term) in enumerate(zip(factors, given.radiance, strict=True))
        )

    toward = eye - points
    toward /= np.linalg.norm(toward, axis=-1, keepdims=True)
    # float32 products of three numbers.
    from_camera = given.in_scattered(view=Camera(eye, (1, 0, 3))).values
    np.testing.assert_allclose(from_camera, expected(toward), rtol=1e-6)
    far = Camera(eye, (1, 0, 3), orthographic=True)
    v = np.broadcast_to(-far.forward, points.shape)
    for view in (far, -7 * far.forward):
        np.testing.assert_allclose(given.in_scattered(view=view).values, expected(v), rtol=1e-6)


def test_a_missing_view_is_named() -> None:
    given = volume((Moment(0), (1, 1, 1)))
    assert given.needs_view
    with pytest.raises(InputError, match=r"the view is missing; expected a Camera or a direction"):
        given.in_scattered()
    assert not volume((None, (1, 1, 1))).needs_view
    with pytest.raises(InputError, match=r"the view .* is a zero vector"):
        given.in_scattered(view=(0, 0, 0))


def test_in_scattered_under_other_lights() -> None:
    suns = [(DistantLight(TOWARD, energy),) for energy in (1.0, 3.0)]
    scene = Scene(Medium.from_density(lattice(), 1.0, 0.8), suns[0])
    given = bake(scene, "multidirectional_occlusion")
    first, second = given.in_scattered(), given.in_scattered(lights=suns[1])
    np.testing.assert_allclose(second.values, 3 * first.values, rtol=1e-6)


def test_radiance_in_one_channel_is_the_same_image() -> None:
    """Also where the sum of the terms falls below 0 between voxels."""
    given = volume(
        (None, (1.0, 0.2, 0.3)),
        (None, (-1.2, 0.4, -0.3)),
        (Phase(0.6, direction=TOWARD), (0.3, 0.5, 0.25)),
        (Phase(0.6, direction=TOWARD), (-0.2, 0.0, 0.25)),
        (Moment(2), (0.2, 0.1, 0.0)),
    )
    stored = given.as_radiance()
    assert list(stored.channels) == ["radiance", "radiance_1", "radiance_2"]
    assert all(len(term.factors) == 1 for term in stored.radiance)
    camera = Camera((4.0, 3.0, 2.0), given.medium.sigma_t.centre, fov=0.5)
    images = [line_integral(each, camera, 6, 5, 2)[0] for each in (given, stored)]
    assert images[0].max() > 0.1
    # Sums of five products in float32, and the clamp's kink at a relative 1e-5.
    np.testing.assert_allclose(images[1], images[0], rtol=1e-5, atol=2e-6)


@pytest.mark.parametrize("g", [-0.5, 0.0, 0.6])
def test_back_scatter_of_a_slab(g: float) -> None:
    """Light from behind the eye, normal incidence: L = F p(-1) (1 - exp(-2 b)) / 2."""
    count, depth = 250, 2.0
    values = np.zeros((3, 3, count + 2), np.float32)
    values[..., 1:-1] = depth
    grid = Grid(values, np.diag([1e3, 1e3, 1 / count, 1.0]), "density")
    # Depth from the side of the light, exactly at the voxels: half a voxel's ramp, then whole ones.
    inside = np.clip(np.arange(count + 2) - 0.5, 0, count)
    transmittance = np.exp(-depth * inside / count).astype(np.float32)
    channel = grid.with_values(np.ascontiguousarray(np.broadcast_to(transmittance, values.shape)))
    fluence = np.array([1.0, 2.0, 0.5])
    weight = tuple((fluence / (4 * math.pi)).tolist())
    given = IlluminationVolume(
        "photon_mapping", {}, Medium(grid, grid), {"unscattered_0": channel},
        (RadianceTerm((Factor("unscattered_0"),), weight, Phase(g, direction=(0, 0, -1))),),
    )  # fmt: skip
    camera = Camera((1e3, 1e3, -5), (1e3, 1e3, 0), (0, 1, 0), orthographic=True, height=1.0)
    radiance, _ = line_integral(given, camera, 1, 1, 1)
    expected = fluence * henyey_greenstein(g, -1) * (1 - math.exp(-2 * depth)) / 2
    # Interpolating exp(-s) between voxels errs by (depth / count)^2 / 12 = 5e-6 of it in the mean,
    # float32 by 1e-7; the two ramps by (depth / count)^2 each.
    np.testing.assert_allclose(radiance[0, 0], expected, rtol=2e-4)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Phase(0.5), "light is nothing; expected a direction or a position"),
        (lambda: Phase(0.5, (0, 0, 1), (0, 0, 0)), "light is a direction and a position"),
        (lambda: Phase(1.0, (0, 0, 1)), "g is 1; expected -0.999 to 0.999"),
        (lambda: Phase(0.5, (0, 0, 0)), "direction is a zero vector"),
        (lambda: Moment(9), "index is 9; expected 0 to 8"),
    ],
)
def test_bad_angular_terms_are_named(make: object, message: str) -> None:
    with pytest.raises(InputError, match=message):
        make()  # type: ignore[operator]
