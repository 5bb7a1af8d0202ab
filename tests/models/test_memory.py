"""Peak memory of bakes, measured in child processes."""

from __future__ import annotations

import subprocess
import sys

import pytest

from volillum_addon.models.model import Model
from volillum_addon.models.registry import get, models

# A child prints by how many bytes a bake's peak of resident memory rose beyond what is held before,
# the input among it, after the bytes of input and output. A small bake before has loaded all code.
# What malloc keeps of that, and of making the input, would be taken from in the bake: given back.
CHILD = """
import ctypes
from dataclasses import replace

import numpy as np
import volillum_native
from volillum_addon.core.camera import Camera
from volillum_addon.core.grid import Grid
from volillum_addon.core.lights import DistantLight, EnvironmentLight
from volillum_addon.core.medium import Medium
from volillum_addon.core.scene import Scene
from volillum_addon.models.illuminate import bake

model, size, threads, g, sun, matter, parameters = {case}

def held(field):
    with open("/proc/self/status") as status:
        return next(int(line.split()[1]) for line in status if line.startswith(field)) * 1024

def scene(size):
    values = np.random.default_rng(0).random((size,) * 3, dtype=np.float32)
    grid = Grid(values, np.diag([1 / size, 1 / size, 1 / size, 1.0]))
    colours = lambda: np.random.default_rng(1).random((size, size, size, 3), dtype=np.float32)
    wide = lambda: grid.with_values(values[..., None] * colours())
    medium = {{
        "grey": lambda: Medium.from_density(grid, 5.0, 0.9),
        "one colour": lambda: Medium.from_density(grid, 5.0, (0.9, 0.8, 0.7)),
        "coloured albedo": lambda: Medium(grid, wide()),
        "coloured extinction": lambda: Medium(wide(), wide()),
        "glow": lambda: Medium(grid, grid.with_values(0.9 * values), grid.with_values(colours())),
    }}[matter]()
    medium = replace(medium, g=g)
    light = DistantLight(sun, 1.0) if sun else EnvironmentLight((0.3, 0.3, 0.3))
    camera = Camera((5.0, 1.0, 1.0), (0.0, 0.0, 0.0))
    return Scene(medium, (light,), camera)

volillum_native.set_threads(threads)
bake(scene(8), model, **parameters)
large = scene(size)
ctypes.CDLL(None).malloc_trim(0)
before = held("VmRSS")
with open("/proc/self/clear_refs", "w") as peak:
    peak.write("5")  # the peak begins anew
volume = bake(large, model, **parameters)
medium = large.medium
inputs = [grid for grid in (medium.sigma_t, medium.sigma_s, medium.emission) if grid is not None]
for part in (inputs, volume.channels.values()):
    print(sum(grid.values.nbytes for grid in part))
print(held("VmHWM") - before)
"""
PHOTONS = {"photons": 20_000, "passes": 2}
# Along a diagonal of the grid the light's lattice is widest. Of no sun: a grey sky.
SUN, DIAGONAL, SKY = (0.3, 0.2, 0.9), (1.0, 1.0, 1.0), None
MODELS = [(model, g) for model in models() for g in ((0.0, 0.5) if model.knows_phase() else (0.0,))]
MATTERS = ("grey", "one colour", "coloured albedo", "coloured extinction", "glow")
# Small grids and many threads are the hardest: what a thread holds does not shrink with the grid.
SIZES = pytest.mark.parametrize(("size", "threads"), [(96, 2), (128, 4)], ids=["96", "128"])

Sun = tuple[float, float, float] | None

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the peak is read from /proc")


@SIZES
@pytest.mark.parametrize("matter", MATTERS)
@pytest.mark.parametrize(("model", "g"), MODELS, ids=[f"{model.id} {g}" for model, g in MODELS])
def test_peak_is_at_most_the_outputs_and_four_times_the_input(
    model: Model, g: float, matter: str, size: int, threads: int
) -> None:
    """The input, sigma_t, sigma_s and what glows, itself counts as one of the four."""
    sun = SUN if "distant" in model.lights else SKY
    assert_held(model.id, size, threads, g, sun, matter)


@SIZES
@pytest.mark.parametrize(
    ("model", "g", "sun", "matter"),
    [
        pytest.param("half_angle", 0.0, DIAGONAL, "grey", id="half angle"),
        pytest.param("half_angle", 0.0, DIAGONAL, "coloured albedo", id="half angle, coloured"),
        pytest.param("shadow_propagation", 0.0, DIAGONAL, "coloured albedo", id="shadow"),
        pytest.param("photon_mapping", 0.5, SKY, "grey", id="photons"),
    ],
)
def test_another_light_keeps_to_the_same_bound(
    model: str, g: float, sun: Sun, matter: str, size: int, threads: int
) -> None:
    assert_held(model, size, threads, g, sun, matter)


@pytest.mark.parametrize(
    ("model", "size", "threads", "g"),
    [
        pytest.param("half_angle", 96, 4, 0.0, id="half angle, small, 4 threads"),
        pytest.param("half_angle", 192, 2, 0.0, id="half angle, large"),
        pytest.param("spherical_harmonics", 96, 4, 0.0, id="harmonics, small, 4 threads"),
        pytest.param("shadow_propagation", 96, 4, 0.0, id="shadow, small, 4 threads"),
        pytest.param("photon_mapping", 96, 4, 0.5, id="photons, small, 4 threads"),
    ],
)
def test_other_sizes_keep_to_the_same_bound(model: str, size: int, threads: int, g: float) -> None:
    assert_held(model, size, threads, g, SUN, "grey")


def assert_held(model: str, size: int, threads: int, g: float, sun: Sun, matter: str) -> None:
    case = (model, size, threads, g, sun, matter, PHOTONS if get(model).averages else {})
    child = subprocess.run(
        [sys.executable, "-c", CHILD.format(case=case)], capture_output=True, text=True, check=True
    )
    inputs, outputs, rise = map(int, child.stdout.split())
    assert outputs <= rise <= outputs + 3 * inputs
