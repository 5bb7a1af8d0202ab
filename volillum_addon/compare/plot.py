"""Error against time as inline SVG: both axes logarithmic, noise bars, no library, any theme.

Colours and fonts come from the page's style sheet, so that the plot follows light and dark.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from html import escape
from itertools import pairwise

from .metrics import Figure
from .results import Comparison
from .table import percent, seconds

WIDTH, HEIGHT = 760, 400
LEFT, RIGHT, TOP, BOTTOM = 64, 24, 16, 48
# Room around the data, as a factor on the logarithmic axes.
ROOM = 1.6
LINE = 17


@dataclass(frozen=True)
class Axis:
    """A logarithmic axis from `low` to `high`, drawn from pixel `begin` to `end`."""

    low: float
    high: float
    begin: float
    end: float

    def place(self, value: float) -> float:
        """The pixel of a value, kept inside the axis."""
        inside = min(max(value, self.low), self.high)
        share = math.log(inside / self.low) / math.log(self.high / self.low)
        return self.begin + share * (self.end - self.begin)

    def ticks(self) -> Iterator[float]:
        """1, 2, 5 times powers of ten; powers alone on long axes."""
        steps = (1, 2, 5) if self.high / self.low < 1000 else (1,)
        for power in range(math.floor(math.log10(self.low)), math.ceil(math.log10(self.high)) + 1):
            for step in steps:
                value = step * 10.0**power
                if self.low <= value <= self.high:
                    yield value


def plot(comparison: Comparison) -> str:
    """The plot's <svg> element: every model, and what path tracing reaches in that time."""
    full = comparison.full
    per_seed = full.seconds / full.seeds
    seed_noise = full.noise * math.sqrt(full.seeds)
    models = comparison.measured
    times = [found.seconds.total for _, found in models] + [per_seed, full.seconds]
    lows = [found.errors["total"].relative_rmse for _, found in models] + [full.noise]
    highs = [lows[i] + found.errors["total"].noise for i, (_, found) in enumerate(models)]
    x = Axis(min(times) / ROOM, max(times) * ROOM, LEFT, WIDTH - RIGHT)
    y = Axis(
        min(lows) / ROOM, max([*highs, seed_noise]) * ROOM, HEIGHT - BOTTOM, TOP
    )  # fmt: skip
    parts = [*_grid(x, y), *_tracing(x, y, per_seed, seed_noise, full.seconds, full.noise)]
    heights = _apart([y.place(found.errors["total"].relative_rmse) - 8 for _, found in models])
    for index, (model, found) in enumerate(models):
        taken, error = found.seconds.total, found.errors["total"]
        parts += _point(x, y, index, model.label, taken, error, heights[index])
    summary = "; ".join(
        f"{model.label}: {percent(found.errors['total'])} % in {seconds(found.seconds.total)}"
        for model, found in models
    )
    return (
        f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" class="plot" '
        f'aria-label="Total error against time. {escape(summary)}">' + "".join(parts) + "</svg>"
    )


def _grid(x: Axis, y: Axis) -> Iterator[str]:
    for value in x.ticks():
        at = x.place(value)
        yield f'<line class="grid" x1="{at:.1f}" x2="{at:.1f}" y1="{TOP}" y2="{HEIGHT - BOTTOM}"/>'
        yield _text(at, HEIGHT - BOTTOM + 18, f"{value:g}", "middle")
    for value in y.ticks():
        at = y.place(value)
        yield f'<line class="grid" x1="{LEFT}" x2="{WIDTH - RIGHT}" y1="{at:.1f}" y2="{at:.1f}"/>'
        yield _text(LEFT - 8, at + 4, f"{100 * value:g}", "end")
    middle = (LEFT + WIDTH - RIGHT) / 2
    yield _text(middle, HEIGHT - 8, "seconds: bake, write and display", "middle")
    high = (TOP + HEIGHT - BOTTOM) / 2
    yield (
        f'<text text-anchor="middle" transform="translate(16 {high}) rotate(-90)">'
        "relative RMS error, %</text>"
    )


def _tracing(
    x: Axis, y: Axis, first: float, first_noise: float, last: float, last_noise: float
) -> Iterator[str]:
    ends = [(x.place(first), y.place(first_noise)), (x.place(last), y.place(last_noise))]
    yield (
        f'<line class="tracing" x1="{ends[0][0]:.1f}" y1="{ends[0][1]:.1f}" '
        f'x2="{ends[1][0]:.1f}" y2="{ends[1][1]:.1f}"/>'
    )
    for at, high in ends:
        yield f'<circle class="tracing-end" cx="{at:.1f}" cy="{high:.1f}" r="3"/>'
    yield _text(ends[1][0] - 8, ends[1][1] + 16, "full scattering: its noise", "end", "quiet")


def _apart(heights: list[float]) -> list[float]:
    """Labels' heights moved downward until no two are closer than a line."""
    moved = list(heights)
    order = sorted(range(len(heights)), key=heights.__getitem__)
    for above, below in pairwise(order):
        moved[below] = max(moved[below], moved[above] + LINE)
    return moved


def _point(
    x: Axis, y: Axis, index: int, label: str, time: float, error: Figure, height: float
) -> Iterator[str]:
    at, high = x.place(time), y.place(error.relative_rmse)
    top = y.place(error.relative_rmse + error.noise)
    low = y.low if error.is_bound else error.relative_rmse - error.noise
    bottom = y.place(max(low, y.low))
    colour = f"series-{index % 7}"
    title = f"{escape(label)}: {percent(error)} % in {seconds(time)}"
    yield f'<g class="{colour}"><title>{title}</title>'
    if error.is_bound:
        yield f'<path class="bar" d="M{at:.1f} {high:.1f}V{bottom:.1f}m-4 -6l4 6l4 -6"/>'
    else:
        yield (
            f'<path class="bar" d="M{at:.1f} {top:.1f}V{bottom:.1f}'
            f'M{at - 4:.1f} {top:.1f}h8M{at - 4:.1f} {bottom:.1f}h8"/>'
        )
    yield f'<circle cx="{at:.1f}" cy="{high:.1f}" r="5"/>'
    side = "end" if at > WIDTH * 0.65 else "start"
    yield _text(at + (-10 if side == "end" else 10), height, label, side, "label") + "</g>"


def _text(x: float, y: float, words: str, anchor: str, kind: str = "") -> str:
    place = f'x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}"'
    return f'<text {place} class="{kind}">{escape(words)}</text>'
