"""What follows from measurements: a budget's ladder, the frontier, seconds to an error, frames."""

import math

import numpy as np
import pytest
from comparisons import synthetic_comparison

from volillum_addon.compare import figures
from volillum_addon.compare.figures import FRAMES, Point, Series, break_even, pareto, reach
from volillum_addon.compare.ladder import climb
from volillum_addon.compare.metrics import Figure
from volillum_addon.compare.results import Comparison
from volillum_addon.models.registry import get


@pytest.fixture(scope="module")
def comparison() -> Comparison:
    return synthetic_comparison()


def error(rmse: float, bias: float = 0.0) -> Figure:
    return Figure(rmse, rmse / 100, bias, 1e-6, is_bound=False)


def tracing(*points: tuple[float, float], noise_only: bool = True, bias: float = 0.0) -> Series:
    """A way of path tracing with (seconds, error) points."""
    made = tuple(Point("way", "", 0.0, s, error(e, bias), None) for s, e in points)  # type: ignore[arg-type]
    return Series("way", "way", made, noise_only=noise_only)


def test_a_ladder_ends_where_the_budget_does() -> None:
    taken: list[int] = []

    def take(rung: int) -> float:
        taken.append(rung)
        return 2.0 + rung  # a start-up that all share

    found = climb([1, 4, 16, 64, 256], take, float, 1, 70.0)
    assert taken == [1, 4, 16, 64]
    assert found[:4] == [3.0, 6.0, 18.0, 66.0]
    # 66 + 4 (66 - 18) = 258: right, as 256 + 2 is what it would take.
    assert found[4] == "would take about 4 min 18 s; the budget is 70.0 s"
    assert climb([1, 4], take, float, 100, 70.0)[0] == 3.0  # the first is always tried
    left_out = climb([1, 4, 16], lambda rung: 100.0, float, 1, 70.0)
    assert [isinstance(each, str) for each in left_out] == [False, True, True]


def test_the_frontier_is_what_nothing_beats(comparison: Comparison) -> None:
    every = figures.summary(comparison).series
    points = [point for one in every for point in one.points]
    frontier = pareto(every)
    for point in points:
        beaten = any(
            other.seconds <= point.seconds
            and other.total.relative_rmse <= point.total.relative_rmse
            and (other.seconds, other.total.relative_rmse)
            != (point.seconds, point.total.relative_rmse)
            for other in points
        )
        assert (point in frontier) != beaten


def test_seconds_to_an_error_are_interpolated_between_numbers_of_samples() -> None:
    # err = 0.4 / sqrt(seconds): exact on logarithmic axes.
    way = tracing((1, 0.4), (4, 0.2), (16, 0.1))
    for target in (0.3, 0.2, 0.15, 0.1):
        found = reach(way, target)
        assert found.seconds == pytest.approx((0.4 / target) ** 2)
        assert found.how == "interpolated"
    assert reach(way, 0.5).how == "measured"
    assert reach(way, 0.5).seconds == 1
    # Beyond: 25 pictures of 16 s have a fifth of the error; a denoised one cannot be averaged.
    assert reach(way, 0.02).seconds == pytest.approx(25 * 16)
    assert reach(way, 0.02).how == "averaged"
    assert reach(tracing((1, 0.4), (4, 0.2), noise_only=False), 0.02).how == "not reached"
    assert reach(way, 1e-4).seconds is None


def test_averaging_leaves_the_bias() -> None:
    way = tracing((10, 0.1), bias=0.06)
    # 0.1^2 = 0.06^2 + 0.08^2; for 0.1^2 / 2 the noise must fall to 0.0014.
    found = reach(way, math.sqrt(0.005))
    assert found.seconds == pytest.approx(10 * 0.0064 / 0.0014)
    assert reach(way, 0.06).how == "not reached"


def test_a_model_beyond_its_own_error_is_not_reachable(comparison: Comparison) -> None:
    summary = figures.summary(comparison)
    for one, reaches in zip(summary.models, summary.reaches, strict=False):
        compared = comparison.measured[one.index or 0][1]
        total, model = (compared.errors[kind] for kind in ("total", "model"))
        for found in reaches:
            if total.relative_rmse <= found.target:
                # The fastest rung has the same images at half the bake.
                fastest = min(point.seconds for point in one.points)
                assert (found.how, found.seconds) == ("measured", fastest)
                assert fastest < compared.seconds.total
            else:
                beyond = model.relative_rmse - 2 * model.noise > found.target
                assert found.how == ("model error" if beyond else "not reached")
                assert found.seconds is None


def test_a_bake_that_the_camera_makes_stale_is_paid_in_every_frame(comparison: Comparison) -> None:
    summary = figures.summary(comparison)
    kinds = set()
    for one, move in zip(summary.models, summary.break_even, strict=True):
        model, found = comparison.measured[one.index or 0]
        follows = "camera" in get(model.id).rebake_on
        kinds.add(follows)
        bake = found.seconds.bake.median + found.seconds.hand_over.median
        for count, seconds in zip(FRAMES, move.seconds, strict=True):
            bakes = count if follows else 1
            expected = bakes * bake + count * found.seconds.display.median
            assert seconds == pytest.approx(expected)
    assert kinds == {True, False}


def test_the_frame_of_break_even_is_the_first_that_pays() -> None:
    def model(once: float, each: float) -> Series:
        return Series("m", "m", (Point("m", "", once, each, error(0.2), None),), 0)  # type: ignore[arg-type]

    way = tracing((1, 0.4), (4, 0.2))  # 4 s for the model's error
    for once, each, expected in [(3, 1, 1), (3.5, 1, 2), (30, 1, 10), (30.1, 1, 11), (1, 4, None)]:
        one = model(once, each)
        move = break_even(one, (one, way))
        assert move.frames == expected
        assert move.traced is not None
        assert move.traced.seconds == pytest.approx(4)
        if expected is not None:
            frames = np.arange(1, 50)
            first = int(frames[once + frames * each <= frames * 4 + 1e-9][0])
            assert first == expected
    alone = break_even(one, (one,))
    assert (alone.traced, alone.frames) == (None, None)
