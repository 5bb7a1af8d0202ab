"""Sums over half balls against the judge, whole balls, closed forms and their own symmetries."""

from __future__ import annotations

import math
import threading

import numpy as np
import pytest
from numpy.typing import NDArray
from trilinear import affine

import volillum_native
from volillum_native import convolve, hemisphere_sums

IDENTITY = np.eye(4)
# float32 sums of some hundred positive terms, in runs of tens.
ROUNDING = 2e-6
CUBATURE = 3e-6


def random_field(shape: tuple[int, ...], seed: int) -> NDArray[np.float32]:
    return np.random.default_rng(seed).random(shape).astype(np.float32)


def ramp(shape: tuple[int, ...], direction: NDArray[np.float64]) -> NDArray[np.float32]:
    """A guide whose negative gradient by index is `direction`, everywhere but at the border."""
    index = np.stack(np.meshgrid(*(np.arange(n) for n in shape), indexing="ij"), axis=-1)
    return np.asarray(100 - index @ direction, np.float32)[None]


def hat_share(
    offset: tuple[int, int, int], normal: NDArray[np.float64], p: int, nodes: int = 48
) -> float:
    """Share of the integral of |y|^-p hat(y - offset) at y . normal > 0, by midpoints."""
    fine = (np.arange(nodes) + 0.5) / nodes * 2 - 1
    hat = 1 - np.abs(fine)
    y = [fine + o for o in offset]
    squared = y[0][:, None, None] ** 2 + y[1][:, None] ** 2 + y[2] ** 2
    weight = hat[:, None, None] * hat[:, None] * hat * squared ** (-p / 2)
    side = (y[0] * normal[0])[:, None, None] + (y[1] * normal[1])[:, None] + y[2] * normal[2]
    return float(weight[side > 0].sum() / weight.sum())


@pytest.mark.parametrize("p", [0, 1, 2])
def test_the_share_of_a_voxel_on_either_side(p: int) -> None:
    """One voxel of 1 seen from its neighbours, against the cut hat itself.

    The share differs from a hat's own where its kurtosis does (-0.6 along an axis, -0.2 along a
    diagonal, -0.55 assumed: 0.01 at most), and by what the weight |y|^-p shifts the hat's mean
    toward the origin, p / 6 voxels over the square of the distance, times the largest density, 1.
    Of the nearest voxels the weight is integrated with the hat, and as much is lost by bands of
    their shares above the seventh as by the kurtosis of others.
    """
    shape, radius = (9, 9, 9), 3.9
    field = np.zeros((1, *shape), np.float32)
    field[0, 4, 4, 4] = 1
    whole = convolve(field, IDENTITY, radius=radius, weight_p=p, precision="double")[0]
    for seed in range(4):
        normal = np.random.default_rng(seed).normal(size=3)
        normal /= np.linalg.norm(normal)
        if seed == 0:
            normal = np.array([1.0, 0.0, 0.0])
        half = hemisphere_sums(field, ramp(shape, normal), IDENTITY, radius=radius, weight_p=p)[0]
        for offset in ((1, 0, 0), (0, -1, 1), (2, 0, -1), (-1, 2, 1)):
            at = tuple(4 - o for o in offset)
            found = float(half[at] / (2 * whole[at]))
            is_nearest = max(map(abs, offset)) == 1
            squared = sum(o * o for o in offset)
            room = 0.012 + (0 if is_nearest else p / 6 / squared)
            assert abs(found - hat_share(offset, normal, p)) < room
        far = tuple(4 - o for o in (3, 1, 0)) if normal[0] > 0.9 else None
        if far:
            assert half[far] == pytest.approx(2 * whole[far], rel=ROUNDING)


@pytest.mark.parametrize("p", [0, 1, 2])
@pytest.mark.parametrize("matrix", [IDENTITY, affine(1), affine(4, mirrored=True)])
def test_both_halves_make_twice_the_whole(p: int, matrix: NDArray[np.float64]) -> None:
    field, guide = random_field((2, 9, 8, 37), seed=1), random_field((1, 9, 8, 37), seed=2)
    given = {"radius": 2.3, "weight_p": p, "total": 2.3}
    both = sum(hemisphere_sums(field, side, matrix, **given) for side in (guide, -guide))
    whole = convolve(field, matrix, precision="double", **given)
    assert np.allclose(both, 2 * whole, rtol=ROUNDING)


