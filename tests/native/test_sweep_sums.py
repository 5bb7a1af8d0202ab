"""How the sweep sums directions: weights, opposite pairs, symmetries, threads, cancelling."""

from __future__ import annotations

import threading
import time

import numpy as np
import pytest
from numpy.typing import NDArray
from trilinear import Array, affine

import volillum_native

Volume = NDArray[np.float32]
IDENTITY = np.eye(4)


def random_directions(count: int, seed: int = 1) -> Array:
    vectors = np.random.default_rng(seed).normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def random_grid(shape: tuple[int, int, int], seed: int = 2) -> Volume:
    return np.random.default_rng(seed).random(shape, dtype=np.float32) * np.float32(0.1)


def one_by_one(sigma_t: Volume, world: Array, directions: Array, near_slices: int) -> Volume:
    one = np.ones((1, 1), np.float32)
    return np.array(
        [
            volillum_native.sweep(sigma_t, world, w[None], one, near_slices=near_slices)[0]
            for w in directions
        ]
    )


@pytest.mark.parametrize("channels", [1, 3, 4, 16, 18])
@pytest.mark.parametrize("near_slices", [0, 4])
def test_weighted_sum_of_single_directions(channels: int, near_slices: int) -> None:
    """Any number of directions and channels, in batches, is the sum of single sweeps."""
    sigma_t, world = random_grid((21, 34, 50)), affine(3)
    directions = random_directions(61)
    weights = np.random.default_rng(4).normal(size=(61, channels)).astype(np.float32)
    found = volillum_native.sweep(sigma_t, world, directions, weights, near_slices=near_slices)
    single = one_by_one(sigma_t, world, directions, near_slices)
    truth = np.einsum("dijk,dc->cijk", single.astype(np.float64), weights)
    # 61 float32 additions of terms up to |w|: n / 2 units of 6e-8 of their sum at most.
    bound = 61 / 2 * 6e-8 * np.abs(weights).sum(axis=0)
    assert np.all(np.abs(found - truth) <= bound[:, None, None, None])


def test_opposite_directions_equal_single_ones() -> None:
    sigma_t, world = random_grid((33, 40, 37)), affine(5)
    directions = random_directions(9, seed=6)
    pairs = np.concatenate([directions, -directions])
    weights = np.eye(18, dtype=np.float32)
    found = volillum_native.sweep(sigma_t, world, pairs, weights)
    # A term of weight 1 among zeros: the sum adds nothing, bit for bit.
    np.testing.assert_array_equal(found, one_by_one(sigma_t, world, pairs, near_slices=4))


def test_opposite_directions_add_up_to_the_whole_ray() -> None:
    """Depth forward plus depth backward does not change along an axis."""
    sigma_t = random_grid((50, 6, 7))
    pair = np.array([[1.0, 0, 0], [-1.0, 0, 0]])
    total = volillum_native.sweep(
        sigma_t, IDENTITY, pair, np.ones((2, 1), np.float32), quantity="optical_depth"
    )[0]
    line = sigma_t.astype(np.float64).sum(axis=0)
    np.testing.assert_allclose(total, np.broadcast_to(line, total.shape), rtol=1e-6)


@pytest.mark.parametrize("radius", [np.inf, 9.0])
def test_results_do_not_depend_on_the_number_of_threads(radius: float) -> None:
    sigma_t, world = random_grid((70, 90, 150)), affine(7)
    directions = random_directions(20)
    weights = np.random.default_rng(8).normal(size=(20, 5)).astype(np.float32)
    first, *others = (
        volillum_native.sweep(sigma_t, world, directions, weights, radius=radius, threads=threads)
        for threads in (1, 2, 3, 2)
    )
    for other in others:
        np.testing.assert_array_equal(first, other)


@pytest.mark.parametrize("near_slices", [0, 4])
def test_symmetries(near_slices: int) -> None:
    """Permuting and mirroring the axes of volume and direction permutes the result."""
    sigma_t = random_grid((20, 25, 37))
    direction = np.array([[3.0, 1.0, -1.7]]) / np.sqrt(9 + 1 + 1.7**2)
    plain = one_by_one(sigma_t, IDENTITY, direction, near_slices)[0]
    for axes in ((0, 2, 1), (1, 0, 2), (1, 2, 0), (2, 0, 1), (2, 1, 0)):
        moved = np.ascontiguousarray(sigma_t.transpose(axes))
        found = one_by_one(moved, IDENTITY, direction[:, axes], near_slices)[0]
        np.testing.assert_allclose(found, plain.transpose(axes), rtol=2e-6)
    for axis in range(3):
        flipped = np.ascontiguousarray(np.flip(sigma_t, axis))
        mirror = np.ones(3)
        mirror[axis] = -1
        found = one_by_one(flipped, IDENTITY, direction * mirror, near_slices)[0]
        np.testing.assert_allclose(found, np.flip(plain, axis), rtol=2e-6)
        world = np.diag([*mirror, 1.0])  # a mirrored affine instead of a mirrored direction
        found = one_by_one(flipped, world, direction, near_slices)[0]
        np.testing.assert_allclose(found, np.flip(plain, axis), rtol=2e-6)


