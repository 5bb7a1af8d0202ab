"""The tables of the page: figures, where the seconds go, seconds to an error, camera moves."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from html import escape

from .figures import FRAMES, TARGETS, BreakEven, Reach, Series, Summary
from .plots import colour
from .renderer import counted
from .results import Comparison, Measured
from .table import bias_percent, flip_text, percent, reach_text, seconds

# What stands behind everything that has no number.
LAST = 1e30


@dataclass(frozen=True)
class Cell:
    """Text, the value that the column is sorted by, and the class of its style."""

    text: str
    value: float
    kind: str = ""


def table(
    name: str, caption: str, head: Sequence[str], rows: Iterable[tuple[Series, Sequence[Cell]]]
) -> str:
    """A table whose columns sort by click and key; the first column names the series."""
    columns = "".join(
        f'<th scope="col" aria-sort="none"><button type="button">{escape(words)}</button></th>'
        for words in head
    )
    body = "\n".join(_row(one, cells) for one, cells in rows)
    return (
        f'<div class="scroll" tabindex="0" role="region" aria-label="{escape(caption)}">'
        f'<table id="{name}" class="sortable"><caption>{escape(caption)}</caption>'
        f"<thead><tr>{columns}</tr></thead><tbody>\n{body}\n</tbody></table></div>"
    )


def _row(one: Series, cells: Sequence[Cell]) -> str:
    named = (
        f'<th scope="row" data-value="{escape(one.label)}"><span class="named">'
        f'<span class="dot {colour(one)}" aria-hidden="true"></span>'
        f"<span>{escape(one.label)}</span></span></th>"
    )
    rest = (
        f'<td data-value="{cell.value!r}"'
        + (f' class="{cell.kind}"' if cell.kind else "")
        + f">{escape(cell.text)}</td>"
        for cell in cells
    )
    return "<tr>" + named + "".join(rest) + "</tr>"


def errors(comparison: Comparison, found: Summary) -> str:
    """Every model's errors."""
    head = ("Model", "Seconds", "Total error, %", "Bias, %", "After exposure, %", "FLIP",
            "Model, %", "Numerical, %", "Display, %")  # fmt: skip
    caption = (
        "Errors: relative RMS inside the silhouette ± standard error; “<”: nothing was seen above "
        "the noise. Seconds: bake, write and display. FLIP: HDR-FLIP, 0 to 1. "
        "A column’s name sorts by it."
    )
    rows = zip(found.models, (_errors(f) for _, f in comparison.measured), strict=True)
    return table("table", caption, head, rows)


def _errors(found: Measured) -> list[Cell]:
    errors, after, flip = found.errors, found.total_after_exposure, found.flip
    total = errors["total"]
    return [
        Cell(_number(found.seconds.total), found.seconds.total, "headline"),
        Cell(percent(total), total.relative_rmse, "headline"),
        Cell(bias_percent(total), total.bias),
        Cell(percent(after), after.relative_rmse),
        Cell(flip_text(flip), flip.value if flip else LAST),
        *(
            Cell(percent(errors[kind]), errors[kind].relative_rmse)
            for kind in ("model", "numerical", "display")
        ),
    ]


def costs(comparison: Comparison, found: Summary) -> str:
    """Where every model's seconds go, and what else was measured of it."""
    head = ("Model", "Bake, s", "Write, s", "Display, s", "Whole bake, s", "Memory, MiB",
            "Field error, %", "Exposure")  # fmt: skip
    counts = sorted({len(found.seconds.bake.seconds) for _, found in comparison.measured})
    # Slow bakes are repeated less (bake/cold.py).
    count = f"{counts[0]} to {counts[-1]}" if len(counts) > 1 else f"{counts[0]}"
    caption = (
        f"Bake and write: medians of {count} cold processes with an empty cache; whole: such a "
        "process from its start to its end. Memory: its peak. Field: the numerical error of the "
        "radiance at visible voxels. Exposure: the factor that fits full scattering best."
    )
    rows = zip(found.models, (_costs(f) for _, f in comparison.measured), strict=True)
    return table("costs", caption, head, rows)


def _costs(found: Measured) -> list[Cell]:
    taken, field = found.seconds, found.errors["numerical_field"]
    times = (taken.bake, taken.hand_over, taken.display, taken.whole)
    return [
        *(Cell(_number(each.median), each.median) for each in times),
        Cell(f"{found.peak_bytes / 2**20:.0f}", found.peak_bytes),
        Cell(percent(field), field.relative_rmse),
        Cell(f"× {found.exposure.factor:.3g}", found.exposure.factor),
    ]


def savings(comparison: Comparison, found: Summary) -> str:
    """What the scene lacks, and what that saved each model."""
    measured = [each for _, each in comparison.measured]
    lacks = list(dict.fromkeys(saving.what for each in measured for saving in each.savings))
    if not lacks:
        return ""
    head = ("Without", *lacks, "Bake", "With all of it")
    caption = (
        "How many times as long the bake would take, and as much would be stored, if the scene had "
        "what it lacks, each put back on a coarse grid (an empty margin: by its voxels); seconds. "
        "An equation without such a term (—) saves nothing."
    )
    rows = zip(found.models, (_savings(each, lacks) for each in measured), strict=True)
    return table("savings", caption, head, rows)


