"""The real volumes that errors and times are reported on, with their transfer functions.

Transfer functions, lights and cameras are fixed here and in `presets/transfer_functions`, before
any table is made from them. Files are found through VOLILLUM_DATA.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable

import numpy as np
from expected_skips import third_party_data

from volillum_addon.core.camera import Camera
from volillum_addon.core.grid import Grid
from volillum_addon.core.lights import DistantLight, EnvironmentLight, Light
from volillum_addon.core.medium import Medium
from volillum_addon.core.scene import Scene
from volillum_addon.core.transfer_function import TransferFunction
from volillum_addon.readers.formats import read_volume
from volillum_addon.resources import PRESETS

# Which way is up, and from where it is seen.
Z, MINUS_Y = (0, 0, 1), (0, -1, 0)
UPRIGHT = {
    "smoke_vdb": ((0, 1, 0), (0, 0, 1)),
    "headsq_ct": ((0, 0, -1), (-0.5, 0.866, 0)),
    "engine_ct": (Z, (-0.6, 0.7, 0.4)),
}
SMOOTH = ("smoke_vdb", "rico_cloud", "neghip_sim")
HARD = ("headsq_ct", "engine_ct")


def transfer_function(name: str) -> TransferFunction:
    """The preset of this name."""
    path = PRESETS / "transfer_functions" / f"{name}.json"
    return TransferFunction.from_json(json.loads(path.read_text()))


def volume(name: str) -> Grid:
    """The file's values."""
    return read_volume(third_party_data(name))[0]


def smoke_vdb() -> Medium:
    """Smoke, optical depth 30 along its densest line, albedo 0.9."""
    density = volume("smoke_vdb/smoke.vdb")
    values = density.values
    along = max(
        float((values.sum(axis=axis) * size).max()) for axis, size in enumerate(density.voxel_size)
    )
    return Medium.from_density(density, 30.0 / along, 0.9)


def rico_cloud() -> Medium:
    """A cloud by physics: extinction per metre from its droplets, albedo 0.999."""
    return Medium.from_density(volume("rico_cloud/rico122x106x39.txt"), 1.0, 0.999)


def neghip_sim() -> Medium:
    """The simulation's smooth field."""
    return transfer_function("simulation").medium(volume("neghip_sim/neghip.slc"))


def headsq_ct() -> Medium:
    """The CT of a head, rotated by 30 degrees about z, voxels 3.2 x 3.2 x 1.5 mm."""
    return transfer_function("ct_head").medium(volume("headsq_ct/index.json"))


def engine_ct() -> Medium:
    """The CT of an engine block."""
    return transfer_function("engine").medium(volume("engine_ct/engine.nii.gz"))


MEDIA: dict[str, Callable[[], Medium]] = {
    each.__name__: each for each in (smoke_vdb, rico_cloud, neghip_sim, headsq_ct, engine_ct)
}


def scene(name: str, orthographic: bool = False, lights: tuple[Light, ...] | None = None) -> Scene:
    """The volume under a sun of 10 degrees from the upper left and a faint blue sky, seen by a
    camera that frames it from the front."""
    medium = MEDIA[name]()
    up, front = (np.array(axis, np.float64) for axis in UPRIGHT.get(name, (Z, MINUS_Y)))
    right = np.cross(up, front)
    grid = medium.trimmed(0).sigma_t
    extent = np.ptp(grid.corners(), axis=0)
    eye = grid.centre + 2.2 * float(np.linalg.norm(extent)) / 2 * (front + 0.15 * up)
    camera = Camera(eye, grid.centre, up, 0.9, orthographic)
    if lights is None:
        lights = (
            DistantLight(0.7 * up + 0.5 * front - 0.6 * right, (3.0, 3.0, 3.0), math.radians(10)),
            EnvironmentLight((0.1, 0.13, 0.2)),
        )
    return Scene(medium, lights, camera)
