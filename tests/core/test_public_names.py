"""The public names mean the same whatever has been imported before."""

from __future__ import annotations

import subprocess
import sys

import pytest

CODE = """
import sys
sys.path[:0] = {path!r}
{before}
import numpy as np
import volillum_addon as volillum
assert "directional_occlusion" in [model.id for model in volillum.models()]
grid = volillum.Grid(np.ones((3, 4, 5)), np.eye(4))
scene = volillum.Scene(volillum.Medium(grid, grid), (volillum.DistantLight((0, 0, 1), 1.0),))
try:
    volillum.bake(scene, "multidirectional_occlusion", theta=9.0)
except volillum.InputError as error:
    assert "theta is 9" in str(error)
else:
    raise AssertionError("baked with a theta of 9")
for name in volillum.__all__:
    assert callable(getattr(volillum, name)), name
"""


@pytest.mark.parametrize(
    "before",
    [
        "",
        "import volillum_addon.bake.run, volillum_addon.models.registry",
        "import volillum_addon; volillum_addon.write_vdb; volillum_addon.models",
    ],
)
def test_public_functions_survive_their_namesakes(before: str) -> None:
    done = subprocess.run(
        [sys.executable, "-c", CODE.format(path=sys.path, before=before)],
        capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
