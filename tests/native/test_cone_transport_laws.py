"""The cone transport's own laws: symmetries, threads, colours, what is written and refused."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

import numpy as np
import pytest
from cone_marches import AFFINES, AXES, ROUNDING, THETA, Volume, Z, smooth, transport, unit
from trilinear import Array, affine

import volillum_native
from volillum_addon.core.directions import about, cone_rule


@pytest.mark.parametrize("world", list(AFFINES.values()), ids=list(AFFINES))
@pytest.mark.parametrize("axis", list(AXES.values()), ids=list(AXES))
def test_every_voxel_is_written_also_over_the_transmittance(world: Array, axis: Array) -> None:
    """Voxels are written slab by slab of the lattice: none twice from its own result, none not."""
    sigma_t = smooth((23, 38, 31))[None]
    vectors, weights = cone_rule(THETA, 8)
    arguments = (sigma_t, sigma_t * np.float32(0.5), world, axis, about(vectors, axis), weights)
    seen = np.exp(-sigma_t)
    wanted = volillum_native.cone_transport(*arguments, transmittance=seen, threads=1)
    for threads in (1, 2, 3):
        out = np.full_like(seen, np.nan)
        volillum_native.cone_transport(*arguments, transmittance=seen, threads=threads, out=out)
        assert np.array_equal(out, wanted)
        out[:] = seen
        volillum_native.cone_transport(*arguments, transmittance=out, threads=threads, out=out)
        assert np.array_equal(out, wanted)


def test_more_channels_than_extinctions_are_written_over_the_transmittance() -> None:
    sigma_t = smooth((23, 38, 31))[None]
    sigma_s = np.concatenate([sigma_t * np.float32(albedo) for albedo in (0.5, 0.9, 0.1)])
    vectors, weights = cone_rule(THETA, 8)
    axis = AXES["oblique"]
    arguments = (sigma_t, sigma_s, AFFINES["sheared"], axis, about(vectors, axis), weights)
    seen = np.exp(-sigma_t)
    wanted = volillum_native.cone_transport(*arguments, transmittance=seen)
    out = np.repeat(seen, 3, axis=0)
    volillum_native.cone_transport(*arguments, transmittance=out[:1], out=out)
    assert np.array_equal(out, wanted)


def test_colours_are_solved_apart() -> None:
    sigma_t = np.stack([smooth() * scale for scale in (1.0, 2.0, 0.5)]).astype(np.float32)
    sigma_s = sigma_t * np.array([0.9, 0.5, 0.99], np.float32)[:, None, None, None]
    world, axis = AFFINES["sheared"], AXES["oblique"]
    found = transport(sigma_t, sigma_s, world, axis)
    for channel in range(3):
        alone = transport(sigma_t[channel], sigma_s[channel], world, axis)
        assert np.array_equal(found[channel], alone[0])
    grey = transport(sigma_t[:1], sigma_s, world, axis)
    assert np.array_equal(grey[1], transport(sigma_t[0], sigma_s[1], world, axis)[0])


def test_a_mirrored_or_turned_grid_has_mirrored_or_turned_light() -> None:
    # Lattices start from the voxel in the middle, which stays there only where voxels are odd in
    # number.
    sigma_t = smooth((15, 17, 16))
    sigma_s = np.float32(0.7) * sigma_t
    axis = unit(0.3, -0.2, 0.9)
    vectors, weights = cone_rule(THETA, 16)
    directions = about(vectors, axis)
    world = AFFINES["cubes"]

    def changed(
        matrix: Array, view: Callable[[Volume], Volume] = lambda a: a, spacing: float = 1.0
    ) -> Volume:
        return volillum_native.cone_transport(
            np.ascontiguousarray(view(sigma_t))[None],
            np.ascontiguousarray(view(sigma_s))[None],
            world,
            matrix @ axis,
            np.ascontiguousarray(directions @ matrix.T),
            weights,
            spacing=spacing,
        )[0]

    found = changed(np.eye(3))
    mirrored = changed(np.diag([-1.0, 1, 1]), lambda a: a[::-1])
    np.testing.assert_allclose(mirrored[::-1], found, atol=ROUNDING)
    half_turned = changed(np.diag([-1.0, -1, 1]), lambda a: a[::-1, ::-1])
    np.testing.assert_allclose(half_turned[::-1, ::-1], found, atol=ROUNDING)
    # Among axes in another order the lattice lies a little turned, and has another error, of no
    # other size.
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    turned = np.rot90(changed(turn, lambda a: np.rot90(a, 1, (0, 1))), -1, (0, 1))
    fine = changed(np.eye(3), spacing=0.25)
    assert rms(turned - found) < 1.5 * rms(found - fine)
    assert rms(turned - fine) < 1.5 * rms(found - fine)


def rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def test_local_weights_that_are_the_same_everywhere_are_weights() -> None:
    sigma_t = smooth((14, 20, 18))[None]
    sigma_s = np.float32(0.8) * sigma_t
    axis = unit(-1, 2, 3)
    vectors, weights = cone_rule(THETA, 16)
    directions = about(vectors, axis)
    arguments = (sigma_t, sigma_s, AFFINES["sheared"], axis, directions)
    nodes = np.tile(weights[:, None, None, None].astype(np.float32), (1, 3, 4, 4))
    local = volillum_native.cone_transport(
        *arguments, nodes, node_spacing=7, lamp=1e3 * axis, threads=1
    )
    assert np.abs(local - volillum_native.cone_transport(*arguments, weights)).max() < ROUNDING
    threaded = volillum_native.cone_transport(
        *arguments, nodes, node_spacing=7, lamp=1e3 * axis, threads=3
    )
    assert np.array_equal(local, threaded)


@pytest.mark.parametrize("shape", [(1, 1, 1), (1, 1, 50), (2, 33, 1), (5, 3, 2)])
@pytest.mark.parametrize("axis", list(AXES.values()), ids=list(AXES))
def test_small_grids_and_any_number_of_threads(shape: tuple[int, int, int], axis: Array) -> None:
    sigma_t = np.random.default_rng(3).random(shape, dtype=np.float32)
    sigma_s = np.float32(0.9) * sigma_t
    one = transport(sigma_t, sigma_s, affine(4), axis, threads=1)
    assert np.all(np.isfinite(one))
    assert np.array_equal(one, transport(sigma_t, sigma_s, affine(4), axis, threads=3))


def test_threads_change_no_bit() -> None:
    """Of coloured noise, where a place that is off in its last bit shows."""
    sigma_t = np.random.default_rng(5).random((3, 64, 65, 66), dtype=np.float32)
    sigma_s = np.float32(0.9) * sigma_t
    fields = [
        transport(sigma_t, sigma_s, AFFINES["sheared"], AXES["oblique"], threads=threads)
        for threads in (1, 2, 5)
    ]
    assert np.array_equal(fields[0], fields[1])
    assert np.array_equal(fields[0], fields[2])


def test_cancelling_stops_every_thread() -> None:
    sigma_t = np.full((1, 160, 160, 160), 0.01, np.float32)
    vectors, weights = cone_rule(THETA, 64)
    control = volillum_native.Control()
    caught: list[BaseException] = []

    def work() -> None:
        try:
            volillum_native.cone_transport(
                sigma_t, sigma_t, np.eye(4), Z, vectors, weights, threads=3, control=control
            )
        except volillum_native.Cancelled as error:
            caught.append(error)

    thread = threading.Thread(target=work)
    thread.start()
    while control.progress == 0 and thread.is_alive():
        time.sleep(0.001)
    control.cancel()
    thread.join(timeout=30)
    assert not thread.is_alive()
    assert caught


def test_bad_input_is_refused_in_plain_words() -> None:
    sigma = np.ones((1, 3, 3, 3), np.float32)
    good = {
        "sigma_t": sigma,
        "sigma_s": sigma,
        "index_to_world": np.eye(4),
        "axis": Z,
        "directions": Z[None],
        "weights": np.ones(1),
    }
    for change, message in [
        ({"sigma_s": sigma[:, :2].copy()}, "sigma_s has shape"),
        ({"sigma_t": np.ones((2, 3, 3, 3), np.float32)}, "sigma_t has shape"),
        ({"axis": 2 * Z}, "expected a unit vector"),
        ({"directions": -Z[None]}, "cosine"),
        ({"directions": 0.5 * Z[None]}, "direction 0 has length"),
        ({"weights": np.array([0.5])}, "weights sum to 0.5"),
        ({"weights": np.array([-1.0])}, "weight 0 is"),
        ({"spacing": 0.0}, "spacing is 0"),
        ({"weights": np.ones((1, 1, 2, 2), np.float32), "node_spacing": 2}, "nodes every 2"),
        ({"weights": np.ones((1, 3, 3, 3), np.float32), "node_spacing": 0}, "node_spacing is 0"),
        ({"lamp": np.zeros(2)}, "lamp has shape"),
        ({"index_to_world": np.zeros((4, 4))}, "invertible affine"),
        ({"out": sigma}, "out shares memory with sigma_t"),
        ({"out": sigma.copy()[:, 1:]}, "out has shape"),
    ]:
        with pytest.raises(ValueError, match=message):
            volillum_native.cone_transport(**{**good, **change})
    with pytest.raises(TypeError, match="sigma_t has another type"):
        volillum_native.cone_transport(**{**good, "sigma_t": sigma.astype(np.float64)})
