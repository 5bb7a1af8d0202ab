"""The judge's image against closed forms and against the deterministic line integral."""

from __future__ import annotations

import math
import threading
import time
from typing import Any

import numpy as np
import pytest
import trilinear
from numpy.typing import ArrayLike, NDArray
from scipy import integrate, special, stats
from trilinear import Array

import volillum_native as native

Planes = NDArray[np.float32]
# Wide as the sky beside a thickness of about 1.
WIDE = 1e4
# Seen along -z from above, several voxels away from the sides; orthographic.
FROM_ABOVE = np.array(
    [[WIDE, WIDE, 5], [10, 0, 0], [0, 10, 0], [0, 0, -1], [0, 0, 0], [0, 0, 0]], float
)
UP = np.array([0.0, 0.0, 1.0])
# A visibility this short is 1 everywhere: the in-scattered radiance is the light's own.
NO_OCCLUSION = 1e-9


def image(*arguments: Any, **settings: Any) -> tuple[Array, Array]:
    """Value and standard error; nothing may be neglected."""
    value, error, neglected = native.exact_image(*arguments, **settings)
    assert np.all(neglected == 0)
    return value, error


def constant(radiance: ArrayLike) -> Array:
    return np.broadcast_to(np.asarray(radiance), 3)[None] * math.sqrt(4 * math.pi)


def cone(degrees: float, radiance: ArrayLike = 1.0) -> tuple[Any, ...]:
    return UP, "direction", math.cos(math.radians(degrees)), constant(radiance)


def slab(depths: ArrayLike, count: int = 9) -> tuple[Planes, Array]:
    """Optical depths per channel across a slab of thickness 1; its border ramps belong to it."""
    sigma = np.asarray(depths, np.float32).reshape(-1, 1, 1, 1)
    sigma_t = np.broadcast_to(sigma, (len(sigma), 3, 3, count)).copy()
    affine = np.diag([WIDE, WIDE, 1 / count, 1.0])
    return sigma_t, affine


def combined_z(value: Array, error: Array, truth: ArrayLike) -> float:
    """Deviation of the mean over pixels in units of its standard error."""
    return float((value - truth).mean() / (math.sqrt((error**2).sum()) / error.size))


def test_b1_emitting_slab() -> None:
    """Kappa 1.3, thickness 0.9, L_e 2: the emission is proportional to sigma_t, ramps included."""
    sigma_t, affine = slab([1.3])
    affine[2, 2] *= 0.9
    emission = np.repeat(2 * sigma_t, 3, axis=0)
    value, error = image(sigma_t, 0 * sigma_t, emission, affine, [], FROM_ABOVE, 8, 8, seed=1)
    assert error.max() < 1e-4
    # 1.3 in float32 is 4e-8 off.
    assert abs(value.mean() - 1.37926611746909) < 4 * math.hypot(*error.ravel()) / 192 + 1e-7


def test_emission_behind_opaque_cells() -> None:
    """An opaque emitter shows its source function, however deep a single cell is."""
    sigma_t, affine = slab([1e4])
    emission = np.repeat(3 * sigma_t, 3, axis=0)
    value, error = image(sigma_t, 0 * sigma_t, emission, affine, [], FROM_ABOVE, 8, 8, seed=2)
    assert error.max() < 0.5
    assert abs(combined_z(value[..., :1], error[..., :1], 3.0)) < 4


@pytest.mark.parametrize("depths", [[1.5], [0.4, 1.5, 6.0]])
def test_j2_back_scatter(depths: list[float]) -> None:
    """A sun behind the camera: albedo E (1 - exp(-2 b)) / 8 pi, also with chromatic extinction."""
    sigma_t, affine = slab(depths)
    albedo = 0.8
    value, error = image(
        sigma_t, albedo * sigma_t, None, affine, [cone(0, 1 / (4 * math.pi))], FROM_ABOVE, 16, 16,
    )  # fmt: skip
    for channel in range(3):
        b = depths[channel % len(depths)]
        truth = albedo * -math.expm1(-2 * b) / (8 * math.pi)
        of_channel = value[..., channel], error[..., channel]
        # Eight strata of collisions: a few per cent a pixel.
        assert of_channel[1].mean() < 0.05 * truth
        assert abs(combined_z(*of_channel, truth)) < 4
    if depths == [1.5]:
        assert truth == pytest.approx(albedo * 0.037807771264773915)


