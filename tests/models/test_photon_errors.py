"""Photon mapping in passes: runs that go on, and errors that tell the truth."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from photon_runs import MEDIUM, MODEL, SKY, light_of

from volillum_addon.core.errors import InputError
from volillum_addon.core.lights import DistantLight, EnvironmentLight
from volillum_addon.core.scene import Scene
from volillum_addon.models.exact import exact
from volillum_addon.models.illuminate import bake
from volillum_addon.models.progressive import photon_state, refine


def test_a_continued_run_is_the_uninterrupted_one(tmp_path: Path) -> None:
    medium = replace(MEDIUM, emission=MEDIUM.sigma_t)
    scene = Scene(medium, (DistantLight((0.3, 0.2, 0.9), 1.0, 0.1), SKY))
    settings = {"photons": 3000, "noise_seed": 7}
    whole = refine(photon_state(scene, settings), 6)
    first = photon_state(scene, settings)
    first.refine(2)
    first.save(tmp_path / "run.npz")
    second = photon_state(scene, settings)
    second.load(tmp_path / "run.npz")
    parts = refine(second, 4)
    assert [path.name for path in tmp_path.iterdir()] == ["run.npz"]
    for name, grid in whole.channels.items():
        assert np.array_equal(grid.values, parts.channels[name].values)
    assert np.array_equal(bake(scene, MODEL, passes=6, **settings).channels["light_emitted"].values,
                          whole.channels["light_emitted"].values)  # fmt: skip
    other = photon_state(scene, {"photons": 3000, "noise_seed": 8})
    with pytest.raises(InputError, match="inputs is others; expected this scene, photons, seed"):
        other.load(tmp_path / "run.npz")
    (tmp_path / "no.npz").write_bytes(b"nothing")
    with pytest.raises(InputError, match="cannot be read"):
        other.load(tmp_path / "no.npz")


@pytest.mark.parametrize("g", [0.0, 0.4])
def test_it_stops_at_the_requested_error(g: float) -> None:
    scene = Scene(replace(MEDIUM, g=g), (SKY,))
    many = bake(scene, MODEL, photons=2000, passes=500, error=0.05)
    error = many.cost.error_estimate
    assert error is not None
    # Looked at after every eighth more passes: at most a sixteenth below, and the estimate's noise.
    assert 0.9 * 0.05 < error <= 0.05
    state = photon_state(scene, {"photons": 2000})
    state.refine(8)
    assert state.relative_error() == pytest.approx(
        refine(state, 0).cost.error_estimate, rel=1e-5
    )  # fmt: skip


def test_it_stops_in_time_but_has_an_error() -> None:
    volume = bake(Scene(MEDIUM, (SKY,)), MODEL, photons=100, passes=1000, seconds=1e-3)
    assert volume.channels["standard_error"].values.max() > 0
    state = photon_state(Scene(MEDIUM, (SKY,)))
    with pytest.raises(InputError, match="passes so far is 0; expected at least 2"):
        state.channels()


def test_standard_errors_cover_the_truth() -> None:
    """Two lights of different colour: z between independent halves has variance 1."""
    scene = Scene(MEDIUM, (DistantLight((0.3, 0.2, 0.9), (3, 1, 0)), EnvironmentLight((0, 1, 2))))
    pairs = []
    for seed in range(12):
        (a, ea), (b, eb) = (
            light_of(bake(scene, MODEL, photons=1000, passes=24, noise_seed=2 * seed + k))
            for k in (0, 1)
        )
        known = ea + eb > 0  # no photon has come to some of the rim
        assert known.mean() > 0.99
        pairs.append(((a - b)[known] / np.hypot(ea, eb)[known]) ** 2)
    # Student's t with about 46 degrees of freedom: variance 46 / 44. Replicates agree within:
    spread = np.array([pair.mean() for pair in pairs])
    assert abs(spread.mean() - 46 / 44) < 5 * spread.std(ddof=1) / math.sqrt(len(spread))
    assert spread.std(ddof=1) / math.sqrt(len(spread)) < 0.05


@pytest.mark.parametrize(
    "estimate", [{}, {"estimate": "kernel", "radius": 0.7}], ids=["track_length", "kernel"]
)
def test_the_actual_error_is_the_reported_one(estimate: dict[str, object]) -> None:
    """From 16 passes on: squared distances to the judge over squared standard errors sum to 1.

    Voxels of one run are correlated, so each run counts as one number. So few photons that noise
    (10 % and more) is far above the mean over a box or ball (below 1 %) and the judge's own noise,
    which is taken off.
    """
    scene = Scene(MEDIUM, (DistantLight((0.3, 0.2, 0.9), 3.0), SKY))
    lattice = bake(scene, MODEL, photons=10).medium.sigma_t
    matter = np.argwhere(lattice.values > 0)
    index = matter[:: len(matter) // 50]
    truth = exact(scene, MODEL, lattice.to_world(index.astype(np.float64)), samples=4096)
    for passes in (16, 48):
        ratios = []
        for seed in range(12):
            value, error = light_of(
                bake(scene, MODEL, photons=150, passes=passes, near=16, noise_seed=seed, **estimate)
            )
            far = (value[tuple(index.T)] - truth.value)[:, 0] ** 2 - truth.standard_error[:, 0] ** 2
            ratios.append(far.sum() / (error[tuple(index.T)][:, 0] ** 2).sum())
        spread = np.std(ratios, ddof=1) / math.sqrt(len(ratios))
        assert spread < 0.15
        # t with 11 degrees of freedom: one in 1000. The judge's noise is common to all runs.
        assert abs(np.mean(ratios) - 1) < 4.4 * spread + 0.05
