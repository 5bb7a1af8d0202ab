"""Time and memory of every model's bake against the size of the grid, at default settings.

    python tests/benchmarks/bench_sizes.py [--sizes 64,96,128,192,256] [--models ID,ID:G]
                                           [--seconds 60] [--json] [-o docs/cost.md]

Grids of n^3 voxels hold a smooth medium of optical depth 4, under a sun, seen by an orthographic
camera; ID:G is a model in a medium of that mean cosine. Every model and size has a process of its
own, which tells the median processor seconds, of all threads together, of a few bakes after a first
(the first's, where it takes more than 10 s) and, from VmHWM, how much more memory the first one
took than the process held before. Sizes go up to where the next would take more than `--seconds` or
the memory that is there. The exponent is the least-squares slope of log seconds over log voxels at
the largest three sizes: 1 is linear. With -o the tables are written there and the curves to
images/cost_against_size.svg beside it.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.figure import Figure as Drawing

from volillum_addon.bake import memory
from volillum_addon.core.camera import Camera
from volillum_addon.core.grid import Grid
from volillum_addon.core.lights import DistantLight
from volillum_addon.core.medium import Medium
from volillum_addon.core.scene import Scene
from volillum_addon.models.illuminate import illuminate
from volillum_addon.models.registry import MODELS
from volillum_addon.models.volume import IlluminationVolume

HEAD = """# Cost against size

`make bench` (`tests/benchmarks/bench_sizes.py`) measures every model at its default settings on
grids of n^3 voxels, {cores} threads: processor seconds, of all threads together, which other work
on the machine lengthens less than the clock's. The exponents are of one run.

![Processor seconds of a bake against the number of voxels](images/cost_against_size.svg)
"""
MEMORY = """
Most memory that one bake takes beyond what the process held before it, the baked channels
included, over the medium's own grids (two of float32). The bound is the outputs and four times
the input, of which the input itself is one.
"""
DRAWING = "images/cost_against_size.svg"
# Bakes that are timed, fewer where the first takes so long that all would pass SLOW seconds.
REPEATS, SLOW = 3, 10.0
# Peaks of small grids are those of the libraries: bounds count from here on.
MEMORY_VOXELS = 96**3
# Bytes a voxel that any bake may take, to stay inside the machine: 16 channels, and the bound.
ROOM = 16 * 4 + 4 * 8
# Beside the models, in an isotropic medium: the one with channels of its own in another.
ANISOTROPIC = "photon_mapping:0.5"


def smooth(size: int, g: float) -> Scene:
    """A medium of a few soft bumps whose optical depth across is about 4."""
    x = np.linspace(0, 1, size, dtype=np.float32)
    wave = np.sin(np.float32(math.pi) * x) ** 2
    ripple = 1 + np.float32(0.5) * np.cos(np.float32(4 * math.pi) * x)
    values = (wave * ripple)[:, None, None] * (wave * ripple[::-1])[:, None] * wave
    values *= np.float32(4 / values[size // 2, size // 2].mean())
    affine = np.diag([1 / size, 1 / size, 1 / size, 1.0])
    medium = replace(Medium.from_density(Grid(values, affine, "smooth"), 1.0, 0.9), g=g)
    light = DistantLight((0.5, -0.4, 0.77), 3.0, math.radians(10))
    camera = Camera((0.5, -3.0, 0.6), (0.5, 0.5, 0.5), orthographic=True)
    return Scene(medium, (light,), camera)


def parts(model: str) -> tuple[str, float]:
    """The id and the medium's mean cosine of ID or ID:G."""
    name, _, g = model.partition(":")
    return name, float(g or 0)


def label(model: str) -> str:
    """What tables and curves call it."""
    name, g = parts(model)
    return MODELS[name].label + (f", g = {g:g}" if g else "")


def timed(scene: Scene, model: str) -> tuple[IlluminationVolume, float]:
    """A bake and its processor seconds."""
    begin = time.process_time()
    volume = illuminate(scene, model)
    return volume, time.process_time() - begin


