"""Peak memory of the sweep, measured in child processes."""

from __future__ import annotations

import subprocess
import sys

import pytest

# A child prints by how many bytes its peak of resident memory rose through the sweep, beyond the
# arrays that it holds. All of those have been written to before, so that their pages count already.
CHILD = """
import numpy as np
import volillum_native

def peak():
    with open("/proc/self/status") as status:
        return next(int(line.split()[1]) for line in status if line.startswith("VmHWM:")) * 1024

size, count, channels, near, axis = {size}, {count}, {channels}, {near}, {axis}
random = np.random.default_rng(1)
sigma_t = random.random((size,) * 3, dtype=np.float32)
directions = np.roll(np.array([1.0, 0.0, 0.0]) + 0.3 * random.normal(size=(count, 3)), axis, axis=1)
if axis < 0:
    directions = random.normal(size=(count, 3))
directions /= np.linalg.norm(directions, axis=1, keepdims=True)
weights = np.ones((count, channels), np.float32)
out = np.ones((channels, size, size, size), np.float32)
# What a process needs once: threads' stacks, the allocator's arenas.
small = np.ones((8, 8, 8), np.float32)
volillum_native.sweep(small, np.eye(4), directions, weights, near_slices=near, threads=2)
before = peak()
volillum_native.sweep(
    sigma_t, np.eye(4), directions, weights, near_slices=near, threads=2, out=out
)
print(peak() - before)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="the peak is read from /proc")
@pytest.mark.parametrize(
    ("count", "channels", "near", "axis"),
    [
        pytest.param(1, 1, 0, 0, id="one direction along i"),
        pytest.param(1, 1, 4, 2, id="one direction along k"),
        pytest.param(64, 1, 4, 1, id="a cone along j"),
        pytest.param(64, 1, 0, 2, id="a cone along k"),
        pytest.param(66, 4, 0, -1, id="the sphere, 4 channels"),
    ],
)
def test_peak_is_at_most_the_outputs_and_four_times_the_input(
    count: int, channels: int, near: int, axis: int
) -> None:
    """The input itself counts as one of the four: three times its size is left for scratch.

    At this size the workspaces of the threads, which do not grow with the grid, matter most.
    """
    size = 128
    script = CHILD.format(size=size, count=count, channels=channels, near=near, axis=axis)
    child = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    assert int(child.stdout) <= 3 * 4 * size**3