def test_a_homogeneous_medium_counts_alike_on_every_side() -> None:
    field = np.full((1, 11, 11, 41), 0.7, np.float32)
    found = hemisphere_sums(field, random_field((1, 11, 11, 41), seed=3), IDENTITY, radius=4.2,
                            total=4.2)  # fmt: skip
    assert np.allclose(found[0, 5, 5, 5:-5], np.float32(0.7) * 4.2, rtol=CUBATURE)


@pytest.mark.parametrize("p", [0, 1, 2])
@pytest.mark.parametrize("matrix", [IDENTITY, affine(1), affine(4)])
def test_a_field_that_is_linear_along_the_gradient(p: int, matrix: NDArray[np.float64]) -> None:
    """Mean of y . n over the half ball, weighted |y|^-p: R/2 (3 - p) / (4 - p), in the world of any
    lattice; the shares know no fall of the weight inside hats but the nearest, an error of second
    order in the voxel's share of the radius (0.015 / R^2 for p = 2 and cubes, 0.1 where oblong)."""
    slope = np.array([0.2, -0.1, 0.3])
    voxel = abs(np.linalg.det(matrix[:3, :3])) ** (1 / 3)
    for radius in (4, 8):
        half = 2 * radius + 2
        side = np.arange(-half, half + 1.0)
        place = np.stack(np.meshgrid(side, side, side, indexing="ij"), axis=-1) @ matrix[:3, :3].T
        field = (20 + place @ slope).astype(np.float32)[None]
        found = hemisphere_sums(field, field, matrix, radius=radius * voxel, weight_p=p)[0]
        mean = np.linalg.norm(slope) * radius * voxel / 2 * (3 - p) / (4 - p)
        assert 20 - found[half, half, half] == pytest.approx(mean, rel=0.15 / radius**2)


def test_without_a_gradient_it_is_the_whole_ball() -> None:
    """Also where a constant is only constant to rounding."""
    field = random_field((1, 9, 10, 11), seed=4)
    flat = np.full((1, 30, 30, 30), 1e6, np.float32)
    flat *= 1 + np.float32(1e-7) * np.random.default_rng(5).integers(-2, 3, flat.shape)
    flat = np.ascontiguousarray(flat[:, 3:12, 3:13, 3:14], np.float32)
    found = hemisphere_sums(field, flat, IDENTITY, radius=3.0)
    whole = convolve(field, IDENTITY, radius=3.0, precision="double")
    inside = (0, *(slice(1, -1),) * 3)
    assert np.allclose(found[inside], whole[inside], rtol=ROUNDING)


def test_mirrored_and_turned_fields() -> None:
    field, guide = random_field((1, 9, 12, 35), seed=6), random_field((1, 9, 12, 35), seed=7)
    plain = hemisphere_sums(field, guide, IDENTITY, radius=3.3)
    for axis in (1, 2, 3):
        turned = [np.ascontiguousarray(np.flip(each, axis)) for each in (field, guide)]
        found = hemisphere_sums(*turned, IDENTITY, radius=3.3)
        assert np.allclose(np.flip(found, axis), plain, rtol=ROUNDING)
    turned = [np.ascontiguousarray(each.transpose(0, 3, 1, 2)) for each in (field, guide)]
    found = hemisphere_sums(*turned, IDENTITY, radius=3.3)
    # Cubature differs by axis, absolutely: of a full sum of 1.
    assert np.allclose(found.transpose(0, 2, 3, 1), plain, rtol=ROUNDING, atol=CUBATURE)


