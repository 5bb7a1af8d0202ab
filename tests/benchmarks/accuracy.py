"""Numerical error of every model on the real volumes, and what its settings trade.

    python tests/benchmarks/accuracy.py [--voxels 4000] [--models ID,ID] [--volumes NAME,NAME]
                                        [--settings NAME=VALUE,...] [--unclamped]
                                        [--parts defaults,ladder,coefficients]
                                        [-o docs/accuracy.md]

Baked in-scattered radiance at the models' default settings against `exact`, at camera-visible
voxels (tests/volumes.py has the scenes and transfer functions); relative RMS over all colours, with
the standard error of the choice of voxels and of the judge. A second table walks up each model's
ladder of settings on the smaller volumes, and is drawn beside the page
(images/accuracy_trade_off.svg); a third has the coefficients of models that store some, one by one.
Needs VOLILLUM_DATA.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Iterator, Mapping
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import matplotlib
import volumes
from matplotlib.figure import Figure as Drawing
from matplotlib.ticker import NullFormatter

from volillum_addon.compare.errors import FieldTruth, coefficient_errors, field_error, field_truth
from volillum_addon.compare.measure import affordable
from volillum_addon.compare.metrics import Figure
from volillum_addon.core.errors import InputError
from volillum_addon.models.illuminate import illuminate
from volillum_addon.models.model import Model, Value
from volillum_addon.models.registry import MODELS

HEAD = """# Numerical error

Baked in-scattered radiance against the exact solution of the model's own equation, relative RMS
over {voxels} camera-visible voxels, in percent, +- its standard error; "<" where nothing was seen
above the noise. `make accuracy` writes this page. The scenes are in `tests/volumes.py`: a sun of
10 degrees and a faint sky, transfer functions of `presets/transfer_functions`. Seconds are those of
one bake in a warm process on {machine}.
"""
TRADE_OFF = """
## What the settings trade

Each model's ladder of settings, from fast to accurate; filled: its defaults. They are where the
curves bend: more directions or a longer near field cost more than they bring there.

