"""A pass of the photon engine: threads, carries, cancelling, what is refused or given up."""

from __future__ import annotations

import math
import threading
import time

import numpy as np
import pytest
from photon_passes import AFFINE, Run, random_medium

import volillum_native as native
from volillum_native import Photons, PhotonSource


@pytest.mark.parametrize("channels", [1, 3])
def test_threads_change_no_bit(channels: int) -> None:
    """Also where 32-bit sums overflow: one voxel takes all of 40,000 photons."""
    for sigma_t in (random_medium(channels=channels), np.full((channels, 1, 1, 1), 9, np.float32)):
        prints = []
        for threads in (1, 2, 3):
            run = Run(sigma_t, sigma_t * np.float32(0.9), PhotonSource.environment(),
                      photons=40_000, moments=9)  # fmt: skip
            run.add(0, 1, threads=threads)
            prints.append((run.moments().tobytes(), run.deviations.tobytes(), run.tallies))
        assert prints[0] == prints[1] == prints[2]
        assert run.moments()[:, 1:].any()


def test_overflowing_sums_are_carried() -> None:
    """A voxel of 10^5 photons holds far more than 32 bits, and the right mean."""
    sigma_t = np.full((1, 1, 1, 1), 0.5, np.float32)
    run = Run(sigma_t, sigma_t, PhotonSource.environment(), photons=100_000)
    run.add(0, threads=1)
    assert run.sums[0, 0] > 2**32
    # One photon's track through the box has a relative deviation below 1.
    assert run.sums[0, 0] * run.unit() == pytest.approx(1.0, abs=5 / math.sqrt(100_000))


def test_overflowing_higher_moments_are_carried() -> None:
    """One direction, one voxel: sqrt(4 pi) Y_lm times the fluence."""
    from volillum_addon.core import harmonics

    toward = np.array([0.6, 0.0, 0.8])
    sigma_t = np.zeros((1, 1, 1, 1), np.float32)
    source = PhotonSource.distant(toward, 1.0)
    run = Run(sigma_t, sigma_t, source, photons=1_000_000, moments=9)
    run.add(0, 1)
    assert run.wraps is not None
    assert run.wraps.any()
    found = run.moments()[0, :, 0]
    expected = math.sqrt(4 * math.pi) * harmonics.evaluate(toward[None])[0, : harmonics.count(2)]
    # Each of the photons is rounded to some 1e-5 of a voxel's diagonal.
    assert found / found[0] == pytest.approx(expected, abs=1e-5)


@pytest.mark.parametrize("started", [False, True], ids=["at once", "half way"])
def test_a_cancelled_pass_leaves_nothing(started: bool) -> None:
    sigma_t = random_medium()
    run = Run(sigma_t, sigma_t, PhotonSource.environment(), moments=9).add(0)
    before = run.moments()
    control = native.Control()

    def cancel() -> None:
        while started and control.progress < 0.1:
            time.sleep(1e-4)
        control.cancel()

    watcher = threading.Thread(target=cancel)
    watcher.start()
    if not started:
        watcher.join()
    with pytest.raises(native.Cancelled):
        run.engine.run(run.source, run.sums, run.deviations, run.higher, run.wraps, seed=1,
                       pass_index=1, photons=1_000_000, unscattered=True,
                       control=control)  # fmt: skip
    watcher.join()
    assert (control.progress > 0) == started
    assert np.array_equal(run.moments(), before)
    again = Run(sigma_t, sigma_t, PhotonSource.environment(), moments=9).add(0, 1)
    assert np.array_equal(run.add(1).moments(), again.moments())


@pytest.mark.parametrize("channels", [1, 3])
def test_transmittance_to_a_point(channels: int) -> None:
    """Against the judge's optical depth along the same segments."""
    sigma_t = random_medium(5, channels)
    target = (AFFINE @ np.array([7.3, 1.2, -4.0, 1.0]))[:3]
    found = native.transmittance_to(sigma_t, AFFINE, target)
    index = np.argwhere(np.ones(sigma_t.shape[1:])).astype(np.float64)
    origins = index @ AFFINE[:3, :3].T + AFFINE[:3, 3]
    away = target - origins
    distance = np.linalg.norm(away, axis=1)
    for voxel in range(0, len(origins), 7):
        depth = native.exact_optical_depth(
            sigma_t, AFFINE, origins[voxel : voxel + 1],
            away[voxel : voxel + 1] / distance[voxel], radius=float(distance[voxel]),
        )  # fmt: skip
        place = tuple(index[voxel].astype(int))
        assert np.allclose(found[(slice(None), *place)], np.exp(-depth[0]), rtol=1e-5, atol=1e-30)


def test_bad_input_is_refused_in_plain_words() -> None:
    sigma_t = random_medium()
    run = Run(sigma_t, sigma_t, PhotonSource.environment())
    with pytest.raises(ValueError, match="photons is 0; expected 1 to 100000000"):
        run.engine.run(run.source, run.sums, run.deviations, seed=0, pass_index=0, photons=0)
    with pytest.raises(ValueError, match="sums has shape"):
        run.engine.run(run.source, run.sums[1:], run.deviations, seed=0, pass_index=0, photons=1)
    with pytest.raises(ValueError, match="g is 1"):
        Photons(sigma_t, sigma_t, AFFINE, 1.0)
    with pytest.raises(ValueError, match="expected a positive number"):
        PhotonSource.image(np.zeros((2, 4, 3)), np.eye(3))
    with pytest.raises(ValueError, match="direction has length 2"):
        PhotonSource.distant(np.array([2.0, 0, 0]), 1.0)


def test_a_photon_that_scatters_without_end_is_given_up() -> None:
    """White and 1e6 deep: the work is bounded, and what is left out is in the balance."""
    sigma = np.full((1, 3, 3, 3), 1e6, np.float32)
    run = Run(sigma, sigma, PhotonSource.environment(), photons=500).add(0)
    tally = run.tallies[0]
    assert tally["endless"] > 0
    assert tally["scatterings"] <= run.photons * (native.most_scatterings + 1)
    spent = sum(tally[name][0] for name in ("missed", "absorbed", "roulette", "given_up"))
    assert tally["emitted"][0] == spent + sum(face[0] for face in tally["escaped"])
    assert 0 < tally["given_up"][0] <= tally["emitted"][0]
