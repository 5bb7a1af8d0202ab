"""A volume seen through a transfer function, as a VDB file that any material can read:

    density      sigma_t, per unit of length of the volume (float)
    scattering   sigma_s, and
    absorption   sigma_t - sigma_s (floats where the albedo is grey, else Vec3S)
    emission     sigma_a L_e, where the medium glows

The transfer function is applied to the voxels, and between them all of this is interpolated: what
Cycles renders and what is baked are the same medium. The file's name has a hash of all it is made
from, because Blender never reads a file again that has changed under its name.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ..bake import layout
from ..bake.grids import to_vdb
from ..bake.openvdb_module import openvdb
from ..bake.store import complain, replacing
from ..core.control import Control
from ..core.errors import InputError
from ..core.grid import Grid
from ..core.medium import Medium
from ..core.transfer_function import TransferFunction
from .imported import About, read_imported

ENTRY = "volillum_medium"
DENSITY, SCATTERING, ABSORPTION = "density", "scattering", "absorption"
EMISSION = "emission"
# Raised when the same volume and transfer function give other grids.
REVISION = 1


def medium_of(grid: Grid, about: About, transfer: TransferFunction) -> Medium:
    """The medium; a coarser level of detail keeps the optical depth of the full one."""
    if not transfer.physical:
        transfer = replace(transfer, per_voxel=transfer.per_voxel * 2**about.level)
    return transfer.medium(grid)


def write_medium(
    source: tuple[Grid, About],
    transfer: TransferFunction,
    directory: Path,
    stem: str,
    control: Control | None = None,
) -> Path:
    """The file of this volume and transfer function, found or made: `<stem>.<hash>.vdb`.

    Raises InputError where nothing is left of the volume, StorageError, Cancelled.
    """
    grid, about = source
    target = directory / f"{stem}.{_hash(grid, about, transfer)}.vdb"
    if target.is_file():
        return target
    watch = control or Control()
    with watch.stage(0.0, 0.5, "applying the transfer function"):
        medium = medium_of(grid, about, transfer)
    if not medium.sigma_t.values.any():
        raise clear(about)
    with watch.stage(0.5, 1.0, f"writing {target.name}"):
        store(medium, target, transfer.as_json(), watch)
    return target


def clear(about: About) -> InputError:
    """The complaint about a function that leaves nothing of a volume."""
    return InputError(
        f"the transfer function makes all of {about.source} clear; expected some density between "
        f"{about.low:g} and {about.high:g}"
    )


def store(
    medium: Medium, target: Path, entry: Mapping[str, Any], control: Control | None = None
) -> None:
    """Write a medium, whole or not at all; `entry` says what it was made from. Raises StorageError,
    Cancelled."""
    with replacing(target) as temporary:
        try:
            grids = [to_vdb(each, name) for name, each in _stored(medium)]
            openvdb().write(str(temporary), grids, metadata={ENTRY: json.dumps(entry)})
            layout.check_whole(temporary)
        except (OSError, RuntimeError, InputError) as error:
            raise complain(target.parent, temporary) from error
        if control is not None:
            control.check()


def apply(
    volume: Path, transfer: TransferFunction, directory: Path, control: Control | None = None
) -> Path:
    """`write_medium` of an imported file. Raises InputError, StorageError, Cancelled."""
    watch = control or Control()
    with watch.stage(0.0, 0.3, f"reading {volume.name}"):
        source = read_imported(volume)
    with watch.stage(0.3, 1.0, "applying the transfer function"):
        return write_medium(source, transfer, directory, volume.stem, watch)


def is_medium(path: Path) -> bool:
    """Whether `write_medium` wrote this VDB file."""
    return ENTRY in layout.metadata(path)


def _stored(medium: Medium) -> list[tuple[str, Grid]]:
    sigma_t, sigma_s = medium.sigma_t, medium.sigma_s
    wide = sigma_t.values if sigma_s.channels == 1 else sigma_t.values[..., None]
    # Rounding may have put sigma_s above sigma_t by a digit.
    absorbed = np.maximum(wide - sigma_s.values, 0)
    grids = [(DENSITY, sigma_t), (SCATTERING, sigma_s), (ABSORPTION, sigma_t.with_values(absorbed))]
    return grids if medium.emission is None else [*grids, (EMISSION, medium.emission)]


def _hash(grid: Grid, about: About, transfer: TransferFunction) -> str:
    entry = transfer.as_json()
    del entry["summary"]
    digest = hashlib.sha256(json.dumps([REVISION, about.level, grid.shape, entry]).encode())
    digest.update(grid.index_to_world.tobytes())
    digest.update(grid.values.tobytes())
    return digest.hexdigest()[:12]
