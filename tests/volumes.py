"""The real volumes that errors and times are reported on, with their transfer functions.

Transfer functions, lights and cameras are fixed here and in `presets/transfer_functions`, before
any table is made from them. Files are found through VOLILLUM_DATA.
"""

from __future__ import annotations

import gzip
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
from volillum_addon.resources import PRESETS

# Which way is up, and from where it is seen.
Z, MINUS_Y = (0, 0, 1), (0, -1, 0)
UPRIGHT = {
    "smoke_vdb": ((0, 1, 0), (0, 0, 1)),
    "headsq_ct": ((0, 0, -1), (-0.5, 0.866, 0)),
    "engine_ct": (Z, (0.6, -0.7, 0.4)),
}
SMOOTH = ("smoke_vdb", "rico_cloud", "neghip_sim")
HARD = ("headsq_ct", "engine_ct")


def transfer_function(name: str) -> TransferFunction:
    """The preset of this name."""
    path = PRESETS / "transfer_functions" / f"{name}.json"
    return TransferFunction.from_json(json.loads(path.read_text()))


def smoke_vdb() -> Medium:
    """Smoke, optical depth 30 along its densest line, albedo 0.9."""
    from volillum_addon.bake.grids import read_grid

    density = read_grid(third_party_data("smoke_vdb/smoke.vdb"), "density")
    values = density.values
    along = max(
        float((values.sum(axis=axis) * size).max()) for axis, size in enumerate(density.voxel_size)
    )
    return Medium.from_density(density, 30.0 / along, 0.9)


def rico_cloud() -> Medium:
    """A cloud by physics: sigma_t = 3 LWC / (2 rho r_eff) per metre, albedo 0.999."""
    path = third_party_data("rico_cloud/rico122x106x39.txt")
    lines = path.read_text().splitlines()
    nx, ny, nz = (int(part) for part in lines[1].split("#")[0].split(","))
    dx, dy = (1000 * float(part) for part in lines[2].split("#")[0].split(","))
    levels = [1000 * float(part) for part in lines[3].split("#")[0].split(",")]
    table = np.array([[float(part) for part in line.split(",")] for line in lines[5:] if line])
    index = table[:, :3].astype(int)
    values = np.zeros((nx, ny, nz), np.float32)
    # LWC in g/m^3, r_eff in micrometres, water of 1e6 g/m^3: the powers of ten cancel.
    values[tuple(index.T)] = 1.5 * table[:, 3] / table[:, 4]
    affine = np.diag([dx, dy, levels[1] - levels[0], 1.0])
    affine[2, 3] = levels[0]
    return Medium.from_density(Grid(values, affine, "rico_cloud"), 1.0, 0.999)


def neghip_sim() -> Medium:
    """The simulation's smooth field (a .slc file: run lengths of 8-bit values)."""
    data = third_party_data("neghip_sim/neghip.slc").read_bytes()
    return transfer_function("simulation").medium(Grid(_slc(data), np.eye(4), "neghip_sim"))


def headsq_ct() -> Medium:
    """The CT of a head, rotated by 30 degrees about z, voxels 3.2 x 3.2 x 1.5 mm."""
    folder = third_party_data("headsq_ct")
    header = json.loads((folder / "index.json").read_text())
    extent = header["extent"]
    shape = tuple(extent[2 * a + 1] - extent[2 * a] + 1 for a in range(3))
    raw = gzip.decompress(next(folder.glob("*.gz")).read_bytes())
    values = np.frombuffer(raw, "<i2").reshape(shape, order="F").astype(np.float32)
    affine = np.eye(4)
    # vtk.js: `direction` lists the world directions of the index axes one after another.
    affine[:3, :3] = np.array(header["direction"]).reshape(3, 3).T * header["spacing"]
    affine[:3, 3] = header["origin"]
    return transfer_function("ct_head").medium(Grid(values, affine, "headsq_ct"))


def engine_ct() -> Medium:
    """The CT of an engine block."""
    raw = gzip.decompress(third_party_data("engine_ct/engine.nii.gz").read_bytes())
    # NIfTI-1: dimensions at byte 40, the data's offset at byte 108; 8-bit values, x fastest.
    shape = tuple(int(n) for n in np.frombuffer(raw, "<i2", 3, 42))
    offset = int(np.frombuffer(raw, "<f4", 1, 108)[0])
    values = np.frombuffer(raw, np.uint8, math.prod(shape), offset)
    grid = Grid(values.reshape(shape, order="F").astype(np.float32), np.eye(4), "engine_ct")
    return transfer_function("engine").medium(grid)


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


def _slc(data: bytes) -> np.ndarray:
    """Values [x, y, z] of a VolVis .slc file of 8-bit voxels whose slices are run-length coded."""
    lines = data.split(b"\n", 4)
    nx, ny, nz, bits = (int(part) for part in lines[1].split())
    assert (lines[0], bits) == (b"11111", 8), "not an 8-bit .slc file"
    width, height, _ = lines[4].split(b" ", 2)
    place = data.index(b"X", sum(len(line) + 1 for line in lines[:4])) + 1
    place += 3 * int(width) * int(height)  # the icon
    slices = []
    for _ in range(nz):
        after = data.index(b"X", place)
        length = int(data[place:after])
        place = after + 1 + length
        slices.append(_runs(data[after + 1 : place], nx * ny).reshape(ny, nx).T)
    return np.stack(slices, axis=-1).astype(np.float32)


def _runs(coded: bytes, count: int) -> np.ndarray:
    """Run lengths: the high bit says literal bytes, otherwise one byte is repeated; 0 ends."""
    out = bytearray()
    place = 0
    while coded[place] & 0x7F:
        length = coded[place] & 0x7F
        if coded[place] & 0x80:
            out += coded[place + 1 : place + 1 + length]
            place += 1 + length
        else:
            out += coded[place + 1 : place + 2] * length
            place += 2
    return np.frombuffer(bytes(out), np.uint8, count)