@pytest.mark.parametrize("degrees", [2.0, 30.0, 60.0])
def test_cone_above_a_slab(degrees: float) -> None:
    """L = int_0^b exp(-t) C1(t, theta) dt: order 1, seen from the light's side."""
    cosine, b = math.cos(math.radians(degrees)), 2.0
    sigma_t, affine = slab([b])

    def integrand(t: float) -> float:
        visible = special.expn(2, t) - cosine * special.expn(2, t / cosine)
        return math.exp(-t) * float(visible) / (1 - cosine)

    truth, _ = integrate.quad(integrand, 0, b)
    value, error = image(
        sigma_t,
        sigma_t,
        None,
        affine,
        [cone(degrees, [1, 2, 3])],
        FROM_ABOVE,
        12,
        12,
        directions=16,
    )
    assert abs(combined_z(value[..., 0], error[..., 0], truth)) < 4
    np.testing.assert_allclose(value / value[..., :1], np.broadcast_to([1.0, 2, 3], (12, 12, 3)))


def random_scene(channels: int, perspective: bool) -> tuple[Planes, Array, Array]:
    rng = np.random.default_rng(4)
    shape = (7, 9, 8)
    # Cubed: voids and dense cells of optical depth up to about 3 side by side.
    sigma_t = (3 * rng.random((channels, *shape)) ** 3).astype(np.float32)
    affine = trilinear.affine(5, mirrored=not perspective)
    centre = affine[:3, :3] @ (np.array(shape) / 2) + affine[:3, 3]
    # Wider than the grid: rays that miss and pixels half covered are in the picture.
    return sigma_t, affine, trilinear.camera(centre, 14.0, 6, (14, 12), perspective)


@pytest.mark.parametrize("perspective", [True, False])
@pytest.mark.parametrize("channels", [1, 3])
def test_agrees_with_the_line_integral_where_light_is_constant(
    channels: int, perspective: bool
) -> None:
    """Same camera, same medium, L_i constant: one is noisy, the other has its subpixels' grid."""
    sigma_t, affine, rays = random_scene(channels, perspective)
    rng = np.random.default_rng(7)
    emission = rng.random((3, *sigma_t.shape[1:]), dtype=np.float32)
    light = np.array([1.0, 0.5, 2.0])
    # Padded by a voxel, so that the constant channel does not fall off with the border.
    room = [(0, 0), (1, 1), (1, 1), (1, 1)]
    padded = affine.copy()
    padded[:3, 3] -= affine[:3, :3] @ np.ones(3)
    medium = [np.pad(planes, room) for planes in (sigma_t, 0.7 * sigma_t, emission)]
    ones = np.ones((1, *medium[0].shape[1:]), np.float32)
    truth, through = native.line_integral(
        *medium, padded, ones, [((0,), light)], rays, 14, 12, subpixels=32
    )
    value, error = image(
        *medium, padded, [(UP, "direction", -1.0, constant(light))], rays, 14, 12,
        radius=NO_OCCLUSION, points=16, directions=1, replicates=16, seed=8,
    )  # fmt: skip
    missed = (through == 1).all(axis=-1)
    assert 5 < missed.sum() < 100
    inside = truth.mean(axis=-1) > 0.1 * truth.mean()
    # A pixel's truth is a mean of 1,024 regular rays: its own error is of the order of 1e-3 of the
    # range inside a pixel, below a tenth of the standard errors here.
    z = (value - truth)[inside] / error[inside]
    assert np.median(error[inside] / truth[inside]) < 0.05
    # t of 15 degrees of freedom: variance 15 / 13; its square's mean over n independent pixels
    # (three channels of a pixel are not) scatters by sqrt(2.9 / n).
    pixels = int(inside.sum())
    assert np.mean(z**2) == pytest.approx(15 / 13, abs=4 * math.sqrt(2.9 / pixels))
    assert abs(np.mean(z[:, 1])) < 4 * math.sqrt(15 / 13 / pixels)


def test_rays_that_miss_are_exactly_dark() -> None:
    sigma_t, affine, _ = random_scene(1, True)
    away = trilinear.camera(np.array([200.0, 0, 0]), 4.0, 9, (5, 5), True)
    value, error = image(sigma_t, sigma_t, None, affine, [cone(30)], away, 5, 5)
    assert np.all(value == 0)
    assert np.all(error == 0)