def child(model: str, size: int) -> None:
    """One bake in this process; prints what it took."""
    name, g = parts(model)
    scene = smooth(size, g)
    grids = (scene.medium.sigma_t, scene.medium.sigma_s)
    given = sum(grid.values.nbytes for grid in grids)
    # The peak so far is the scene's making; from here it counts anew.
    Path("/proc/self/clear_refs").write_text("5")
    before = memory.resident_bytes()
    volume, first = timed(scene, name)
    extra = memory.peak_bytes() - before
    outputs = sum(channel.values.nbytes for channel in volume.channels.values())
    del volume
    # The first bake warms up, unless it is so long that it does not matter.
    repeats = min(REPEATS, int(SLOW / first))
    seconds = sorted(timed(scene, name)[1] for _ in range(repeats)) or [first]
    middle = seconds[len(seconds) // 2]
    print(json.dumps({"model": model, "size": size, "seconds": middle, "extra": extra,
                      "outputs": outputs, "input": given}))  # fmt: skip


def measured(model: str, size: int) -> dict[str, float]:
    """What a process of its own tells."""
    command = [sys.executable, __file__, "--child", model, "--sizes", str(size)]
    found = subprocess.run(command, capture_output=True, text=True, check=True)
    return dict(json.loads(found.stdout.splitlines()[-1]))


def exponent(rows: list[dict[str, float]]) -> float:
    """Slope of log seconds over log voxels at the largest three sizes."""
    last = rows[-3:]
    if len(last) < 2:
        return math.nan
    voxels = np.log([row["size"] ** 3 for row in last])
    return float(np.polyfit(voxels, np.log([row["seconds"] for row in last]), 1)[0])


def draw(found: dict[str, list[dict[str, float]]], path: Path) -> None:
    """Seconds over voxels, one curve a model, and a line of slope 1."""
    matplotlib.rcParams.update({"svg.fonttype": "none", "svg.hashsalt": "volillum"})
    drawing = Drawing(figsize=(9, 5), layout="constrained")
    field = drawing.subplots()
    for model, rows in found.items():
        voxels = [row["size"] ** 3 for row in rows]
        seconds = [row["seconds"] for row in rows]
        text = f"{label(model)}: n^{3 * exponent(rows):.2f}"
        field.plot(voxels, seconds, "o-", label=text, markersize=4)
    sizes = sorted({row["size"] for rows in found.values() for row in rows})
    ends = np.array([sizes[0] ** 3, sizes[-1] ** 3], np.float64)
    low = min(row["seconds"] for rows in found.values() for row in rows)
    field.plot(ends, 0.5 * low * ends / ends[0], "--", color="black", label="linear: n^3")
    field.set(xscale="log", yscale="log", xlabel="voxels", ylabel="processor seconds of a bake")
    field.set_xticks([size**3 for size in sizes], [f"{size}³" for size in sizes])
    field.minorticks_off()
    field.grid(visible=True, linewidth=0.3)
    drawing.legend(loc="outside right upper", fontsize=8)
    path.parent.mkdir(exist_ok=True)
    drawing.savefig(path, metadata={"Date": None})


def tables(found: dict[str, list[dict[str, float]]], sizes: list[int]) -> list[str]:
    """Seconds and exponent, then memory beside its bound."""
    lines = ["", "| model | " + " | ".join(f"{n}^3" for n in sizes) + " | seconds ~ voxels^ |"]
    lines.append("| --- " * (len(sizes) + 2) + "|")
    for model, rows in found.items():
        seconds = {row["size"]: f"{row['seconds']:.3g} s" for row in rows}
        cells = [seconds.get(n, "") for n in sizes]
        lines.append(f"| {label(model)} | {' | '.join(cells)} | {exponent(rows):.2f} |")
    lines += [MEMORY, "| model | size | taken | of which outputs | bound | held |"]
    lines.append("| --- | --- | --- | --- | --- | --- |")
    for model, rows in found.items():
        row = rows[-1]
        if row["size"] ** 3 < MEMORY_VOXELS:
            continue
        taken, outputs = row["extra"] / row["input"], row["outputs"] / row["input"]
        bound = outputs + 3
        lines.append(
            f"| {label(model)} | {row['size']}^3 | {taken:.2f} | {outputs:.2f} | "
            f"{bound:.2f} | {'yes' if taken <= bound else 'no'} |"
        )
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(description="Time and memory against size.")
    parser.add_argument("--sizes", default="64,96,128,192,256")
    parser.add_argument("--models", default=",".join([*MODELS, ANISOTROPIC]))
    parser.add_argument("--seconds", type=float, default=60.0, help="longest bake to begin")
    parser.add_argument("--json", action="store_true", help="one JSON object a line")
    parser.add_argument("--child", help=argparse.SUPPRESS)
    parser.add_argument("-o", "--output", type=Path)
    options = parser.parse_args()
    sizes = [int(each) for each in options.sizes.split(",")]
    if options.child:
        child(options.child, sizes[0])
        return
    found: dict[str, list[dict[str, float]]] = {}
    for model in options.models.split(","):
        rows = found[model] = []
        for size in sizes:
            growth = (size / rows[-1]["size"]) ** 3 if rows else 1.0
            too_slow = rows and rows[-1]["seconds"] * growth > options.seconds
            if too_slow or size**3 * ROOM > memory.available_bytes():
                break
            rows.append(measured(model, size))
            if options.json:
                print(json.dumps(rows[-1]), flush=True)
            else:
                row = rows[-1]
                print(
                    f"{model:28} {size:4}^3 {row['seconds']:9.3f} s  memory "
                    f"{row['extra'] / row['input']:6.2f} x input (outputs "
                    f"{row['outputs'] / row['input']:.2f})",
                    flush=True,
                )
    if options.output:
        lines = [HEAD.format(cores=os.cpu_count()).rstrip(), *tables(found, sizes)]
        options.output.write_text("\n".join(lines).rstrip() + "\n")
        draw(found, options.output.parent / DRAWING)
    elif not options.json:
        print("\n".join(tables(found, sizes)))


if __name__ == "__main__":
    main()