def test_thin_matter_before_an_opaque_wall_keeps_its_precision() -> None:
    """What is behind cancels nothing: the wall's weight on the open side is 0 exactly."""
    field = np.full((1, 9, 9, 20), 1e-6, np.float32)
    wall = field.copy()
    wall[..., :8] = 1e6
    guide = ramp((9, 9, 20), np.array([0.0, 0.0, 1.0]))
    found = hemisphere_sums(wall, guide, IDENTITY, radius=3.0)[0, 4, 4]
    alone = hemisphere_sums(field, guide, IDENTITY, radius=3.0)[0, 4, 4]
    # Two voxels before the wall and further, no hat of the wall reaches the open side.
    assert np.allclose(found[9:], alone[9:], rtol=ROUNDING)
    assert found[7] > 1e3


@pytest.mark.parametrize("shape", [(1, 1, 1), (1, 7, 1), (2, 3, 40)])
@pytest.mark.parametrize("radius", [0.2, 3.0, 1000.0])
def test_thin_grids_and_radii_beyond_them(shape: tuple[int, int, int], radius: float) -> None:
    field, guide = random_field((1, *shape), seed=8), random_field((1, *shape), seed=9)
    both = sum(hemisphere_sums(field, side, IDENTITY, radius=radius) for side in (guide, -guide))
    whole = convolve(field, IDENTITY, radius=radius, precision="double")
    assert np.allclose(both, 2 * whole, rtol=ROUNDING)


def test_the_number_of_threads_changes_no_bit() -> None:
    field, guide = random_field((1, 9, 8, 37), seed=10), random_field((3, 9, 8, 37), seed=11)
    results = [
        hemisphere_sums(field, guide, affine(3), radius=3.0, threads=threads)
        for threads in (1, 2, 5)
    ]
    assert np.array_equal(results[0], results[1])
    assert np.array_equal(results[0], results[2])


def test_opacities_complements_and_bounds_are_those_of_the_convolution() -> None:
    field = random_field((1, 9, 9, 9), seed=12)
    alpha = (-np.expm1(-field.astype(np.float64) * 0.8)).astype(np.float32)
    plain = hemisphere_sums(alpha, field, IDENTITY, radius=2.0)
    found = hemisphere_sums(field, field, IDENTITY, radius=2.0, opacity_length=0.8)
    assert np.allclose(found, plain, rtol=1e-6)
    open_ = hemisphere_sums(alpha, field, IDENTITY, radius=2.0, complement=True, upper=0.5)
    assert np.allclose(open_, 1 - np.minimum(plain, 0.5), atol=1e-7)


def test_empty_regions_change_nothing() -> None:
    """Rows that are skipped because they hold nothing."""
    field, guide = random_field((1, 12, 12, 90), seed=13), random_field((1, 12, 12, 90), seed=14)
    field[:, :, :, 30:] = 0
    field[:, :5] = 0
    found = hemisphere_sums(field, guide, IDENTITY, radius=3.0)
    faint = np.where(field == 0, np.float32(1e-30), field)
    assert np.allclose(hemisphere_sums(faint, guide, IDENTITY, radius=3.0), found, atol=1e-27)
    assert not found[0, :2].any()


def test_it_can_be_cancelled_and_tells_its_progress() -> None:
    field = random_field((2, 12, 12, 12), seed=15)
    control = volillum_native.Control()
    worker = threading.Thread(
        target=lambda: hemisphere_sums(field, field, IDENTITY, radius=3.0, control=control)
    )
    worker.start()
    worker.join()
    assert control.progress == pytest.approx(1)
    control = volillum_native.Control()
    control.cancel()
    with pytest.raises(volillum_native.Cancelled):
        hemisphere_sums(field, field, IDENTITY, radius=3.0, control=control)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"radius": math.inf}, "radius is inf"),
        ({"guide": np.zeros((1, 2, 2, 3), np.float32)}, "guide has shape"),
        ({"index_to_world": np.zeros((4, 4))}, "determinant"),
    ],
)
def test_bad_input_is_named(change: dict[str, object], message: str) -> None:
    one = np.zeros((1, 2, 2, 2), np.float32)
    given: dict[str, object] = {
        "field": one, "guide": one, "index_to_world": IDENTITY, "radius": 1.0
    }  # fmt: skip
    with pytest.raises(ValueError, match=message):
        hemisphere_sums(**(given | change))
