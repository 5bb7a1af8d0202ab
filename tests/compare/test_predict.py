"""Predictions against what then happens; the choice among them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from comparisons import synthetic_scene

from volillum_addon.compare.coarse_run import baked_voxels
from volillum_addon.compare.expected import Continuation, Expected, continued
from volillum_addon.compare.metrics import Image, best_exposure, figure, silhouette
from volillum_addon.compare.predict import (
    Powers,
    Prediction,
    Predictions,
    candidates,
    predict,
)
from volillum_addon.compare.recommend import Request, recommended, usual
from volillum_addon.compare.stopwatch import Lap, Stopwatch
from volillum_addon.core.analysis import analysis
from volillum_addon.core.control import Cancelled, Control
from volillum_addon.core.scene import Scene
from volillum_addon.models.composition import Composition
from volillum_addon.models.illuminate import illuminate
from volillum_addon.models.image import line_integral
from volillum_addon.models.registry import MODELS, get

SIZE = 40


def fine_scene() -> Scene:
    """The soft ball with three times the voxels along each axis, and finer structure in it."""
    base = synthetic_scene()
    grid = base.medium.sigma_t
    index = np.indices(tuple(3 * n for n in grid.shape)) / 3
    middle = (np.array(grid.shape) - 1)[:, None, None, None] / 2
    radius = ((index - middle) ** 2).sum(0)
    ripple = 1 + 0.8 * np.sin(index[0] * 1.1) * np.sin(index[1] * 0.9) * np.sin(index[2])
    affine = grid.index_to_world @ np.diag([1 / 3, 1 / 3, 1 / 3, 1.0])
    sigma = (4 * np.exp(-radius / 40) * ripple).astype(np.float32)
    values = replace(grid, values=sigma, index_to_world=affine)
    scattering = values.with_values(sigma * np.float32(0.85))
    return replace(base, medium=replace(base.medium, sigma_t=values, sigma_s=scattering))


@pytest.fixture(scope="module")
def scene() -> Scene:
    return fine_scene()


@pytest.fixture(scope="module")
def found(scene: Scene) -> Predictions:
    return predict(scene, 1.0)


def test_every_model_and_rung_is_foreseen(found: Predictions) -> None:
    for model in MODELS.values():
        rungs = [each.parameters for each in found.entries if each.model == model.id]
        assert rungs == list(model.ladder or ({},)), model.id
    assert any("=" in each.model for each in found.entries)
    assert not found.reasons
    for each in found.entries:
        assert each.seconds > 0
        assert each.peak_bytes > 0
        assert 0 < each.error < 2


def test_errors_are_foreseen(scene: Scene, found: Predictions) -> None:
    """Against the same measure on the full grid, with other seeds: within a tenth, as is the noise
    of full scattering here, for every model's last rung but one, and a composition."""
    camera = scene.need_camera()
    images = []
    for seed in range(4):
        volume = illuminate(scene, "photon_mapping", {"noise_seed": 50 + seed, "passes": 16})
        image, transmittance = line_integral(volume, camera, SIZE, SIZE)
        images.append(image)
    full = Image(np.mean(images, 0), np.var(images, 0, ddof=1) / 4, 3)
    mask = silhouette(transmittance)
    pair = "sun=multidirectional_occlusion,sky=ambient_occlusion"
    for model in [*MODELS, pair]:
        entry = next(each for each in found.entries if each.model == model)
        volume = illuminate(scene, model, entry.parameters)
        image = Image.noiseless(line_integral(volume, camera, SIZE, SIZE)[0])
        exposure = best_exposure(image, full, mask).factor
        error = figure(image.scaled(exposure), full, mask).relative_rmse
        slack = 0.1 * error + 3 * entry.noise + 0.005
        assert abs(entry.error - error) < slack, (model, entry.error, error)


def test_candidates_are_compositions_of_which_one_cannot_serve_all(scene: Scene) -> None:
    known = analysis(scene)
    made = [model for model in candidates(known) if isinstance(model, Composition)]
    assert made
    for model in made:
        assert any(not known.kinds <= part.model.lights for part in model.parts)
        assert known.kinds <= model.lights
    alone = analysis(replace(scene, lights=scene.lights[:1]))
    assert candidates(alone) == tuple(MODELS.values())


def test_cancelling_ends_it(scene: Scene) -> None:
    control = Control()
    control.cancel()
    with pytest.raises(Cancelled):
        predict(scene, 1.0, control)


def expected(systematic: float, noise: float = 0.0, chance: float = 0.0) -> Expected:
    return Expected(systematic, noise, chance)


def test_errors_go_on_in_a_line_with_the_spacing() -> None:
    error, noise = continued([expected(0.10), expected(0.12, 0.001)], [0.4, 0.2], 0.1)
    assert error == pytest.approx(0.13)
    assert noise == pytest.approx(0.0015)
    # Never by more than twice, and not at all where the grid is no finer.
    assert continued([expected(0.9), expected(0.1)], [0.4, 0.2], 0.1)[0] == pytest.approx(0.05)
    assert continued([expected(0.3), expected(0.1)], [0.4, 0.2], 0.2)[0] == pytest.approx(0.1)


