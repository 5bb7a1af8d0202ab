"""What a bake saves by what a scene lacks: each model's time as a ratio to that of the full scene.

    python tests/benchmarks/bench_savings.py [--size 96] [--models ID,ID] [--json]

The full scene has chromatic extinction, emission and matter everywhere, under a coloured sun and a
sky. Each row takes one thing away:

    grey         one extinction for all colours (the light keeps its colour)
    no emission  nothing glows
    one eighth   matter in one octant alone; scattered: as much, in two cubes at the
                 ends of a diagonal, so that no box around it is smaller than the grid
    a quarter seen
                 the camera sees a quarter, and the bake is for its view alone
    even sky     no sun and a sky of one radiance, whose energy is in the lowest harmonic band
                 (bands = lit; the setting's default stores all, which serve other lights later)
    graded sky   the same with a gradient: two bands

Ratios of medians in one run; 1 is no saving. What a model's equation does not have is left out.
"""

from __future__ import annotations

import argparse
import json
import math
import time
from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from volillum_addon.core.camera import Camera
from volillum_addon.core.grid import Grid
from volillum_addon.core.lights import DistantLight, EnvironmentLight
from volillum_addon.core.medium import Medium
from volillum_addon.core.scene import Scene
from volillum_addon.models.illuminate import illuminate
from volillum_addon.models.model import Model, Value
from volillum_addon.models.registry import MODELS

COLOURS = np.array([1.0, 0.7, 0.5], np.float32)
REPEATS = 3


def full(size: int) -> Scene:
    """Everything that a scene can have, in every voxel."""
    x = np.linspace(0.2, 0.8, size, dtype=np.float32)
    wave = np.sin(np.float32(math.pi) * x)
    values = 4 * wave[:, None, None] * wave[:, None] * wave
    grid = Grid(values[..., None] * COLOURS, np.diag([1 / size, 1 / size, 1 / size, 1.0]), "full")
    # A hue of its own: no constant times the extinction.
    sigma_s = grid.with_values(grid.values * (0.5 + 0.4 * x)[:, None, None, None])
    medium = Medium(grid, sigma_s, grid.with_values(grid.values * np.float32(0.1)))
    lights = (DistantLight((0.5, -0.4, 0.77), (3.0, 2.5, 2.0), 0.1), EnvironmentLight(0.2))
    camera = Camera((0.5, -3.0, 0.6), (0.5, 0.5, 0.5), orthographic=True)
    return Scene(medium, lights, camera)


def masked(scene: Scene, mask: np.ndarray) -> Scene:
    """The scene with matter where the mask is."""
    medium = scene.medium
    assert medium.emission is not None
    grids = (medium.sigma_t, medium.sigma_s, medium.emission)
    kept = [grid.with_values(grid.values * mask[..., None]) for grid in grids]
    return replace(scene, medium=Medium(kept[0], kept[1], kept[2], medium.g))


def grey(scene: Scene) -> Scene:
    """One extinction, and scattering in proportion."""
    medium = scene.medium
    one = medium.sigma_t.with_values(np.ascontiguousarray(medium.sigma_t.values[..., 1]))
    scattering = medium.sigma_t.with_values(one.values * np.float32(0.9))
    return replace(scene, medium=Medium(one, scattering, medium.emission, medium.g))


def lacking(model: Model, size: int) -> Iterator[tuple[str, Scene, Mapping[str, Value]]]:
    """Names, scenes and settings of the rows that the model's equation can tell apart."""
    scene = full(size)
    yield "full", scene, {}
    yield "grey", grey(scene), {}
    operator = model.operator(model.values({}))
    if operator.gathers_emission:
        yield "no emission", replace(scene, medium=replace(scene.medium, emission=None)), {}
    octant = np.zeros((size,) * 3, np.float32)
    octant[: size // 2, : size // 2, : size // 2] = 1
    yield "one eighth", masked(scene, octant), {}
    ends = np.zeros_like(octant)
    part = round(size * (1 / 16) ** (1 / 3))  # two cubes of a sixteenth each
    ends[:part, :part, :part] = ends[-part:, -part:, -part:] = 1
    yield "one eighth, scattered", masked(scene, ends), {}
    part = Camera((0.25, -3.0, 0.3), (0.25, 0.5, 0.3), orthographic=True, height=0.5, aspect=1.0)
    yield "a quarter seen", replace(scene, camera=part, seen_only=True), {}
    if operator.basis is not None:
        up = np.sin((np.arange(128) + 0.5) / 128 * math.pi - math.pi / 2, dtype=np.float32)
        graded = np.broadcast_to((1 + 0.5 * up)[:, None, None], (128, 256, 3))
        for name, radiance in (("even sky", 0.2), ("graded sky", graded)):
            yield name, replace(scene, lights=(EnvironmentLight(radiance),)), {"bands": "lit"}


def seconds(scene: Scene, model: Model, given: Mapping[str, Value]) -> float:
    """Median seconds of a bake after one to warm up."""
    taken = []
    for _ in range(REPEATS + 1):
        begin = time.perf_counter()
        illuminate(scene, model.id, given)
        taken.append(time.perf_counter() - begin)
        if taken[0] > 20:
            break
    return float(np.median(taken[1:] or taken))


def main() -> None:
    parser = argparse.ArgumentParser(description="Time saved by what a scene lacks.")
    parser.add_argument("--size", type=int, default=96, help="voxels along each axis")
    parser.add_argument("--models", default=",".join(MODELS))
    parser.add_argument("--json", action="store_true", help="one JSON object a line")
    options = parser.parse_args()
    for name in options.models.split(","):
        whole = 0.0
        for case, scene, given in lacking(MODELS[name], options.size):
            taken = seconds(scene, MODELS[name], given)
            whole = whole or taken
            if options.json:
                line = {"model": name, "case": case, "size": options.size, "seconds": taken,
                        "ratio": taken / whole}  # fmt: skip
                print(json.dumps(line), flush=True)
            else:
                print(f"{name:28} {case:22} {taken:8.3f} s {taken / whole:6.2f}", flush=True)


if __name__ == "__main__":
    main()
