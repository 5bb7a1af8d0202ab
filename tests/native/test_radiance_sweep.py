"""The radiance sweep against rays in numpy: order, symmetries, threads, hard and empty media."""

from __future__ import annotations

import math

import numpy as np
import pytest
from radiance_truth import hue, radiance
from scipy.ndimage import map_coordinates
from trilinear import affine

import volillum_native as native

WHITE = np.ones(3)
DIRECTIONS = np.array(
    [[0.3, 0.5, 0.8], [0.8, -0.4, 0.2], [-0.1, -0.9, 0.3], [0.6, 0.6, -0.6], [0, 0, 1]]
)
DIRECTIONS /= np.linalg.norm(DIRECTIONS, axis=1)[:, None]
ONE = np.ones(1, np.float32)


def smooth(n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """One smooth field, its colours apart, on about n voxels a side of a box of extent 1."""
    shape = (n, n + n // 4, n - n // 4)
    x, y, z = np.meshgrid(*((np.arange(m) + 0.5) / m for m in shape), indexing="ij")
    bump = (np.sin(np.pi * x) * np.sin(np.pi * y) * np.sin(np.pi * z)) ** 2
    bump = bump * (1 + 0.5 * np.sin(5 * x + 3 * y) * np.cos(4 * z - 2 * x))
    sigma_t = np.stack([3 * bump, 5 * bump * (1 + 0.3 * np.sin(6 * y)), 8 * bump])
    albedo = np.array([0.7, 0.5, 0.25])[:, None, None, None] * (1 + 0.3 * np.cos(5 * z))
    index_to_world = np.diag([*(1 / np.array(shape)), 1.0])
    return sigma_t.astype(np.float32), (albedo * sigma_t).astype(np.float32), index_to_world


def random_medium(seed: int, channels: int = 3) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    shape = (9, 11, 10)
    sigma_t = rng.uniform(0, 1, (channels, *shape)) * (rng.uniform(size=shape) < 0.4)
    return sigma_t.astype(np.float32), rng.uniform(0, 1, (3, *shape)).astype(np.float32)


@pytest.mark.parametrize("near", [0, 2])
def test_second_order(near: int) -> None:
    errors = []
    for n in (12, 24, 48):
        sigma_t, source, index_to_world = smooth(n)
        rng = np.random.default_rng(n)
        error = []
        for direction in DIRECTIONS:
            out = native.mean_hue(
                sigma_t, source, index_to_world, direction[None], ONE, WHITE, near_slices=near
            )
            for _ in range(60):
                index = tuple(rng.integers(0, size) for size in out.shape[1:])
                origin = index_to_world[:3, :3] @ index
                light = radiance(sigma_t, source, index_to_world, origin, direction, WHITE, 0)
                error.append(out[(slice(None), *index)] - hue(light, 1e-6, WHITE))
        errors.append(math.sqrt(np.mean(np.square(error))))
    # Two doublings: 16 for second order, 4 for first, in 300 samples of an error that varies over
    # the field.
    assert errors[0] / errors[2] > 7
    assert errors[2] < 5e-4


@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("mirrored", [False, True])
def test_all_of_a_rough_medium_in_the_near_field(channels: int, mirrored: bool) -> None:
    """Voxels that do not correlate, a sheared and rotated lattice, glow where nothing absorbs."""
    sigma_t, source = random_medium(3, channels)
    index_to_world = affine(5, mirrored)
    tint = np.array([1.2, 1.0, (1 - 0.2126 * 1.2 - 0.7152) / 0.0722])
    rng = np.random.default_rng(4)
    error, scale = [], []
    for direction in DIRECTIONS:
        out = native.mean_hue(
            sigma_t, source, index_to_world, direction[None], ONE, tint, near_slices=99
        )
        for _ in range(12):
            index = tuple(rng.integers(0, size) for size in out.shape[1:])
            origin = index_to_world[:3, :3] @ index + index_to_world[:3, 3]
            light = radiance(sigma_t, source, index_to_world, origin, direction, tint)
            error.append(out[(slice(None), *index)] - hue(light, 1e-6, tint))
            scale.append(hue(light, 1e-6, tint))
    # Optical depths are exact; only how the glow is spread between a cell's wall and its middle is
    # taken as linear: 0.04 % (measured), where linear from wall to wall would leave 3 to 5 %.
    assert math.sqrt(np.mean(np.square(error)) / np.mean(np.square(scale))) < 1e-3


def test_weights_sum_over_directions() -> None:
    sigma_t, source = random_medium(6)
    weights = np.array([0.1, 0.3, 0.2, 0.25, 0.15], np.float32)
    together = native.mean_hue(sigma_t, source, np.eye(4), DIRECTIONS, weights, WHITE)
    apart = sum(
        weight * native.mean_hue(sigma_t, source, np.eye(4), each[None], ONE, WHITE)
        for weight, each in zip(weights, DIRECTIONS, strict=True)
    )
    assert np.allclose(together, apart, rtol=2e-6)


@pytest.mark.parametrize("spacing", [1, 3])
def test_weights_that_vary_from_node_to_node(spacing: int) -> None:
    """Linear between nodes; directions of all major axes."""
    sigma_t, source = random_medium(6)
    shape = sigma_t.shape[1:]
    nodes = [math.ceil((n - 1) / spacing) + 1 for n in shape]
    weights = np.random.default_rng(8).random((len(DIRECTIONS), *nodes), dtype=np.float32)
    found = native.mean_hue(
        sigma_t, source, np.eye(4), DIRECTIONS, weights, WHITE, node_spacing=spacing
    )
    place = np.stack(np.meshgrid(*[np.arange(n) / spacing for n in shape], indexing="ij"))
    truth = sum(
        map_coordinates(field, place, order=1, output=np.float64)
        * native.mean_hue(sigma_t, source, np.eye(4), each[None], ONE, WHITE)
        for field, each in zip(weights, DIRECTIONS, strict=True)
    )
    assert np.allclose(found, truth, rtol=3e-6)


def test_mirrored_and_turned() -> None:
    """Flipping an axis, or exchanging two, of the medium and the direction."""
    sigma_t, source = random_medium(7)
    direction = DIRECTIONS[0]
    plain = native.mean_hue(sigma_t, source, np.eye(4), direction[None], ONE, WHITE)
    for axis in range(3):
        flipped = native.mean_hue(
            np.ascontiguousarray(np.flip(sigma_t, axis + 1)),
            np.ascontiguousarray(np.flip(source, axis + 1)), np.eye(4),
            np.where(np.arange(3) == axis, -direction, direction)[None], ONE, WHITE,
        )  # fmt: skip
        assert np.allclose(np.flip(flipped, axis + 1), plain, rtol=1e-4)
    for order in ((1, 2, 0), (2, 0, 1), (1, 0, 2)):
        axes = (0, *(a + 1 for a in order))
        turned = native.mean_hue(
            np.ascontiguousarray(sigma_t.transpose(axes)),
            np.ascontiguousarray(source.transpose(axes)), np.eye(4),
            direction[list(order)][None], ONE, WHITE,
        )  # fmt: skip
        # Rounding of the fractions at which rays cross slices, on steep gradients.
        assert np.allclose(turned, plain.transpose(axes), rtol=1e-4)


def test_any_number_of_threads() -> None:
    sigma_t, source = random_medium(8)
    weights = np.full(len(DIRECTIONS), 0.2, np.float32)
    one, three = (
        native.mean_hue(sigma_t, source, affine(9), DIRECTIONS, weights, WHITE, threads=threads)
        for threads in (1, 3)
    )
    assert np.array_equal(one, three)


@pytest.mark.parametrize("shape", [(1, 1, 1), (1, 1, 40), (40, 1, 2), (3, 70, 1)])
def test_thin_grids(shape: tuple[int, int, int]) -> None:
    rng = np.random.default_rng(10)
    sigma_t = rng.uniform(0, 2, (1, *shape)).astype(np.float32)
    source = rng.uniform(0, 2, (3, *shape)).astype(np.float32)
    for direction in DIRECTIONS:
        for near in (0, 99):
            out = native.mean_hue(
                sigma_t, source, np.eye(4), direction[None], ONE, WHITE, near_slices=near
            )
            assert np.isfinite(out).all()
        index = tuple(size // 2 for size in shape)
        light = radiance(sigma_t, source, np.eye(4), np.array(index, float), direction, WHITE)
        # Noise whose glow does not follow its extinction, optical depths of up to 3 in one cell:
        # linear from wall to middle is off by up to 3 % in one colour (measured).
        assert out[(slice(None), *index)] == pytest.approx(hue(light, 1e-6, WHITE), rel=0.05)


def test_vacuum_and_extremes() -> None:
    tint = np.array([1.5, 0.9, (1 - 0.2126 * 1.5 - 0.7152 * 0.9) / 0.0722])
    zeros = np.zeros((3, 5, 6, 7), np.float32)
    weights = np.full(len(DIRECTIONS), 0.2, np.float32)
    empty = native.mean_hue(zeros, zeros, np.eye(4), DIRECTIONS, weights, tint)
    assert np.allclose(empty, tint[:, None, None, None], rtol=2e-6)
    for sigma_t in (0.0, 1e-30, 1e30):
        for source in (0.0, 1e-30, 1e38):
            out = native.mean_hue(
                zeros + np.float32(sigma_t), zeros + np.float32(source), np.eye(4), DIRECTIONS,
                weights, tint,
            )  # fmt: skip
            assert np.isfinite(out).all()


def test_refusals() -> None:
    sigma_t, source = random_medium(11)
    good = (sigma_t, source, np.eye(4), DIRECTIONS[:1].copy(), ONE, WHITE)

    def call(position: int, value: object, **settings: object) -> None:
        arguments = list(good)
        arguments[position] = value
        native.mean_hue(*arguments, **settings)

    with pytest.raises(ValueError, match="1 or 3 channels"):
        call(0, sigma_t[:2].copy())
    with pytest.raises(ValueError, match="source has shape"):
        call(1, source[:, :4].copy())
    with pytest.raises(ValueError, match="determinant"):
        call(2, np.zeros((4, 4)))
    with pytest.raises(ValueError, match="unit vectors"):
        call(3, 2 * DIRECTIONS[:1])
    with pytest.raises(ValueError, match="one for each direction"):
        call(4, np.ones(2, np.float32))
    with pytest.raises(ValueError, match="near_slices is -1"):
        call(5, WHITE, near_slices=-1)
    control = native.Control()
    control.cancel()
    with pytest.raises(native.Cancelled):
        call(5, WHITE, control=control)
