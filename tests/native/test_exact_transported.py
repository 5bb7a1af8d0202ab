"""The judge's full scattering against furnaces, slabs, spheres and lamps with known solutions."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from judging import SIGMAS, UP, WIDE, check_statistics, in_scattered
from media import ball
from numpy.typing import ArrayLike, NDArray
from scipy import integrate
from trilinear import Array, affine

import volillum_native as native

Planes = NDArray[np.float32]
SKY = {"kind": "constant", "colour": np.ones(3), "share": 1.0}
SUN = {"kind": "distant", "colour": np.ones(3), "direction": UP, "cos_angle": 1.0, "share": 1.0}


def transported(
    medium: tuple[Any, ...], albedo: ArrayLike, *lights: Any, g: float = 0.0, **more: Any
) -> tuple[Array, Array]:
    sigma_t, *where = medium
    rgb = np.asarray(albedo, np.float32).reshape(-1, 1, 1, 1)
    equation = {
        "kind": "transported", "g": g, "emission": float("emission" in more),
        "lights": list(lights),
    }  # fmt: skip
    return in_scattered(sigma_t, *where, [], sigma_s=sigma_t * rgb, equation=equation, **more)


def lamp(position: ArrayLike, intensity: float = 1.0, **shape: Any) -> dict[str, Any]:
    base = {"kind": "lamp", "colour": np.full(3, intensity), "position": np.asarray(position)}
    return base | {"share": 1.0, "shape": "point"} | shape


def image(pixels: Array, rotation: Array | None = None) -> dict[str, Any]:
    turn = np.eye(3) if rotation is None else rotation
    return {"kind": "image", "image": pixels, "rotation": turn, "share": 1.0}


def random_medium(channels: int = 1) -> tuple[Planes, Array, Array]:
    rng = np.random.default_rng(1)
    sigma_t = (5 * rng.random((channels, 9, 8, 7)) ** 3).astype(np.float32)
    index = rng.uniform(0, 6, (6, 3))
    return sigma_t, affine(2), index @ affine(2)[:3, :3].T + affine(2)[:3, 3]


def slab(depth: float, at: ArrayLike) -> tuple[Planes, Array, Array]:
    """A slab without sides and the points at optical depths `at` below its top."""
    count = 16
    sigma_t = np.full((1, 3, 3, count), depth, np.float32)
    # Half a voxel of depth in each border's fall-off: (count - 1) + 1 voxels in all.
    z = np.concatenate([np.linspace(count - 1, count, 2001), [0.0], np.linspace(-1, 0, 2001)])
    z = np.sort(z)
    sigma = depth / count * np.clip(np.minimum(z + 1, count - z), 0, 1)
    below = np.concatenate([[0], np.cumsum((sigma[1:] + sigma[:-1]) / 2 * np.diff(z))])
    height = np.interp(depth - np.atleast_1d(at), below, z) / count
    points = np.stack([np.full_like(height, WIDE), np.full_like(height, WIDE), height], axis=-1)
    return sigma_t, np.diag([WIDE, WIDE, 1 / count, 1.0]), points


@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("g", [0.0, -0.95, 0.3, 0.95])
def test_white_furnace(channels: int, g: float) -> None:
    """White matter in a white world cannot be seen: every walk brings 1 home."""
    medium = random_medium(channels)
    view = np.random.default_rng(3).normal(size=(6, 3))
    value, error = transported(medium, 1, SKY, g=g, view=view, directions=64)
    np.testing.assert_allclose(value, 1, rtol=1e-10)
    assert np.all(error < 1e-10)


@pytest.mark.parametrize("albedo", [0.0, 0.6])
def test_thermal_furnace(albedo: float) -> None:
    """Grey matter as warm as its world: emission (1 - albedo) sigma_t, whatever the albedo."""
    medium = random_medium(3)
    glow = medium[0] * np.float32(1 - albedo)
    value, error = transported(medium, albedo, SKY, emission=glow, directions=16384)
    assert np.all(error < 0.02)
    assert np.all(np.abs(value - 1) < SIGMAS * error + 1e-6)


@pytest.mark.parametrize("g", [0.0, 0.9])
def test_furnace_whose_light_is_sought(g: float) -> None:
    """The same white world as an image, as two halves of one, and as a sun all around."""
    medium, view = random_medium(), np.tile([0.6, 0, 0.8], (6, 1))
    half = np.zeros((8, 16, 3))
    half[:, :8] = 1
    turn = np.linalg.qr(np.random.default_rng(4).normal(size=(3, 3)))[0]
    everywhere = SUN | {"cos_angle": -1.0, "colour": np.full(3, 4 * math.pi)}
    for lights in (
        [image(np.ones((5, 7, 3)))],
        [image(half, turn), image(1 - half, turn)],
        [everywhere],
        [everywhere | {"colour": np.full(3, 2 * math.pi)}, SKY | {"colour": np.full(3, 0.5)}],
    ):
        value, error = transported(medium, 1, *lights, g=g, view=view, directions=8192)
        assert np.all(error < 0.03)
        assert np.all(np.abs(value - 1) < SIGMAS * error + 1e-6)


@pytest.mark.parametrize(
    ("albedo", "depth", "values"),
    [
        (0.9, 1.0, (0.1271015186, 0.1176864067, 0.06583271741)),
        (0.5, 1.0, (0.0975754098, 0.0726942240, 0.0419769106)),
        (1.0, 4.0, (0.1887908457, 0.1884921584, 0.0421053748)),
    ],
)
def test_h1_slab_under_a_sun(albedo: float, depth: float, values: tuple[float, ...]) -> None:
    medium = slab(depth, np.array([0, 0.5, 1]) * depth)
    value, error = transported(medium, albedo, SUN, directions=65536)
    assert np.all(error < 2e-3)
    assert np.all(np.abs(value - np.array(values)[:, None]) < SIGMAS * error + 1e-6)


@pytest.mark.parametrize(
    ("g", "albedo", "depth", "reflected", "transmitted"),
    [
        (0.75, 0.9, 2.0, 0.0973946391, 0.6609576998),
        (0.5, 0.9, 1.0, 0.129793280, 0.739091121),
    ],
)
def test_i1_anisotropic_slab(
    g: float, albedo: float, depth: float, reflected: float, transmitted: float
) -> None:
    """Fluxes out of the slab: 2 pi int mu dmu int exp(-t / mu) albedo L_i(t, mu) dt / mu."""
    count = 6000
    rng = np.random.default_rng(5)
    mu = (np.arange(count) + rng.random(count)) / count
    through = -np.expm1(-depth / mu)
    away = -mu * np.log1p(-rng.permutation((np.arange(count) + 0.5) / count) * through)
    side = np.sqrt(1 - mu**2)
    for up, truth in ((True, reflected), (False, transmitted - math.exp(-depth))):
        view = np.stack([side, 0 * mu, mu if up else -mu], axis=-1)
        medium = slab(depth, away if up else depth - away)
        value, _ = transported(medium, albedo, SUN, g=g, view=view, directions=64)
        flux = 2 * math.pi * mu * through * albedo * value[:, 0]
        error = flux.std(ddof=1) / math.sqrt(count)
        assert error < 0.02 * truth
        assert abs(flux.mean() - truth) < 4 * error


def test_h8_sphere_in_a_white_world() -> None:
    medium = ball(24, 2.0)
    where = medium.sigma_t.index_to_world
    points = np.array([[0.0, 0, 0], [0, 0, 0.5], [0.3, -0.4, 0]])
    value, error = transported((medium.sigma_t.planes(), where, points), 0.9, SKY, directions=65536)
    truth = np.array([[0.7163032038], [0.754497651], [0.754497651]])
    assert np.all(error < 1e-3)
    # Voxel average and hat blur the surface by a variance of 1/4 voxel^2 at constant volume: rays
    # to it shorten by (1/4) / 24^2 / (1 - r^2) <= 6e-4 of T, and d ln J / d ln T is above -0.6.
    assert np.all(np.abs(value - truth) < SIGMAS * error + 4e-4)
    # The ray through the centre, seen with the background that shines through it.
    rays = np.array(
        [[0, 0, 3], [1e-6, 0, 0], [0, 1e-6, 0], [0, 0, -1], [0, 0, 0], [0, 0, 0]], float
    )
    sigma_t = medium.sigma_t.planes()
    seen, noise, _ = native.exact_image(
        sigma_t, sigma_t * np.float32(0.9), None, where, [], rays, 8, 8, points=32, directions=8,
        equation={"kind": "transported", "g": 0.0, "emission": 0.0, "lights": [SKY]},
    )  # fmt: skip
    error = math.sqrt((noise[..., 0] ** 2).sum()) / 64
    assert error < 2e-3
    assert abs(seen[..., 0].mean() + math.exp(-4) - 0.7204871272) < 4 * error + 4e-4


@pytest.mark.parametrize(
    ("albedo", "distance", "fluence"),
    [
        (0.9, 0.5, 0.4828326919),
        (0.9, 1.0, 0.1432838615),
        (0.9, 2.0, 0.03712639932),
        (0.5, 0.5, 0.2947631221),
        (0.5, 2.0, 0.007927623736),
    ],
)
def test_h6_lamp_in_an_endless_medium(albedo: float, distance: float, fluence: float) -> None:
    """Ten free paths to the border; unit power."""
    block = np.ones((1, 21, 21, 21), np.float32)
    middle = np.array([10.1, 10.2, 9.9])
    direction = np.array([0.36, -0.48, 0.8])
    points = np.repeat((middle + distance * direction)[None], 32, axis=0)
    source = lamp(middle, 1 / (4 * math.pi))
    value, _ = transported((block, np.eye(4), points), albedo, source, directions=2048)
    found = 4 * math.pi * value[:, 0]
    error = found.std(ddof=1) / math.sqrt(len(found))
    assert error < 0.03 * fluence
    assert abs(found.mean() - fluence) < 4 * error


def test_lamps_in_the_void() -> None:
    """Without matter the lights themselves, without noise: phase function times F."""
    empty, point = np.zeros((1, 3, 3, 3), np.float32), np.array([[1.0, 1.0, 1.0]])
    view, g = np.array([[0.0, 0.6, 0.8]]), 0.7
    position, toward = np.array([1.0, 2.0, 3.0]), np.array([0.0, 1.0, 2.0]) / math.sqrt(5)
    cosine = -float(toward @ view[0])
    phase = (1 - g * g) / (4 * math.pi * (1 + g * g - 2 * g * cosine) ** 1.5)
    spot = {"direction": -UP, "cos_angle": 0.8, "blend": 0.2}
    flat = {"direction": -UP, "half_width": np.zeros(3), "half_height": np.zeros(3), "ellipse": 0}
    ramp = (2 / math.sqrt(5) - 0.8) / 0.2
    for light, shape in (
        (lamp(position), 1.0),
        (lamp(position, shape="spot", **spot), ramp**2 * (3 - 2 * ramp)),
        (lamp(position, shape="spot", **(spot | {"cos_angle": 0.9})), 0.0),
        (lamp(position, shape="flat", **flat), 2 / math.sqrt(5)),
        (lamp(position, shape="flat", **(flat | {"direction": UP})), 0.0),
    ):
        value, error = transported(
            (empty, np.eye(4), point), 1, light, g=g, view=view, directions=16
        )
        np.testing.assert_allclose(value, phase * shape / 5, rtol=1e-12)
        assert np.all(error <= 1e-12 * value)


@pytest.mark.parametrize("ellipse", [0, 1])
def test_area_lamp_in_the_void(ellipse: int) -> None:
    """Integral of cos dA / d^2 of a rectangle or an ellipse of unit radiance times its area."""
    empty, point = np.zeros((1, 3, 3, 3), np.float32), np.array([[1.0, 1.0, 1.0]])
    width, height = np.array([0.8, 0.0, 0.0]), np.array([0.0, 1.5, 0.0])
    centre = np.array([1.5, 1.0, 2.0])

    def integrand(v: float, u: float) -> float:
        away = centre + u * width + v * height - point[0]
        return float(away[2] / np.linalg.norm(away) ** 3)

    reach = (lambda u: math.sqrt(1 - u * u)) if ellipse else (lambda _: 1.0)
    total = integrate.dblquad(integrand, -1, 1, lambda u: -reach(u), reach, epsabs=1e-9)[0]
    mean = total / (math.pi if ellipse else 4)
    light = lamp(
        centre, shape="flat", direction=-UP, half_width=width, half_height=height, ellipse=ellipse
    )
    value, error = transported((empty, np.eye(4), point), 1, light, directions=1 << 17)
    assert np.all(error < 5e-3 * value)
    assert np.all(np.abs(value - mean / (4 * math.pi)) < SIGMAS * error)


def test_image_is_read_as_it_is_oriented() -> None:
    """One bright pixel: row 0 is up, u = 1/2 - azimuth / 2 pi; seen through the phase function."""
    empty, point = np.zeros((1, 3, 3, 3), np.float32), np.ones((1, 3))
    pixels = np.zeros((16, 32, 3))
    pixels[4, 6] = [1, 2, 3]
    elevation, azimuth = math.pi * (0.5 - 4.5 / 16), 2 * math.pi * (0.5 - 6.5 / 32)
    local = np.array(
        [
            math.cos(elevation) * math.cos(azimuth),
            math.cos(elevation) * math.sin(azimuth),
            math.sin(elevation),
        ]
    )
    band = math.sin(math.pi * (0.5 - 4 / 16)) - math.sin(math.pi * (0.5 - 5 / 16))
    solid = band * 2 * math.pi / 32
    turn = np.linalg.qr(np.random.default_rng(6).normal(size=(3, 3)))[0]
    view, g = -(turn.T @ local)[None], 0.5
    value, error = transported(
        (empty, np.eye(4), point), 1, image(pixels, turn), g=g, view=view, directions=8192
    )
    # Forward scattering of the pixel's middle; over the pixel the phase function falls by 3 %.
    forward = (1 - g * g) / (4 * math.pi * (1 - g) ** 3)
    np.testing.assert_allclose(value[0], forward * solid * np.array([1, 2, 3]), rtol=0.03)
    assert np.all(error < 0.01 * value)


def test_colours_scatter_by_themselves() -> None:
    medium, albedo = random_medium(3), np.array([0.5, 0.9, 0.99])
    lights = (SUN, lamp(medium[2][0] + 0.7))
    value, error = transported(medium, albedo, *lights, directions=8192)
    for c in range(3):
        grey, grey_error = transported(
            (medium[0][c : c + 1].copy(), *medium[1:]), albedo[c], *lights, directions=8192
        )
        combined = np.hypot(error[:, c], grey_error[:, c])
        assert np.all(np.abs(value[:, c] - grey[:, c]) < SIGMAS * combined)
        assert np.all(error[:, c] < 0.1 * value[:, c])


def test_unbiased_with_errors_that_cover() -> None:
    """2,000 independent points of case H1, albedo 0.9, the middle of a slab of depth 1."""
    sigma_t, where, point = slab(1.0, 0.5)
    points = np.repeat(point, 2000, axis=0)
    value, error = transported((sigma_t, where, points), 0.9, SUN, directions=512)
    check_statistics(value[:, 0], error[:, 0], 0.1176864067)


def test_any_number_of_threads_gives_the_same() -> None:
    medium, lights = random_medium(3), (SKY, SUN, lamp([0.0, 1, 2]), image(np.ones((4, 8, 3))))
    one = transported(medium, 0.9, *lights, threads=1)
    for threads in (2, 3):
        again = transported(medium, 0.9, *lights, threads=threads)
        assert all(np.array_equal(a, b) for a, b in zip(one, again, strict=True))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"g": 0.5}, "view is None; a phase function with g = 0.5"),
        ({"g": 1.0}, "equation's g is not a number from -0.999"),
        ({"lights": [{"kind": "moon"}]}, r"lights\[0\]'s kind is 'moon'; expected one of"),
        ({"lights": [{"kind": "constant", "share": 1}]}, r"lights\[0\] has no key 'colour'"),
        ({"lights": [SKY | {"x": 1}]}, r"lights\[0\] has the unknown key 'x'"),
        ({"lights": [SKY | {"share": 0}]}, r"lights\[0\]'s share is not a number"),
        ({"lights": [image(np.ones((4, 8)))]}, r"image has shape \(4, 8\); expected \(h, w, 3\)"),
        ({"lights": 3}, "equation's lights is not a list"),
    ],
)
def test_bad_input_is_named(changes: dict[str, Any], message: str) -> None:
    ones = np.ones((1, 3, 3, 3), np.float32)
    fields = {"kind": "transported", "g": 0.0, "emission": 0.0, "lights": [SKY]}
    with pytest.raises(ValueError, match=message):
        in_scattered(ones, np.eye(4), np.ones((1, 3)), [], sigma_s=ones, equation=fields | changes)
