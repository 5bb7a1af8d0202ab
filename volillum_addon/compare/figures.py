"""What follows from the measurements: error against time, seconds to a given error, break-even.

The one place where these are computed; the page, report.json, paper.csv and the plots only show
them. A point is one measured way to the picture; the points of one series differ by settings alone.

Between two measured numbers of samples the error of path tracing is interpolated on logarithmic
axes; beyond the last one, and only where pictures are not denoised, more of them can be averaged. A
model has the settings that were measured and nothing between them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Literal

from ..models.model import Value
from ..models.registry import get
from .metrics import DETECTION, Figure
from .renderer import counted
from .results import BaselineMeasured, Comparison, Measured

# The errors whose seconds are the headline, relative.
TARGETS = (0.10, 0.05, 0.02, 0.01)
# The lengths of the camera moves, frames.
FRAMES = (1, 24, 240)
# Averaging more pictures than this is no forecast any more, and nobody averages pictures of fewer
# samples than this: more samples in one picture are faster.
FARTHEST = 1000
FEWEST_AVERAGED = 16

How = Literal["measured", "interpolated", "averaged", "model error", "not reached"]


@dataclass(frozen=True, eq=False)
class Point:
    """One way to the picture: `once` seconds for a bake that stays, `each` for every frame."""

    label: str
    settings: str
    once: float
    each: float
    total: Figure
    found: Measured | BaselineMeasured

    @property
    def seconds(self) -> float:
        """From a scene in memory to the first picture."""
        return self.once + self.each

    def frames(self, count: int) -> float:
        """Seconds of a camera move of so many frames."""
        return self.once + count * self.each


@dataclass(frozen=True, eq=False)
class Series:
    """The points of a model (first the compared settings, then its ladder), or of a way of path
    tracing by its number of samples. `index` is the model's place in the comparison; `noise_only`:
    whatever is wrong beyond the bias is noise, which averages away."""

    id: str
    label: str
    points: tuple[Point, ...]
    index: int | None = None
    noise_only: bool = False

    @property
    def by_time(self) -> tuple[Point, ...]:
        """The points from fast to slow."""
        return tuple(sorted(self.points, key=lambda point: point.seconds))


@dataclass(frozen=True)
class Reach:
    """Seconds until `target` is reached, and how that is known; None where it is not reached:
    because of the model itself, or with no measured setting. `best` is the least error measured."""

    target: float
    seconds: float | None
    how: How
    best: Figure


@dataclass(frozen=True)
class BreakEven:
    """A camera move with a model: seconds by FRAMES, those of the fastest way of path tracing to
    the same error (`traced`, one frame), and the frames from which the model is the faster one
    (None: never, or nothing to compare with)."""

    once: float
    each: float
    seconds: tuple[float, ...]
    traced: Reach | None
    traced_by: str | None
    frames: int | None


@dataclass(frozen=True, eq=False)
class Summary:
    """All that follows from a comparison; `reaches` has TARGETS of each series, `break_even` the
    models' camera moves, both in the order of `series`."""

    series: tuple[Series, ...]
    frontier: frozenset[Point]
    reaches: tuple[tuple[Reach, ...], ...]
    break_even: tuple[BreakEven, ...]

    @property
    def models(self) -> tuple[Series, ...]:
        """The series of models, which come first."""
        return tuple(one for one in self.series if one.index is not None)

    @property
    def ways(self) -> tuple[Series, ...]:
        """The series of path tracing."""
        return self.series[len(self.models) :]


@lru_cache(maxsize=1)
def summary(comparison: Comparison) -> Summary:
    """Computed once for everything that shows it."""
    every = (*_models(comparison), *_ways(comparison))
    return Summary(
        every,
        pareto(every),
        tuple(tuple(reach(one, target) for target in TARGETS) for one in every),
        tuple(break_even(one, every) for one in every if one.index is not None),
    )


def _models(comparison: Comparison) -> Iterator[Series]:
    for index, (model, found) in enumerate(comparison.measured):
        per_frame = "camera" in get(model.id).rebake_on
        points = [_model_point(model.label, words(model.parameters), found, per_frame)]
        points += [
            _model_point(model.label, words(rung.settings), rung.measured, per_frame)
            for rung in model.ladder
            if rung.measured is not None
        ]
        yield Series(f"{model.id}.{model.variant}", model.label, tuple(points), index)