def test_units_of_length_cancel() -> None:
    sigma_t, direction = random_grid((16, 17, 18)), random_directions(1)
    plain = one_by_one(sigma_t, IDENTITY, direction, 4)
    scaled = one_by_one(sigma_t / np.float32(4), np.diag([4.0, 4, 4, 1]), direction, 4)
    np.testing.assert_allclose(scaled, plain, rtol=2e-6)


def lattice_shape(shape: tuple[int, ...], spacing: int) -> tuple[int, ...]:
    return tuple(-(-(n - 1) // spacing) + 1 for n in shape)


@pytest.mark.parametrize("spacing", [1, 7, 16, 100])
def test_constant_lattice_weights_equal_constant_weights(spacing: int) -> None:
    sigma_t, world = random_grid((33, 29, 41)), affine(9)
    directions = random_directions(12)
    constant = np.random.default_rng(10).uniform(0, 1, (12, 1)).astype(np.float32)
    nodes = lattice_shape(sigma_t.shape, spacing)
    weights = np.ascontiguousarray(np.broadcast_to(constant[:, :, None, None], (12, *nodes)))
    found = volillum_native.sweep_weighted(sigma_t, world, directions, weights, spacing)
    truth = volillum_native.sweep(sigma_t, world, directions, constant)[0]
    np.testing.assert_allclose(found, truth, rtol=12 * 6e-8 * 4)


@pytest.mark.parametrize("spacing", [1, 5, 16])
@pytest.mark.parametrize("shape", [(30, 50, 33), (1, 1, 40), (1, 1, 1), (3, 70, 2)])
def test_varying_lattice_weights(spacing: int, shape: tuple[int, int, int]) -> None:
    """Against interpolated weights in numpy; most are zero, so that tiles are left out."""
    rng = np.random.default_rng(11)
    sigma_t, world = random_grid(shape), affine(12)
    directions = random_directions(14)
    nodes = lattice_shape(shape, spacing)
    weights = rng.random((14, *nodes), dtype=np.float32)
    weights[rng.random(weights.shape) < 0.8] = 0
    weights[3] = 0
    full = weights.astype(np.float64)
    for axis, size in enumerate(shape, start=1):
        position = np.arange(size) / spacing
        lower = np.floor(position).astype(int)
        upper = np.minimum(lower + 1, full.shape[axis] - 1)
        fraction = (position - lower).reshape([-1 if a == axis else 1 for a in range(4)])
        full = full.take(lower, axis) * (1 - fraction) + full.take(upper, axis) * fraction
    found = volillum_native.sweep_weighted(sigma_t, world, directions, weights, spacing)
    truth = (full * one_by_one(sigma_t, world, directions, 4)).sum(axis=0)
    np.testing.assert_allclose(found, truth, rtol=4e-6, atol=1e-6)


def test_lattice_weights_of_a_corner_need_little_work() -> None:
    """One voxel in a corner from which rays leave at once, against weights everywhere."""
    sigma_t = random_grid((128, 128, 128))
    direction = np.array([[1.0, 0.1, 0.1]]) / np.sqrt(1.02)
    nodes = lattice_shape(sigma_t.shape, 16)
    everywhere = np.ones((1, *nodes), np.float32)
    corner = np.zeros((1, *nodes), np.float32)
    corner[0, -1, -1, -1] = 1
    seconds = []
    found = np.empty(0, np.float32)
    for weights in (everywhere, corner):
        best = np.inf
        for _ in range(5):
            start = time.thread_time()
            found = volillum_native.sweep_weighted(
                sigma_t, IDENTITY, direction, weights, 16, threads=1
            )
            best = min(best, time.thread_time() - start)
        seconds.append(best)
    assert np.all(found[:100] == 0)
    assert found[127, 127, 127] > 0.5
    # One of 512 cells of the lattice; the rest is what any call costs.
    assert seconds[1] < 0.5 * seconds[0], seconds


def test_progress_and_cancelling() -> None:
    sigma_t = random_grid((160, 160, 160))
    directions, weights = random_directions(300), np.ones((300, 1), np.float32)
    control = volillum_native.Control()
    outcome: list[BaseException] = []

    def work() -> None:
        try:
            volillum_native.sweep(
                sigma_t, IDENTITY, directions, weights, control=control, threads=2
            )
        except volillum_native.Cancelled as cancelled:
            outcome.append(cancelled)

    thread = threading.Thread(target=work)
    thread.start()
    deadline = time.monotonic() + 60
    while control.progress == 0 and time.monotonic() < deadline:
        time.sleep(0.001)  # runs at all only if the sweep has released the interpreter
    assert 0 < control.progress < 1
    control.cancel()
    thread.join(timeout=60)
    assert not thread.is_alive()
    assert len(outcome) == 1
    fresh = volillum_native.Control()
    found = volillum_native.sweep(sigma_t[:8].copy(), IDENTITY, directions, weights, control=fresh)
    assert np.all(np.isfinite(found))
    assert fresh.progress == pytest.approx(1)


def test_output_owns_its_memory() -> None:
    found = volillum_native.sweep(
        random_grid((3, 4, 5)), IDENTITY, random_directions(2), np.ones((2, 6), np.float32)
    )
    assert found.shape == (6, 3, 4, 5)
    assert found.dtype == np.float32
    assert found.flags.owndata
    assert found.flags.c_contiguous


def test_writes_to_the_callers_array() -> None:
    """All of it, whatever it held, also where no direction counts."""
    sigma_t, directions = random_grid((20, 30, 40)), random_directions(5)
    weights = np.random.default_rng(13).random((5, 3), dtype=np.float32)
    out = np.full((3, 20, 30, 40), np.nan, np.float32)
    found = volillum_native.sweep(sigma_t, IDENTITY, directions, weights, out=out)
    assert found is out
    np.testing.assert_array_equal(
        out, volillum_native.sweep(sigma_t, IDENTITY, directions, weights)
    )
    apart = np.ones((5, *sigma_t.shape), np.float32)
    volillum_native.sweep(sigma_t, IDENTITY, directions, weights, out=apart[::2], add=True)
    assert np.allclose(apart[::2], 1 + out, rtol=1e-6)
    assert np.all(apart[1::2] == 1)
    volillum_native.sweep(sigma_t, IDENTITY, directions, 0 * weights, out=out)
    assert np.all(out == 0)
    nodes = np.zeros((5, *lattice_shape(sigma_t.shape, 8)), np.float32)
    nodes[2, 0, 0, 0] = 1
    out[:] = np.nan
    volillum_native.sweep_weighted(sigma_t, IDENTITY, directions, nodes, 8, out=out[0])
    assert out[0, 0, 0, 0] > 0
    assert np.all(out[0, 8:] == 0)
    more = np.ones(sigma_t.shape, np.float32)
    volillum_native.sweep_weighted(sigma_t, IDENTITY, directions, nodes, 8, out=more, add=True)
    assert np.allclose(more, 1 + out[0], rtol=1e-6)


GRID = random_grid((4, 5, 6))
ONE = np.ones((1, 1), np.float32)
WEST = np.array([[1.0, 0, 0]])


@pytest.mark.parametrize(
    ("changes", "error", "words"),
    [
        ({"sigma_t": GRID[0]}, ValueError, r"sigma_t has shape \(5, 6\); expected \[nx, ny, nz\]"),
        ({"sigma_t": GRID[:0]}, ValueError, r"sigma_t has shape \(0, 5, 6\)"),
        ({"sigma_t": GRID.transpose()}, ValueError, "sigma_t is not C-contiguous"),
        ({"sigma_t": GRID.astype(np.float64)}, TypeError, "sigma_t.*expected float32"),
        ({"index_to_world": np.eye(3)}, ValueError, r"index_to_world has shape \(3, 3\)"),
        ({"index_to_world": np.diag([1.0, 0, 1, 1])}, ValueError, "determinant 0.*invertible"),
        ({"index_to_world": np.full((4, 4), np.nan)}, ValueError, "determinant .*nan"),
        (
            {"directions": np.array([[1.0, 0, 1e-2]])},
            ValueError,
            r"\[0\] has length 1.00",
        ),
        (
            {"directions": np.array([[np.nan, 0, 0]])},
            ValueError,
            r"\[0\] has length .*nan",
        ),
        ({"directions": WEST[0]}, ValueError, r"directions has shape \(3,\)"),
        ({"weights": np.ones((2, 1), np.float32)}, ValueError, r"weights has shape \(2, 1\)"),
        ({"radius": 0.0}, ValueError, "radius is 0.*positive"),
        ({"radius": np.nan}, ValueError, "radius is .*nan"),
        ({"near_slices": -1}, ValueError, "near_slices is -1; expected 0 or more"),
        ({"out": GRID}, ValueError, r"out has shape \(4, 5, 6\)"),
        ({"out": GRID[None]}, ValueError, "out shares memory with sigma_t"),
        ({"add": True}, ValueError, "out is None; expected an array to add to"),
        ({"quantity": "depth"}, ValueError, "quantity is 'depth'; expected 'transmittance'"),
    ],
)
def test_wrong_arguments_are_named(
    changes: dict[str, object], error: type[Exception], words: str
) -> None:
    arguments: dict[str, object] = {
        "sigma_t": GRID,
        "index_to_world": IDENTITY,
        "directions": WEST,
        "weights": ONE,
    } | changes
    with pytest.raises(error, match=words):
        volillum_native.sweep(**arguments)


def test_wrong_lattice_weights_are_named() -> None:
    with pytest.raises(ValueError, match=r"weights has shape .*expected .*\(1, 3, 3, 4\)"):
        volillum_native.sweep_weighted(
            GRID, IDENTITY, WEST, np.ones((1, 2, 3, 4), np.float32), spacing=2
        )
    with pytest.raises(ValueError, match="spacing is 0; expected 1 or more"):
        volillum_native.sweep_weighted(GRID, IDENTITY, WEST, np.ones((1, 1, 1, 1), np.float32), 0)