def test_clamp_is_of_each_point() -> None:
    """Light that is negative on one side of the volume and positive on the other."""
    sigma_t, affine = slab([1.0])
    dark = (UP, "direction", -1.0, -constant(1))
    arguments = (sigma_t, sigma_t, None, affine, [dark], FROM_ABOVE, 3, 3)
    open_value, _ = image(*arguments, radius=NO_OCCLUSION)
    clamped, error = image(*arguments, radius=NO_OCCLUSION, clamp=True)
    np.testing.assert_allclose(open_value, math.expm1(-1.0), rtol=1e-6)
    assert np.all(clamped == 0)
    assert np.all(error == 0)


def test_images_of_many_seeds_are_unbiased_and_their_errors_true() -> None:
    """Per pixel over seeds: the mean agrees with a finer image, the scatter with the errors."""
    sigma_t, affine, rays = random_scene(3, True)
    terms = [cone(25, [1, 2, 0.5]), (UP, "direction", -1.0, constant(0.3))]
    arguments = (sigma_t, 0.9 * sigma_t, None, affine, terms, rays, 14, 12)
    fine, fine_error = image(*arguments, points=64, directions=64, seed=100)
    runs = [image(*arguments, points=2, directions=2, seed=s) for s in range(24)]
    values = np.array([run[0] for run in runs])[..., 0]
    claimed = np.mean([run[1] ** 2 for run in runs], axis=0)[..., 0]
    lit = (fine_error[..., 0] < 0.2 * fine[..., 0]) & (fine[..., 0] > 0.05 * fine[..., 0].max())
    pixels = int(lit.sum())
    assert pixels > 60
    made = values.var(axis=0, ddof=1)
    error = np.sqrt(made / len(runs) + fine_error[..., 0] ** 2)
    z = (values.mean(axis=0) - fine[..., 0])[lit] / error[lit]
    # Near enough to normal with some 20 degrees of freedom: variance 1.1.
    assert abs(z.mean()) < 4 * math.sqrt(1.1 / pixels)
    assert np.mean(z**2) < 1.1 + 4 * math.sqrt(3 / pixels)
    # Ratio of summed variances, each of 23 degrees of freedom, dominated by the brighter half.
    ratio = made[lit].sum() / claimed[lit].sum()
    assert ratio == pytest.approx(1, abs=4 * math.sqrt(2 / 23 / (pixels / 4)))
    assert stats.kstest(z, "norm").pvalue > 1e-4


def test_any_number_of_threads_gives_the_same_and_cancel_stops_it() -> None:
    sigma_t, affine, rays = random_scene(3, True)
    arguments = (sigma_t, sigma_t, None, affine, [cone(25)], rays, 14, 12)
    one = image(*arguments, points=2, directions=4, threads=1)
    for threads in (2, 3):
        again = image(*arguments, points=2, directions=4, threads=threads)
        assert all(np.array_equal(a, b) for a, b in zip(one, again, strict=True))
    control = native.Control()

    def cancel_once_under_way() -> None:
        while control.progress == 0:
            time.sleep(0.001)
        control.cancel()

    watcher = threading.Thread(target=cancel_once_under_way)
    watcher.start()
    with pytest.raises(native.Cancelled):
        image(*arguments, points=64, directions=256, control=control)
    watcher.join()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"sigma_t": np.zeros((1, 3, 3, 3), np.float32)}, r"sigma_s is 1.* at \(0, 0, 0\)"),
        ({"sigma_s": np.ones((1, 3, 3, 4), np.float32)}, r"the grid of sigma_t, \(3, 3, 3\)"),
        ({"emission": np.ones((2, 3, 3, 3), np.float32)}, "emission has shape .* c = 1 or 3"),
        ({"height": 0}, "image of 1 x 0 pixels"),
        ({"points": 0}, "points is 0"),
        ({"radius": -1.0}, "radius is -1"),
        ({"rays": np.zeros((6, 3))}, "rays have no direction"),
    ],
)
def test_bad_input_is_named(changes: dict[str, Any], message: str) -> None:
    ones = np.ones((1, 3, 3, 3), np.float32)
    arguments: dict[str, Any] = {
        "sigma_t": ones,
        "sigma_s": ones,
        "emission": None,
        "index_to_world": np.eye(4),
        "terms": [cone(30)],
        "rays": FROM_ABOVE,
        "width": 1,
        "height": 1,
    }
    with pytest.raises(ValueError, match=message):
        image(**(arguments | changes))