def _model_point(label: str, settings: str, found: Measured, per_frame: bool) -> Point:
    bake = found.seconds.bake.median + found.seconds.hand_over.median
    display = found.seconds.display.median
    once, each = (0.0, bake + display) if per_frame else (bake, display)
    return Point(label, settings, once, each, found.errors["total"], found)


def _ways(comparison: Comparison) -> Iterator[Series]:
    for way in dict.fromkeys(entry.way for entry in comparison.baselines):
        points = [
            Point(way.label, counted(entry.samples), 0.0, entry.measured.seconds.median,
                  entry.measured.total, entry.measured)
            for entry in comparison.baselines
            if entry.way == way and entry.measured is not None
        ]  # fmt: skip
        if points:
            most = max(
                entry.samples
                for entry in comparison.baselines
                if entry.way == way and entry.measured is not None
            )
            averages = not way.denoised and most >= FEWEST_AVERAGED
            yield Series(way.id, way.label, tuple(points), noise_only=averages)


def words(parameters: Mapping[str, Value]) -> str:
    """Settings in a line."""
    return ", ".join(
        f"{name} {value:.4g}" if isinstance(value, float) else f"{name} {value}"
        for name, value in parameters.items()
    )


def pareto(all_series: Sequence[Series]) -> frozenset[Point]:
    """The points that no other one beats in both seconds and total error."""
    points = sorted(
        (point for each in all_series for point in each.points),
        key=lambda point: (point.seconds, point.total.relative_rmse),
    )
    best, frontier = math.inf, []
    for point in points:
        if point.total.relative_rmse < best:
            best = point.total.relative_rmse
            frontier.append(point)
    return frozenset(frontier)


def reach(one: Series, target: float) -> Reach:
    """When the series has at most this total error; a bound counts as the error that it is."""
    points = one.by_time
    best = min((point.total for point in points), key=lambda total: total.relative_rmse)
    reached = [point for point in points if point.total.relative_rmse <= target]
    if one.index is not None:
        if reached:
            return Reach(target, reached[0].seconds, "measured", best)
        found = one.points[0].found
        assert isinstance(found, Measured)
        own = found.errors["model"]
        lost = not own.is_bound and own.relative_rmse - DETECTION * own.noise > target
        return Reach(target, None, "model error" if lost else "not reached", best)
    if reached and reached[0] is points[0]:
        return Reach(target, points[0].seconds, "measured", best)
    for before, after in pairwise(points):
        high, low = before.total.relative_rmse, after.total.relative_rmse
        if low <= target < high:
            share = math.log(high / target) / math.log(high / low)
            seconds = before.seconds * (after.seconds / before.seconds) ** share
            return Reach(target, seconds, "interpolated", best)
    pictures = _averaged(points[-1].total, target) if one.noise_only else math.inf
    if pictures < FARTHEST:
        return Reach(target, points[-1].seconds * pictures, "averaged", best)
    return Reach(target, None, "not reached", best)


def _averaged(total: Figure, target: float) -> float:
    """How many independent pictures of this error have `target` on average: the bias stays, where
    one is seen, and the rest is noise."""
    kept = total.bias if abs(total.bias) > DETECTION * total.bias_noise else 0.0
    noise = total.relative_rmse**2 - kept**2
    return noise / (target**2 - kept**2) if noise > 0 and target > abs(kept) else math.inf


def break_even(one: Series, all_series: Sequence[Series]) -> BreakEven:
    """A camera move with the model's compared settings, and with path tracing of the same error.

    The error is that of this view for all frames.
    """
    point = one.points[0]
    ways = [(reach(way, point.total.relative_rmse), way) for way in all_series if way.index is None]
    done = [(found.seconds, found, way) for found, way in ways if found.seconds is not None]
    traced = min(done, key=lambda entry: entry[0], default=None)
    return BreakEven(
        point.once,
        point.each,
        tuple(point.frames(count) for count in FRAMES),
        traced[1] if traced else None,
        traced[2].label if traced else None,
        _first_frame(point, traced[0]) if traced else None,
    )


def _first_frame(point: Point, traced: float) -> int | None:
    """The fewest frames of once + n each <= n traced."""
    if point.each + point.once <= traced:
        return 1
    if point.each >= traced:
        return None
    return math.ceil(point.once / (traced - point.each) - 1e-9)
