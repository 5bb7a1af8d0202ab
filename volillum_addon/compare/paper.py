"""For people who write papers: paper.csv, a row for every measured way to the picture, and the
plots as SVG files in the light palette."""

from __future__ import annotations

import csv
import io
from pathlib import Path

from ..bake.store import replacing
from .figures import Point, Series, summary
from .metrics import Figure
from .plot import standalone
from .plots import all_plots
from .report import ERRORS, SECONDS
from .results import Comparison, Measured

CSV = "paper.csv"
FIGURE = ("relative_rmse", "noise", "bias", "bias_noise", "is_bound")


def write(comparison: Comparison, directory: Path) -> None:
    """Write paper.csv and plot_<name>.svg, each whole or not at all."""
    with replacing(directory / CSV) as temporary:
        temporary.write_text(table(comparison), encoding="utf-8")
    for name, element in all_plots(comparison).items():
        with replacing(directory / f"plot_{name}.svg") as temporary:
            temporary.write_text(standalone(element), encoding="utf-8")


def table(comparison: Comparison) -> str:
    """Numbers as in report.json (errors relative, times in seconds), empty where not measured."""
    found = summary(comparison)
    rows = [
        _row(one, point) | {"on_frontier": point in found.frontier}
        for one in found.series
        for point in one.points
    ]
    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def _row(one: Series, point: Point) -> dict[str, object]:
    found = point.found
    row: dict[str, object] = {
        "series": one.id,
        "label": one.label,
        "settings": point.settings,
        "seconds": point.seconds,
        "seconds_once": point.once,
        "seconds_each_frame": point.each,
    }
    if isinstance(found, Measured):
        taken, errors = found.seconds, dict(found.errors)
        row |= {f"seconds_{name}": getattr(taken, name).median for name in SECONDS}
        row |= {"peak_bytes": found.peak_bytes}
    else:
        errors = {"total": found.total}
        row |= {f"seconds_{name}": None for name in SECONDS} | {"peak_bytes": None}
    for kind in ("total", *(each for each in ERRORS if each != "total")):
        row |= _columns(kind, errors.get(kind))
    row |= _columns("total_after_exposure", found.total_after_exposure)
    row |= {"exposure": found.exposure.factor, "exposure_noise": found.exposure.noise}
    flip = found.flip
    return row | {
        "flip": flip.value if flip else None,
        "flip_noise": flip.noise if flip else None,
        "flip_is_bound": flip.is_bound if flip else None,
    }


def _columns(kind: str, figure: Figure | None) -> dict[str, object]:
    return {f"{kind}_{name}": getattr(figure, name) if figure else None for name in FIGURE}