![Error against time of every model's settings](images/accuracy_trade_off.svg)
"""
COEFFICIENTS = """
## Coefficients

What is stored against the exact V_lm = integral of T Y_lm, at the same voxels, in percent: all
coefficients together relative to all of them, then each one (l, m) relative to itself. That only
the bands 0 to 3 are there is no part of these figures: truncation is the model's error.
"""
DRAWING = "images/accuracy_trade_off.svg"

# What the page is made of, and the volumes that a ladder of settings is affordable on: a cloud, a
# simulation, a CT.
PARTS = ("defaults", "ladder", "coefficients")
SMALL = ("rico_cloud", "neghip_sim", "headsq_ct")

# One point of a curve: seconds, the error's figure, and whether it is the default settings'.
Point = tuple[float, Figure, bool]


class Judge:
    """Errors of bakes, with one exact solution for all settings of an equation."""

    def __init__(self, voxels: int, samples: int, clamped: bool) -> None:
        self._voxels, self._samples, self._clamped = voxels, samples, clamped
        self._truths: dict[str, FieldTruth] = {}

    def measured(
        self, name: str, model: Model, given: Mapping[str, Value]
    ) -> tuple[Figure, float] | str:
        """The error and the seconds of the bake, or why the model cannot serve the scene."""
        scene = volumes.scene(name)
        try:
            begin = time.perf_counter()
            volume = illuminate(scene, model.id, given)
            seconds = time.perf_counter() - begin
        except InputError as error:
            return str(error)
        equations = model.equations(scene, model.values(given))
        key = f"{name} {[each.operator for each in equations]} {sorted(model.lights)}"
        if key not in self._truths:
            self._truths[key] = field_truth(
                scene, volume, self._voxels, affordable(equations, self._samples),
                clamped=self._clamped,
            )  # fmt: skip
        error = field_error(scene, volume, clamped=self._clamped, truth=self._truths[key])
        return error, seconds


def percent(figure: Figure) -> str:
    """An error in percent with its noise, or its bound."""
    if figure.is_bound:
        return f"< {100 * figure.relative_rmse:.2g}"
    return f"{100 * figure.relative_rmse:.2g} +- {100 * figure.noise:.1g}"


def shown(result: tuple[Figure, float] | str) -> str:
    """A cell of the table."""
    if isinstance(result, str):
        return f"refused: {result}"
    return f"{percent(result[0])} ({result[1]:.2f} s)"


def row(*cells: str) -> str:
    return "| " + " | ".join(cells) + " |"


def head(first: str, names: list[str]) -> list[str]:
    """A table's first two lines."""
    return [row(first, *names), row(*["---"] * (len(names) + 1))]


def in_words(given: Mapping[str, Value]) -> str:
    """Settings as they stand in a table."""
    return ", ".join(
        f"{name} {value:g}" if isinstance(value, float | int) else f"{name} {value}"
        for name, value in given.items()
    )


def coefficient_rows(
    model: Model, given: Mapping[str, Value], names: list[str], voxels: int, samples: int
) -> Iterator[str]:
    """The errors of the stored coefficients: together, and one a row."""
    columns = []
    for name in names:
        scene = volumes.scene(name)
        volume = illuminate(scene, model.id, given)
        together, each = coefficient_errors(scene, volume, voxels, samples)
        columns.append([together, *each])
    orders = [f"({degree}, {m})" for degree in range(4) for m in range(-degree, degree + 1)]
    for label, *figures in zip(["all", *orders], *columns, strict=False):
        yield row(label, *(percent(figure) for figure in figures))


def draw(curves: Mapping[str, Mapping[str, list[Point]]], path: Path) -> None:
    """Error against seconds, one field a model and one curve a volume; defaults are filled."""
    matplotlib.rcParams.update({"svg.fonttype": "none", "svg.hashsalt": "volillum"})
    shown = {label: curve for label, curve in curves.items() if any(map(len, curve.values()))}
    height = (len(shown) + 2) // 3
    drawing = Drawing(figsize=(11, 3.2 * height), layout="constrained")
    fields = drawing.subplots(height, 3, squeeze=False).ravel()
    for field, (label, curve) in zip(fields, shown.items(), strict=False):
        field.set_title(label, fontsize=10)
        for index, (name, points) in enumerate(curve.items()):
            along = sorted(points, key=lambda point: point[0])
            colour = f"C{index}"
            seconds = [point[0] for point in along]
            errors = [100 * point[1].relative_rmse for point in along]
            field.plot(seconds, errors, "-", color=colour, label=name, linewidth=1)
            for x, y, point in zip(seconds, errors, along, strict=True):
                face = colour if point[2] else "white"
                field.plot(x, y, "o", color=colour, markerfacecolor=face, markersize=5)
        field.set(xscale="log", yscale="log", xlabel="seconds", ylabel="relative RMS error, %")
        field.xaxis.set_minor_formatter(NullFormatter())
        field.grid(visible=True, which="major", linewidth=0.3)
    for field in fields[len(shown) :]:
        field.set_axis_off()
    fields[0].legend(fontsize=8)
    path.parent.mkdir(exist_ok=True)
    drawing.savefig(path, metadata={"Date": None})


def main() -> None:
    parser = argparse.ArgumentParser(description="Numerical error of every model.")
    parser.add_argument("--voxels", type=int, default=4000)
    parser.add_argument(
        "--samples",
        type=int,
        default=2048,
        help="rays of the judge, per voxel (harder equations: what takes as long)",
    )
    parser.add_argument("--models", default=",".join(MODELS))
    parser.add_argument("--volumes", default=",".join(volumes.MEDIA))
    parser.add_argument("--ladder-volumes", default=",".join(SMALL))
    parser.add_argument("--parts", default=",".join(PARTS), help="which tables")
    parser.add_argument("--settings", default="", help="in place of the first table's defaults")
    parser.add_argument("--unclamped", action="store_true", help="compare negative radiance too")
    parser.add_argument("-o", "--output", type=Path, help="write the page there")
    options = parser.parse_args()
    models = [MODELS[each] for each in options.models.split(",")]
    names = options.volumes.split(",")
    judge = Judge(options.voxels, options.samples, not options.unclamped)
    settings = dict(each.split("=") for each in options.settings.split(",") if each)
    lines = [HEAD.format(voxels=options.voxels, machine=f"{os.cpu_count()} cores")]
    lines += head("model", names)
    curves: dict[str, dict[str, list[Point]]] = {
        model.label: {name: [] for name in names} for model in models
    }

    parts = options.parts.split(",")
    small = options.ladder_volumes.split(",")

    def add(label: str, model: Model, given: Mapping[str, Value], where: list[str]) -> None:
        cells = []
        for name in where:
            result = judge.measured(name, model, given)
            cells.append(shown(result))
            if not isinstance(result, str):
                curves[model.label][name].append((result[1], result[0], where is names))
        lines.append(row(label, *cells))
        print(lines[-1], flush=True)

    if "defaults" in parts:
        for model in models:
            add(model.label, model, settings, names)
    if "ladder" in parts:
        lines += [TRADE_OFF, *head("settings", small)]
        for model in models:
            for given in model.ladder:
                add(f"{model.label}: {in_words(given)}", model, given, small)
    for model in models if "coefficients" in parts else ():
        if model.operator(model.values({})).basis is None:
            continue
        lines.append(COEFFICIENTS)
        # The defaults, and the most accurate of the ladder.
        for given in ({}, model.ladder[-1]):
            words = in_words(given) or "default settings"
            lines += ["", f"{model.label}, {words}:", "", *head("(l, m)", names)]
            for each in coefficient_rows(model, given, names, options.voxels, options.samples):
                lines.append(each)
                print(each, flush=True)
    if options.output:
        options.output.write_text("\n".join(lines).rstrip() + "\n")
        if "ladder" in parts:
            draw(curves, options.output.parent / DRAWING)


if __name__ == "__main__":
    main()