def test_what_solves_the_whole_equation_has_no_error_that_stays() -> None:
    runs = [expected(0.05, 0.002), expected(0.05, 0.002)]  # structure of a voxel's size on both
    found = Continuation(64_000, whole=True)([1000, 8000], runs)
    assert found.systematic == pytest.approx(0.05 * 2**-0.75)
    assert found.noise == pytest.approx(0.002 * 2**-0.75)
    assert Continuation(64_000)([1000, 8000], runs).systematic == pytest.approx(0.05)
    # Not on a grid that is no finer.
    assert Continuation(8000, whole=True)([1000, 8000], runs).systematic == pytest.approx(0.05)


def test_chance_grows_on_finer_grids_by_its_own_power() -> None:
    coarse, fine = expected(0.03, chance=0.04), expected(0.03, chance=0.04 * 2**0.75)
    go_on = Continuation(64_000)
    found = go_on([1000, 8000], [coarse, fine])
    assert found.chance == pytest.approx(0.04 * 4**0.75)
    assert found.error == pytest.approx(np.hypot(found.systematic, found.chance))
    # One grid alone: as before. And no more than voxels that share nothing.
    assert go_on([8000], [fine]).chance == pytest.approx(found.chance)
    wild = Continuation(64_000)([1000, 8000], [coarse, expected(0.03, chance=1.0)])
    assert wild.chance == pytest.approx(2.0)
    # Nothing random stays so.
    assert Continuation(64_000)([1000, 8000], [expected(0.1), expected(0.1)]).chance == 0


def test_more_work_lowers_chance_by_its_root() -> None:
    before, last = expected(0.02, 0.001, 0.10), expected(0.02, 0.001, 0.05)
    more = last.with_more_work(before, 4.0)
    assert more.chance == pytest.approx(0.025)
    assert more.systematic == pytest.approx(0.02)  # what did not fall before does not fall now
    falling = expected(0.01).with_more_work(expected(0.04), 4.0)
    assert falling.systematic == pytest.approx(0.005)


def test_times_grow_by_each_stage_s_own_power() -> None:
    class Run:
        def __init__(self, **seconds: float) -> None:
            self.laps = {name: Lap(value, value) for name, value in seconds.items()}

    powers = Powers()
    runs = [(Run(sweep=0.1, photons=2.0),), (Run(sweep=0.8, photons=2.0),)]
    seconds = powers.seconds([1000, 8000], runs, 64_000)  # type: ignore[arg-type]
    assert seconds == pytest.approx(6.4 + 2.0)
    # One grid alone: what was learned before.
    alone = powers.seconds([8000], [(Run(sweep=1.6, photons=8.0),)], 64_000)  # type: ignore[arg-type, list-item]
    assert alone == pytest.approx(12.8 + 8.0)


def test_the_stopwatch_tells_stages_apart() -> None:
    watch = Stopwatch(Control())
    with watch.stage(0, 0.5, "pass 1"):
        np.linalg.svd(np.ones((300, 300)))
    with watch.stage(0.5, 1, "pass 2"), watch.stage(0, 1, "sweeping"):
        np.linalg.svd(np.ones((300, 300)))
    laps = watch.stop()
    assert set(laps) == {"", "pass ", "sweeping"}
    assert min(laps["pass "].clock, laps["sweeping"].clock) > 0


def choice(*entries: tuple[float, float]) -> Predictions:
    made = [
        Prediction(f"m{index}", {}, seconds, 1, error, 0.0, error)
        for index, (seconds, error) in enumerate(entries)
    ]
    return Predictions(None, tuple(made), {}, 0.01, 1.0)  # type: ignore[arg-type]


def test_the_recommendation_is_the_cheapest_that_keeps_the_request() -> None:
    found = choice((1.0, 0.3), (2.0, 0.05), (4.0, 0.04), (9.0, 0.006))

    def model(request: Request) -> str | None:
        answer = recommended(found.entries, request)
        return None if answer is None else answer.model

    assert model(Request(error=0.5)) == "m0"
    assert model(Request(error=0.1)) == "m1"
    assert model(Request(error=0.02)) == "m3"
    assert model(Request(error=0.001)) is None
    assert model(Request(seconds=7.0)) == "m2"
    assert model(Request(seconds=0.5)) is None
    assert model(Request(error=0.1, seconds=7.0)) == "m1"
    assert model(Request(error=0.02, seconds=7.0)) is None
    assert [each.model for each in found.frontier] == ["m0", "m1", "m2", "m3"]
    assert len(usual(found)) == 5


def test_voxels_are_those_of_the_bake(scene: Scene) -> None:
    volume = illuminate(scene, "ambient_occlusion")
    assert baked_voxels(scene) == volume.medium.sigma_t.values.size
    assert get("ambient_occlusion").ladder == ()
