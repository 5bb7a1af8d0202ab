"""The published slice algorithms err as they were measured to: the laws of their own errors."""

from __future__ import annotations

import math

import numpy as np
import pytest
from media import smooth_random

from volillum_addon.core.camera import Camera
from volillum_addon.core.errors import InputError
from volillum_addon.core.lights import DistantLight
from volillum_addon.core.medium import Medium
from volillum_addon.core.native import native
from volillum_addon.core.scene import Scene
from volillum_addon.models.illuminate import illuminate
from volillum_addon.models.model import Model
from volillum_addon.models.registry import models
from volillum_addon.models.volume import IlluminationVolume

UP = np.array([0.0, 0.0, 1.0])
# 10 % to 90 % of a normal distribution, in standard deviations.
TEN_TO_NINETY = 2.5631031


@pytest.mark.parametrize(
    ("per_unit", "taps", "variance"),
    [(8, 2, 0.25), (32, 2, 0.25), (128, 2, 0.25), (8, 4, 0.3125), (32, 4, 0.3125)],
)
def test_the_penumbra_narrows_with_the_root_of_the_slice_distance(
    per_unit: int, taps: int, variance: float
) -> None:
    """Case X1: below a knife edge at height 1, theta 45 degrees, the 10-90 % width is
    2.563 sqrt(n v R^2), n = 1 / Delta slices with the taps' variance v R^2, R = Delta tan(theta);
    the model's own equation has 1.245 whatever Delta.

    Bilinear lookups at a fraction f of a pixel add n f (1 - f) pixel^2.
    """
    across, deep, pixel, distance = 301, 64, 0.01, 1 / per_unit
    # Opaque above z = 1 (thicker than a slice) over x < 0, void below.
    sigma = np.zeros((across, 1, deep + 17), np.float32)
    sigma[: across // 2, :, deep:] = 1e4
    affine = np.diag([pixel, 1.0, 1 / deep, 1.0])
    profile = native.blurred_slices(
        sigma[None], affine, UP, distance=distance, pixel=pixel, theta=math.pi / 4, taps=taps
    )[0, :, 0, 0]
    profile = profile[across // 4 :]  # beyond the occluder's other end there is light again
    low, high = np.interp([0.1, 0.9], profile, np.arange(len(profile)) * pixel)
    fractions = np.array([distance * abs(2 * a + 1 - taps) / taps / pixel for a in range(taps)]) % 1
    blur = np.mean(fractions * (1 - fractions)) * pixel**2
    expected = TEN_TO_NINETY * math.sqrt(per_unit * (variance * distance**2 + blur))
    # Where the last opaque slice lies is uncertain by one of n, so the width by 1 / 2 n; a sum of
    # 8 steps is not yet normal (2 %); the edge itself is a voxel wide.
    assert high - low == pytest.approx(expected, rel=0.02 + 0.5 / per_unit, abs=pixel)


@pytest.mark.parametrize("theta", [0.1, math.radians(45), math.radians(80)])
def test_a_half_space_hides_the_same_whatever_the_cone(theta: float) -> None:
    """The recursion attenuates by exp(-sigma_t Delta) a slice, oblique or not: exp(-t). The model's
    own equation has E2-like values that depend on theta (case C1)."""
    sigma = np.ones((1, 3, 3, 33), np.float32)
    affine = np.diag([1e4, 1e4, 1 / 16, 1.0])
    distance = 1 / 64
    found = native.blurred_slices(
        sigma, affine, UP, distance=distance, pixel=1e4, theta=theta, taps=4
    )[0, 1, 1]
    # The trilinear border above the last voxel counts half a voxel.
    depth = (32.5 - np.arange(33)) / 16
    # Slices sample the exponent by a one-sided sum: at most one slice of depth.
    assert np.all(np.abs(np.log(found) + depth) < distance + 1e-3)


def test_lookups_from_slice_to_slice_diffuse_as_a_binomial() -> None:
    """128 slices at a shift of a quarter voxel move a thin shadow by 32 voxels and spread it by
    sqrt(128 / 4 * 3 / 4)."""
    sigma = np.zeros((129, 1, 101), np.float32)
    sigma[128, :, 80] = 1e-3
    rise, run = 1.0, 0.25
    toward = np.array([rise, 0, run]) / math.hypot(rise, run)
    out = native.propagated_shadow(sigma[None], np.zeros_like(sigma)[None], np.eye(4), toward)
    shadow = out[1, 0, 0].astype(np.float64)
    index = np.arange(101)
    mean = np.sum(shadow * index) / shadow.sum()
    spread = math.sqrt(np.sum(shadow * (index - mean) ** 2) / shadow.sum())
    assert mean == pytest.approx(80 - 128 * 0.25, abs=1e-3)
    assert spread == pytest.approx(4.898979, abs=1e-3)


@pytest.mark.parametrize(
    ("buffer", "depth", "slices", "expected"),
    [
        ("byte", 0.4, 256, 1.0),
        ("half", 0.2, 1024, 1.0),
        ("half", 0.4, 256, 1.010 * math.exp(-0.4)),
        ("float", 0.4, 256, math.exp(-0.4)),
    ],
)
def test_coarse_buffers_never_see_thin_media(
    buffer: str, depth: float, slices: int, expected: float
) -> None:
    """Case X5: an attenuation per slice below half a step of the buffer is rounded away."""
    sigma = np.full((1, 1, 1, slices), depth, np.float32)
    found = native.blurred_slices(
        sigma, np.diag([1.0, 1.0, 1 / slices, 1.0]), UP, distance=1 / slices, pixel=1.0,
        theta=0.0, taps=1, buffer=buffer,
    )[0, 0, 0, 0]  # fmt: skip
    # One slice more or less above the voxel changes it by 0.4 / 256.
    assert found == pytest.approx(expected, abs=1e-6 if expected == 1.0 else 2.5e-3)


def test_a_byte_of_shadow_never_begins() -> None:
    sigma = np.full((1, 1, 1, 256), 0.4, np.float32)
    affine = np.diag([1.0, 1.0, 1 / 256, 1.0])
    shadow = {
        buffer: native.propagated_shadow(sigma, sigma, affine, UP, buffer=buffer)[1, 0, 0, 0]
        for buffer in ("byte", "float")
    }
    assert shadow["byte"] == 0.0
    # The top voxel reads the void beyond: 255 slices.
    assert shadow["float"] == pytest.approx(1 - math.exp(-0.4 * 255 / 256), abs=1e-5)


def test_oblique_light_is_attenuated_too_little() -> None:
    """Opacities are those of the slices' distance: exp(-sigma_t h) a slice at any angle, where the
    light's way is h / cos(phi)."""
    sigma = np.full((1, 61, 41), 1.0, np.float32)
    affine = np.diag([1e6, 0.05, 0.05, 1.0])
    angle = math.radians(35)
    toward = np.array([0, math.sin(angle), math.cos(angle)])
    out = native.propagated_shadow(sigma[None], np.zeros_like(sigma)[None], affine, toward)
    # Far from the sides: 20 slices below the top, which itself reads void.
    assert out[1, 0, 0, 20] == pytest.approx(1 - math.exp(-20 * 0.05), abs=1e-5)


def test_local_visibilities_compose_into_the_global_one() -> None:
    """V_{R1 + R2}(x, w) = V_{R1}(x, w) V_{R2}(x + R1 w, w): exact where steps meet voxels."""
    medium = smooth_random((12, 10, 14), 3).sigma_t.values
    summed = np.pad(np.cumsum(medium[:, :, ::-1], axis=2)[:, :, ::-1], ((0, 0), (0, 0), (0, 4)))
    local = np.exp(-(summed[:, :, :14] - summed[:, :, 4:]) / 40).astype(np.float32)
    composed = native.composed_visibility(local, np.array([0.0, 0.0, 4.0]), steps=4)[0]
    assert np.allclose(composed, np.exp(-summed[:, :, :14] / 40), rtol=1e-5)


def test_all_threads_give_the_same_bits() -> None:
    planes = smooth_random((20, 17, 23), 4).sigma_t.planes()
    toward = np.array([0.3, -0.5, 0.81]) / np.linalg.norm([0.3, -0.5, 0.81])
    for threads in (1, 3):
        found = (
            native.blurred_slices(planes, np.eye(4) / 20 + np.diag([0, 0, 0, 0.95]), toward,
                                  distance=0.05, pixel=0.05, theta=0.6, threads=threads),
            native.propagated_shadow(planes, planes, np.eye(4), toward, neighbours=8,
                                     threads=threads),
            native.composed_visibility(np.exp(-planes[0]), toward * 3, steps=5, threads=threads),
        )  # fmt: skip
        if threads == 1:
            single = found
    assert all(np.array_equal(a, b) for a, b in zip(single, found, strict=True))


@pytest.mark.parametrize(
    "model",
    [model for model in models() if any(p.name == "algorithm" for p in model.parameters)],
    ids=lambda model: model.id,
)
def test_every_published_variant_is_bounded_and_is_not_the_equation(
    model: Model,
) -> None:
    medium = Medium.from_density(smooth_random((20, 18, 22), 5, depth=3.0).sigma_t, 1.0, 0.8)
    scene = Scene(medium, (DistantLight((0.3, -0.5, 0.8), 1.0),), Camera((2, -6, 3), (0.5,) * 3))

    def run(**given: object) -> IlluminationVolume:
        return illuminate(scene, model.id, given)

    equation, published = run(), run(algorithm="published")
    assert equation.channels.keys() == published.channels.keys()
    a, b = (v.in_scattered().values.astype(np.float64) for v in (equation, published))
    assert np.all(np.isfinite(b))
    assert np.all(b >= 0)
    difference = math.sqrt(np.mean((a - b) ** 2) / np.mean(a**2))
    # The same light, otherwise solved: near, and further away than the equation's own error (1 %).
    assert 0.01 < difference < 0.5


def test_an_eye_inside_is_refused_by_the_slices() -> None:
    medium = smooth_random((8, 8, 8), 1)
    camera = Camera((0.5, 0.5, 0.5), (0.5, 0.9, 0.5))
    scene = Scene(medium, (DistantLight(UP, 1.0),), camera)
    with pytest.raises((InputError, ValueError), match="the eye is beside or inside the volume"):
        illuminate(scene, "directional_occlusion", {"algorithm": "published"})
