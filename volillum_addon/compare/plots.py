"""The plots of a report: error against time, the parts of the error, profiles."""

from __future__ import annotations

from collections.abc import Iterator
from html import escape
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from .figures import Point, Series, Summary, summary
from .plot import COLOURS, LINE, Axis, apart, grid, mark, noise_bar, path, polyline, svg, text
from .profile import profile
from .results import Comparison
from .table import percent, seconds

WIDTH = 960
LEFT, TOP = 64, 16
# Room around the data, as a factor on the logarithmic axes.
ROOM = 1.5
# Marks of the ways of path tracing, by whether they are biased; denoised ones are hollow.
SHAPES = {True: "square", False: "diamond"}
PARTS = (("total", "circle", "mark"), ("model", "circle", "hollow"),
         ("numerical", "square", "hollow"), ("display", "diamond", "hollow"))  # fmt: skip


def all_plots(comparison: Comparison) -> dict[str, str]:
    """The <svg> elements by the names of their files."""
    return {
        "error_time": error_time(comparison),
        "error_parts": error_parts(comparison),
        "profile": profiles(comparison),
    }


def error_time(comparison: Comparison) -> str:
    """Total error against seconds: each model with its ladder, each way of path tracing, and what
    nothing beats."""
    found = summary(comparison)
    points = [point for one in found.series for point in one.points]
    times = [point.seconds for point in points]
    lows = [point.total.relative_rmse for point in points]
    highs = [point.total.relative_rmse + point.total.noise for point in points]
    height, right = 460.0, 600.0
    x = Axis(min(times) / ROOM, max(times) * ROOM, LEFT, right)
    y = Axis(min(lows) / ROOM, max(highs) * ROOM, height - 48, TOP)
    parts = [*grid(x, y, "seconds from a scene to a picture", "total relative RMS error, %")]
    parts += _frontier(found, x, y)
    ends = [_last(one) for one in found.series]
    heights = apart([y.place(end.total.relative_rmse) for end in ends], TOP + 6, height - 52)
    for one, end, at in zip(found.series, ends, heights, strict=True):
        parts.append(f'<g class="{colour(one)}">')
        begin = (x.place(end.seconds), y.place(end.total.relative_rmse))
        parts.append(polyline("leader", [begin, (right + 8, at), (right + 20, at)]))
        parts += _series(one, x, y)
        words = f"{one.label}: {percent(end.total)} %"
        parts.append(text(right + 24, at + 4, words))
        parts.append("</g>")
    said = "; ".join(
        f"{one.label}: {percent(one.points[0].total)} % in {seconds(one.points[0].seconds)}"
        for one in found.series
    )
    return svg(WIDTH, height, f"Total error against time. {said}", parts)


def colour(one: Series) -> str:
    """The class that colours a series."""
    return "tracing" if one.index is None else f"series-{one.index % COLOURS}"


def _last(one: Series) -> Point:
    """The point that a series' label points at: what was compared, or the most samples."""
    return one.points[0] if one.index is not None else one.points[-1]


def _frontier(found: Summary, x: Axis, y: Axis) -> Iterator[str]:
    points = sorted(found.frontier, key=lambda point: point.seconds)
    places = [(x.place(p.seconds), y.place(p.total.relative_rmse)) for p in points]
    steps = [places[0]]
    for before, after in pairwise(places):
        steps += [(after[0], before[1]), after]
    if len(places) == 1:
        steps.append((x.end, places[0][1]))
    yield polyline("frontier", steps)


def _series(one: Series, x: Axis, y: Axis) -> Iterator[str]:
    line = [(x.place(p.seconds), y.place(p.total.relative_rmse)) for p in one.by_time]
    model = one.index is not None
    denoised = not model and not one.noise_only
    if len(line) > 1:
        yield polyline("ladder dashed" if denoised else "ladder", line)
    shape = "circle" if model else SHAPES["unbiased" not in one.id]
    for number, point in enumerate(one.points):
        at, high = x.place(point.seconds), y.place(point.total.relative_rmse)
        words = f"{one.label}, {point.settings}: {percent(point.total)} % in "
        yield f"<g><title>{escape(words + seconds(point.seconds))}</title>"
        yield noise_bar(y, at, point.total)
        size = 6 if model and number == 0 else 4
        yield mark(shape, at, high, "hollow" if denoised else "mark", size) + "</g>"


