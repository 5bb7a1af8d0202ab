"""`volillum scene` of any format: the scene's medium is the transfer function's, and it bakes."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import pytest

from volillum_addon.blender import cli
from volillum_addon.blender.scene_reader import read_scene
from volillum_addon.readers import transfer_presets
from volillum_addon.readers.formats import read_volume
from volillum_addon.readers.medium_file import medium_of

pytestmark = pytest.mark.usefixtures("no_file_left_open")


def blob(directory: Path) -> Path:
    """A soft ball in Hounsfield units, in air, oblong voxels."""
    axes = np.meshgrid(*(np.linspace(-1, 1, n) for n in (14, 12, 10)), indexing="ij")
    radius = np.sqrt(sum(axis**2 for axis in axes))
    np.save(directory / "ct.npy", (-1000 + 2500 * np.clip(1 - radius, 0, 1)).astype(np.float32))
    (directory / "ct.json").write_text('{"kind": "ct", "unit": "HU", "spacing": [2, 2, 3]}')
    return directory / "ct.npy"


@pytest.mark.parametrize("transfer", [None, "ct_skin"])
def test_the_scenes_medium_is_the_transfer_functions(tmp_path: Path, transfer: str | None) -> None:
    path, target = blob(tmp_path), tmp_path / "out" / "ct.blend"
    chosen = ["--transfer", transfer] if transfer else []
    assert cli.main(["scene", str(path), *chosen, "-o", str(target)]) == cli.DONE
    bpy.ops.wm.open_mainfile(filepath=str(target))
    read = read_scene(bpy.context.scene).scene.medium
    grid, about = read_volume(path)
    expected = medium_of(grid, about, transfer_presets.load(transfer or "ct_bone", about))
    places = grid.to_world(np.argwhere(np.ones(grid.shape)).astype(float))
    for found, wanted in ((read.sigma_t, expected.sigma_t), (read.sigma_s, expected.sigma_s)):
        index = np.round(found.to_index(places)).astype(int)
        inside = np.all((index >= 0) & (index < found.shape), axis=1)
        values = np.zeros((len(places), 3))
        picked = found.values[tuple(index[inside].T)]
        values[inside] = picked if picked.ndim == 2 else picked[:, None]
        wide = wanted.values.reshape(len(places), -1)
        # sigma_t is put together again from two float32.
        np.testing.assert_allclose(values, np.broadcast_to(wide, values.shape), rtol=1e-6)
    # The medium, and the values that the scene's transfer function maps.
    assert sorted(file.suffix for file in target.parent.iterdir()) == [".blend", ".vdb", ".vdb"]