def _savings(found: Measured, lacks: Sequence[str]) -> list[Cell]:
    saved = {each.what: each for each in found.savings}
    cells = [
        Cell(f"× {saved[what].seconds:.2g}, × {saved[what].stored:.2g}", saved[what].seconds)
        if what in saved
        else Cell("—", 0.0, "missing")
        for what in lacks
    ]
    seconds = found.seconds.bake.median
    full = seconds * math.prod(each.seconds for each in found.savings)
    return [*cells, Cell(_number(seconds), seconds), Cell(f"≈ {_number(full)}", full)]


def reaches(found: Summary) -> str:
    """Seconds until the total error is small enough, of models and path tracing."""
    head = ("Until a total error of", *(f"{100 * target:g} %" for target in TARGETS), "Least")
    caption = (
        "Seconds from a scene to a picture of this total error, without changing its exposure. "
        "“≈”: between two measured numbers of samples; “≤”: by averaging as many pictures as it "
        "takes. “Model error”: not even the exact solution of the model’s equation is that close."
    )
    rows = (
        (one, [*(_reach(each) for each in reached), _least(reached[0])])
        for one, reached in zip(found.series, found.reaches, strict=True)
    )
    return table("reach", caption, head, rows)


def _reach(found: Reach) -> Cell:
    missing = found.seconds is None
    return Cell(reach_text(found), LAST if missing else found.seconds or 0.0,
                "missing" if missing else "headline")  # fmt: skip


def _least(found: Reach) -> Cell:
    return Cell(f"{percent(found.best)} %", found.best.relative_rmse)


def moves(found: Summary) -> str:
    """Camera moves with every model, beside path tracing of the same error."""
    frames = [f"{count} frame" + ("s" if count > 1 else "") for count in FRAMES]
    head = ("Model", *frames, "Cycles, a frame", f"Cycles, {FRAMES[-1]} frames", "Pays from")
    caption = (
        "Seconds of a camera move. A bake that does not depend on the camera is paid once. Cycles: "
        "its fastest way to the same total error, that of this view."
    )
    rows = zip(found.models, (_move(each) for each in found.break_even), strict=True)
    return table("moves", caption, head, rows)


def _move(found: BreakEven) -> list[Cell]:
    cells = [Cell(_number(each), each) for each in found.seconds]
    if found.traced is None or found.traced.seconds is None:
        return [*cells, *(Cell("not reached", LAST, "missing") for _ in range(3))]
    frame = found.traced.seconds
    pays = "never" if found.frames is None else f"frame {found.frames}"
    return [
        *cells,
        Cell(f"{reach_text(found.traced)} ({_way(found)})", frame),
        Cell(_number(frame * FRAMES[-1]), frame * FRAMES[-1]),
        Cell(pays, LAST if found.frames is None else found.frames),
    ]


def _way(found: BreakEven) -> str:
    return (found.traced_by or "").removeprefix("Cycles, ")


def left_out(comparison: Comparison) -> Iterator[str]:
    """The settings that were not measured, and why."""
    for model in comparison.models:
        for rung in model.ladder:
            if rung.reason:
                given = ", ".join(f"{name} {value}" for name, value in rung.settings.items())
                yield f"{model.label}, {given}: {rung.reason}"
    for baseline in comparison.baselines:
        if baseline.reason:
            yield f"{baseline.way.label}, {counted(baseline.samples)}: {baseline.reason}"


def lead(comparison: Comparison, found: Summary) -> str:
    """The result in three sentences."""
    full = comparison.full
    truth = f"Full scattering itself took {seconds(full.seconds)} to a noise of {100 * full.noise:.2g} %."  # noqa: E501
    for column in reversed(range(len(TARGETS))):
        done = [
            (reached[column].seconds, one, reached[column])
            for one, reached in zip(found.series, found.reaches, strict=True)
            if reached[column].seconds is not None
        ]
        models = [entry for entry in done if entry[1].index is not None]
        if models:
            target = f"{100 * TARGETS[column]:g} %"
            _, one, reach = min(models, key=lambda entry: entry[0] or 0.0)
            words = f"{one.label} comes within {target} of full scattering in {reach_text(reach)}"
            return f"{words}{_tracing(done)}. {truth}"
    nearest = min(found.models, key=lambda one: one.points[0].total.relative_rmse)
    point = nearest.points[0]
    return (
        f"No model comes within {100 * TARGETS[0]:g} % of full scattering here. "
        f"{nearest.label} is closest: {percent(point.total)} % away in {seconds(point.seconds)}. "
        f"{truth}"
    )


def _tracing(done: list[tuple[float | None, Series, Reach]]) -> str:
    ways = [entry for entry in done if entry[1].index is None]
    if not ways:
        return ""
    _, one, reach = min(ways, key=lambda entry: entry[0] or 0.0)
    return f", {one.label} in {reach_text(reach)}"


def _number(value: float) -> str:
    return f"{value:.3f}" if value < 1 else f"{value:.2f}" if value < 100 else f"{value:.0f}"