def error_parts(comparison: Comparison) -> str:
    """Total, model, numerical and display error of every model, one row each."""
    found = comparison.measured
    errors = [f.errors[kind] for _, f in found for kind, _, _ in PARTS]
    lows = [error.relative_rmse for error in errors if error.relative_rmse > 0]
    high = max(error.relative_rmse + error.noise for error in errors)
    left, height = 300.0, 30.0 * len(found) + 48 + 56
    bottom = height - 48
    x = Axis(min(lows) / ROOM, high * ROOM, left, WIDTH - 24)
    parts = [*_legend(left)]
    for value in x.ticks():
        at = x.place(value)
        parts.append(path("grid", f"M{at:.1f} 36V{bottom:.1f}"))
        parts.append(text(at, bottom + 18, f"{100 * value:g}", "middle"))
    parts.append(text((x.begin + x.end) / 2, bottom + 40, "relative RMS error, %", "middle"))
    for index, (model, measured) in enumerate(found):
        row = 56 + 30 * index
        parts.append(f'<g class="series-{index % COLOURS}">')
        parts.append(path("grid", f"M{x.begin:.1f} {row}H{x.end:.1f}"))
        parts.append(text(left - 12, row + 4, model.label, "end"))
        for kind, shape, style in reversed(PARTS):
            error = measured.errors[kind]
            words = f"{model.label}: {kind} error {percent(error)} %"
            parts.append(f"<g><title>{escape(words)}</title>")
            if error.relative_rmse > 0:
                parts.append(noise_bar(x, row, error, upright=False))
                parts.append(mark(shape, x.place(error.relative_rmse), row, style))
            parts.append("</g>")
        parts.append("</g>")
    return svg(WIDTH, height, "The parts of each model's error.", parts)


def _legend(left: float) -> Iterator[str]:
    at = left
    for kind, shape, style in PARTS:
        yield f'<g class="tracing">{mark(shape, at + 6, 18, style)}</g>'
        yield text(at + 18, 22, kind)
        at += 110


def profiles(comparison: Comparison) -> str:
    """Luminance along the line through the steepest place: full scattering with its noise (twice
    the standard error), and every model."""
    found = profile(comparison)
    height, right = 380.0, 660.0
    top = max(float((found.truth + 2 * found.noise).max()), *(float(m.max()) for m in found.models))
    x = Axis(0.0, max(float(found.distance[-1]), 1.0), LEFT, right, logarithmic=False)
    y = Axis(0.0, 1.05 * max(top, 1e-6), height - 48, TOP, logarithmic=False)
    parts = [*grid(x, y, "pixels along the line", "luminance / mean of full scattering", False)]

    def curve(values: NDArray[np.float64]) -> list[tuple[float, float]]:
        pairs = zip(found.distance, values, strict=True)
        return [(x.place(float(d)), y.place(float(v))) for d, v in pairs]

    band = curve(found.truth + 2 * found.noise) + curve(found.truth - 2 * found.noise)[::-1]
    parts.append(f'<g class="truth">{polyline("band", band)}')
    parts.append(polyline("curve truth", curve(found.truth)) + "</g>")
    rows = [TOP + 14 + LINE * number for number in range(1 + len(found.models))]
    parts.append(f'<g class="truth">{path("curve truth", f"M{right + 24} {rows[0] - 4}h20")}</g>')
    parts.append(text(right + 52, rows[0], "full scattering"))
    for index, ((model, _), values) in enumerate(
        zip(comparison.measured, found.models, strict=True)
    ):
        parts.append(f'<g class="series-{index % COLOURS}">{polyline("curve", curve(values))}')
        parts.append(path("curve", f"M{right + 24} {rows[index + 1] - 4}h20"))
        parts.append(text(right + 52, rows[index + 1], model.label) + "</g>")
    return svg(WIDTH, height, "Luminance along a line through the shadow boundary.", parts)
