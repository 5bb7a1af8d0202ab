"""How far a bake is from full scattering at every voxel, as a file to be shown in the volume.

    error = (Y[L_model] - Y[L_full]) / RMS of Y[L_full] over the voxels with matter

with L the in-scattered radiance and Y its luminance: positive where the model is too bright. The
unit is the same for all models, so that their errors can be set side by side. L_full is a photon
map of REFERENCE's own, with another seed than the bakes': all orders of scattering and every light,
as means over voxels, with noise that is known (docs/models/photon_mapping.md).

    density          sigma_t, the mean of its colours (float)
    volillum_error   the error (float); 0 more than a margin away from matter
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from hashlib import blake2b
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..core.colour import LUMINANCE
from ..core.control import Control
from ..core.errors import InputError, bad
from ..core.grid import Grid, occupied
from ..core.scene import Scene
from ..models.illuminate import left_out
from ..models.registry import get
from ..models.volume import STANDARD_ERROR, IlluminationVolume
from . import layout
from .grids import to_vdb
from .hashing import DIGEST_BYTES, PARTS
from .openvdb_module import openvdb
from .run import bake_file, baked_volume
from .store import complain, replacing
from .vdb import described_radiance, near_matter, read_metadata

# The model without a model error of its own.
REFERENCE = "photon_mapping"
DENSITY, ERROR = "density", "volillum_error"
ENTRY = "volillum_error"
# Passes without end: the wanted noise or the time ends the reference.
PASSES = 1_000_000
# Directions of unscattered light in the reference: its only error that is no noise.
DIRECTIONS = 1024


@dataclass(frozen=True)
class FieldError:
    """The file, and figures over the voxels with matter in its own unit: root mean square (without
    what the noise adds to it) and mean of the error, and the noise of a voxel (RMS of its standard
    error)."""

    path: Path
    model: str
    rms: float
    mean: float
    noise: float
    notes: tuple[str, ...] = ()


def measure(volume: IlluminationVolume, reference: IlluminationVolume, scene: Scene) -> tuple[
    NDArray[np.float32], dict[str, float]
]:  # fmt: skip
    """The error [i, j, k] of one volume against another of the same medium, as the scene's camera
    sees it where that counts; and its `rms`, `mean` and `noise`. Raises InputError."""
    lattice = volume.medium.sigma_t
    if lattice.shape != reference.medium.sigma_t.shape:
        raise bad("the reference's voxels", reference.medium.sigma_t.shape, f"{lattice.shape}")
    view = scene.camera
    shown, full = (
        each.in_scattered(view=view).values.astype(np.float64) @ LUMINANCE
        for each in (volume, reference)
    )
    matter = occupied(lattice.values)
    unit = math.sqrt(float(np.mean(full[matter] ** 2)))
    if unit == 0:
        raise bad("the radiance of full scattering", "0 everywhere", "some light to compare with")
    error = np.where(near_matter(volume.medium), (shown - full) / unit, 0.0)
    variance = sum(_variance(each) for each in (volume, reference))
    noise = float(np.mean(np.broadcast_to(variance, lattice.shape)[matter])) / unit**2
    rms = math.sqrt(max(float(np.mean(error[matter] ** 2)) - noise, 0.0))
    figures = {"rms": rms, "mean": float(error[matter].mean()), "noise": math.sqrt(noise)}
    return error.astype(np.float32), figures


def reference_file(
    scene: Scene,
    directory: Path,
    name: str,
    noise: float,
    seconds: float,
    seed: int,
    control: Control,
) -> Path:
    """The photon map that the errors are measured against, found or baked in `directory`: until
    its relative noise is below `noise`, `seconds` at most. Raises InputError, Cancelled."""
    values = {
        "error": noise, "seconds": seconds, "passes": PASSES,
        "directions": DIRECTIONS, "noise_seed": seed,
    }  # fmt: skip
    return bake_file(scene, REFERENCE, directory, name, values, control).path


def error_file(scene: Scene, baked: Path, reference: Path) -> FieldError:
    """The error of the bake `baked` of this scene, found beside it or written there:
    `<bake>.error.<hash>.vdb`. Raises InputError, StorageError."""
    volume, full = (baked_volume(scene, path) for path in (baked, reference))
    inputs = [
        *(read_metadata(path)["hash"] for path in (baked, reference)),
        *(described_radiance(each) for each in (volume, full)),
        PARTS["camera"](scene, get(REFERENCE)) if volume.needs_view or full.needs_view else None,
    ]
    digest = blake2b(json.dumps(inputs).encode(), digest_size=DIGEST_BYTES).hexdigest()
    path = baked.with_name(f"{baked.stem}.error.{digest}.vdb")
    figures = _found(path)
    if figures is None:
        error, figures = measure(volume, full, scene)
        write_error(path, volume, error, figures)
    return FieldError(path, volume.model, notes=left_out(scene, volume.model), **figures)


def _found(path: Path) -> dict[str, float] | None:
    try:
        layout.check_whole(path)
        return dict(json.loads(layout.metadata(path)[ENTRY].value))
    except (InputError, KeyError, ValueError):
        return None


def write_error(
    path: Path, volume: IlluminationVolume, error: NDArray[np.float32], figures: Mapping[str, float]
) -> None:
    """Write the error [i, j, k] of a volume and its figures. Raises StorageError."""
    sigma_t = volume.medium.sigma_t
    density = sigma_t.values if sigma_t.channels == 1 else sigma_t.values.mean(-1)
    grids: dict[str, Grid] = {
        DENSITY: sigma_t.with_values(np.ascontiguousarray(density)),
        ERROR: sigma_t.with_values(error),
    }
    with replacing(path) as temporary:
        try:
            stored = [to_vdb(grid, name) for name, grid in grids.items()]
            openvdb().write(str(temporary), stored, metadata={ENTRY: json.dumps(dict(figures))})
            layout.check_whole(temporary)
        except (OSError, RuntimeError, InputError) as problem:
            raise complain(path.parent, temporary) from problem


def _variance(volume: IlluminationVolume) -> NDArray[np.float64] | float:
    """Of the luminance at each voxel, as if all colours erred together: they share their paths."""
    if STANDARD_ERROR not in volume.channels:
        return 0.0
    error = volume.channels[STANDARD_ERROR].values.astype(np.float64)
    return np.asarray((error if error.ndim == 3 else error @ LUMINANCE) ** 2)
