"""Peak memory of bakes, measured in child processes."""

from __future__ import annotations

import subprocess
import sys

import pytest

# A child prints by how many bytes a bake's peak of resident memory rose beyond what is held before,
# the input among it, and the bytes of the output. A small bake before has loaded all code.
CHILD = """
from dataclasses import replace

import numpy as np
import volillum_native
from volillum_addon.core.grid import Grid
from volillum_addon.core.lights import DistantLight, EnvironmentLight
from volillum_addon.core.medium import Medium
from volillum_addon.core.scene import Scene
from volillum_addon.models.illuminate import bake

model, size, threads, g, sun, parameters = {model!r}, {size}, {threads}, {g}, {sun}, {parameters}

def held(field):
    with open("/proc/self/status") as status:
        return next(int(line.split()[1]) for line in status if line.startswith(field)) * 1024

def scene(size):
    values = np.random.default_rng(0).random((size,) * 3, dtype=np.float32)
    grid = Grid(values, np.diag([1 / size, 1 / size, 1 / size, 1.0]))
    medium = replace(Medium.from_density(grid, 5.0, 0.9), g=g)
    light = DistantLight(sun, 1.0) if sun else EnvironmentLight((0.3, 0.3, 0.3))
    return Scene(medium, (light,))

volillum_native.set_threads(threads)
bake(scene(8), model, **parameters)
large = scene(size)
before = held("VmRSS")
with open("/proc/self/clear_refs", "w") as peak:
    peak.write("5")  # the peak begins anew
volume = bake(large, model, **parameters)
print(held("VmHWM") - before, sum(grid.values.nbytes for grid in volume.channels.values()))
"""
PHOTONS = {"photons": 20_000, "passes": 2}
# Along a diagonal of the grid the light's lattice is widest. Of no sun: a grey sky.
SUN, DIAGONAL, SKY = (0.3, 0.2, 0.9), (1.0, 1.0, 1.0), None


@pytest.mark.skipif(sys.platform != "linux", reason="the peak is read from /proc")
@pytest.mark.parametrize(
    ("model", "size", "threads", "g", "sun", "parameters"),
    [
        pytest.param("half_angle", 96, 2, 0, DIAGONAL, {}, id="half angle, small"),
        pytest.param("half_angle", 96, 4, 0, DIAGONAL, {}, id="half angle, small, 4 threads"),
        pytest.param("half_angle", 128, 4, 0, DIAGONAL, {}, id="half angle, 4 threads"),
        pytest.param("half_angle", 192, 2, 0, SUN, {}, id="half angle, large"),
        pytest.param("spherical_harmonics", 128, 2, 0, SKY, {}, id="harmonics"),
        pytest.param("photon_mapping", 128, 2, 0, SUN, PHOTONS, id="photons"),
        pytest.param("photon_mapping", 128, 4, 0, SUN, PHOTONS, id="photons, 4 threads"),
        pytest.param("photon_mapping", 128, 2, 0.5, SUN, PHOTONS, id="anisotropic"),
        pytest.param("photon_mapping", 128, 4, 0.5, SUN, PHOTONS, id="anisotropic, 4 threads"),
        pytest.param("photon_mapping", 128, 2, 0.5, SKY, PHOTONS, id="anisotropic, sky"),
        pytest.param("photon_mapping", 128, 4, 0.5, SKY, PHOTONS, id="anisotropic, sky, 4 threads"),
    ],
)
def test_peak_is_at_most_the_outputs_and_four_times_the_input(
    model: str,
    size: int,
    threads: int,
    g: float,
    sun: tuple[float, float, float] | None,
    parameters: dict[str, object],
) -> None:
    """The input, sigma_t and sigma_s, itself counts as one of the four."""
    script = CHILD.format(
        model=model, size=size, threads=threads, g=g, sun=sun, parameters=parameters
    )
    child = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    rise, outputs = map(int, child.stdout.split())
    assert outputs <= rise <= outputs + 3 * (2 * 4 * size**3)
