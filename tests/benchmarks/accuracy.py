"""Numerical error of every model on the real volumes, and what its settings trade.

    python tests/benchmarks/accuracy.py [--voxels 4000] [--models ID,ID] [--volumes NAME,NAME]
                                        [--settings NAME=VALUE,...] [--unclamped]
                                        [-o docs/accuracy.md]

Baked in-scattered radiance at the models' default settings against `exact`, at camera-visible
voxels (tests/volumes.py has the scenes and transfer functions); relative RMS over all colours, with
the standard error of the choice of voxels and of the judge. A second table walks up each model's
ladder of settings. Needs VOLILLUM_DATA.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Mapping
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import volumes

from volillum_addon.compare.errors import field_error
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
one bake in a warm process.
"""


def measured(
    name: str,
    model: Model,
    given: Mapping[str, Value],
    voxels: int,
    samples: int,
    clamped: bool = True,
) -> tuple[Figure, float] | str:
    """The error and the seconds of the bake, or why the model cannot serve the scene."""
    scene = volumes.scene(name)
    try:
        begin = time.perf_counter()
        volume = illuminate(scene, model.id, given)
        seconds = time.perf_counter() - begin
        each = affordable(model.equations(scene, model.values(given)), samples)
        return field_error(scene, volume, voxels, each, clamped=clamped), seconds
    except InputError as error:
        return str(error)


def shown(result: tuple[Figure, float] | str) -> str:
    """A cell of the table."""
    if isinstance(result, str):
        return f"refused: {result}"
    figure, seconds = result
    if figure.is_bound:
        return f"< {100 * figure.relative_rmse:.2g} ({seconds:.2f} s)"
    return f"{100 * figure.relative_rmse:.2g} +- {100 * figure.noise:.1g} ({seconds:.2f} s)"


def row(*cells: str) -> str:
    return "| " + " | ".join(cells) + " |"


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
    parser.add_argument("--no-ladder", action="store_true", help="only the default settings")
    parser.add_argument("--settings", default="", help="in place of the first table's defaults")
    parser.add_argument("--unclamped", action="store_true", help="compare negative radiance too")
    parser.add_argument("-o", "--output", type=Path, help="write the page there")
    options = parser.parse_args()
    models = [MODELS[each] for each in options.models.split(",")]
    names = options.volumes.split(",")
    clamped = not options.unclamped
    settings = dict(each.split("=") for each in options.settings.split(",") if each)
    rule = row(*["---"] * (len(names) + 1))
    lines = [HEAD.format(voxels=options.voxels), row("model", *names), rule]

    def add(label: str, model: Model, given: Mapping[str, Value]) -> None:
        cells = [
            shown(measured(name, model, given, options.voxels, options.samples, clamped))
            for name in names
        ]
        lines.append(row(label, *cells))
        print(lines[-1], flush=True)

    for model in models:
        add(model.label, model, settings)
    if not options.no_ladder:
        lines += ["", "## What the settings trade", ""]
        lines += [row("settings", *names), rule]
        for model in models:
            for given in model.ladder:
                words = ", ".join(f"{name} {value:g}" if isinstance(value, float | int) else
                                  f"{name} {value}" for name, value in given.items())  # fmt: skip
                add(f"{model.label}: {words}", model, given)
    if options.output:
        options.output.write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
