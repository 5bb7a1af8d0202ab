"""Peak memory of a photon bake, measured in a child process."""

from __future__ import annotations

import subprocess
import sys

import pytest

# A child prints by how many bytes a bake's peak of resident memory rose beyond what is held before,
# the input among it, and the bytes of the output. A small bake before has loaded all code.
CHILD = """
import numpy as np
import volillum_native
from volillum_addon.core.grid import Grid
from volillum_addon.core.lights import DistantLight
from volillum_addon.core.medium import Medium
from volillum_addon.core.scene import Scene
from volillum_addon.models.illuminate import bake

def held(field):
    with open("/proc/self/status") as status:
        return next(int(line.split()[1]) for line in status if line.startswith(field)) * 1024

def scene(size):
    values = np.random.default_rng(0).random((size,) * 3, dtype=np.float32)
    grid = Grid(values, np.diag([1 / size, 1 / size, 1 / size, 1.0]))
    return Scene(Medium.from_density(grid, 5.0, 0.9), (DistantLight((0.3, 0.2, 0.9), 1.0),))

volillum_native.set_threads(2)
bake(scene(8), "photon_mapping", photons=1000, passes=2)
large = scene({size})
before = held("VmRSS")
with open("/proc/self/clear_refs", "w") as peak:
    peak.write("5")  # the peak begins anew
volume = bake(large, "photon_mapping", photons=20_000, passes=2)
print(held("VmHWM") - before, sum(grid.values.nbytes for grid in volume.channels.values()))
"""


@pytest.mark.skipif(sys.platform != "linux", reason="the peak is read from /proc")
def test_peak_is_at_most_the_outputs_and_four_times_the_input() -> None:
    """The input, sigma_t and sigma_s, itself counts as one of the four."""
    size = 128
    child = subprocess.run(
        [sys.executable, "-c", CHILD.replace("{size}", str(size))],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    rise, outputs = map(int, child.stdout.split())
    assert outputs <= rise <= outputs + 3 * (2 * 4 * size**3)
