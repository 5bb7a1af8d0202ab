"""Illumination volumes as VDB files, and back.

    density              sigma_t, per world unit (float or Vec3S)
    volillum_sigma_s     only where the albedo is not one constant
    volillum_emission    sigma_a L_e, where there is any
    volillum_<channel>   the model's channels

Voxels more than KEPT_MARGIN from matter hold nothing that is ever seen and are left out. The
file's own metadata has the rest, one string of JSON for each entry, `volillum_<entry>`.
"""

from __future__ import annotations

import json
import time
from collections.abc import Iterator, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import __version__
from ..core.errors import InputError, bad
from ..core.grid import Grid, occupied
from ..core.medium import Medium
from ..models.angular import Angular, Moment, Phase
from ..models.illuminate import VOID_MARGIN
from ..models.registry import get
from ..models.volume import Cost, Factor, IlluminationVolume, RadianceTerm
from . import layout
from .grids import check_readable, grid_names, read_grid, to_vdb, transform_of, values_of
from .openvdb_module import openvdb
from .store import StorageError, complain, replacing

__all__ = ["grid_names", "read_grid", "read_metadata", "read_vdb", "write_into", "write_vdb"]

PREFIX = "volillum_"
DENSITY, SIGMA_S, EMISSION = "density", "volillum_sigma_s", "volillum_emission"
# Raised when the meaning of grids or metadata changes: older files are then not read.
FORMAT = 2
# Interpolation next to matter reads one voxel into the void; one more is for displays that blur.
KEPT_MARGIN = VOID_MARGIN
# The hand-over's own time is known after the file is written: it replaces this many blanks.
HAND_OVER = "seconds_hand_over"
BLANK = " " * 24


def write_vdb(
    volume: IlluminationVolume,
    path: Path | str,
    metadata: Mapping[str, object] | None = None,
    half: bool = False,
) -> None:
    """Write a volume to `path`, whole or not at all; `metadata` adds entries (JSON values).

    `half` stores 16-bit floats (3 digits). Raises InputError for values that do not fit those,
    StorageError where the file cannot be written.
    """
    target = Path(path)
    with replacing(target) as temporary:
        write_into(volume, temporary, metadata, half)


def write_into(
    volume: IlluminationVolume,
    path: Path,
    metadata: Mapping[str, object] | None = None,
    half: bool = False,
) -> float:
    """Write a volume straight to `path` (not atomically); returns the seconds it took."""
    module = openvdb()
    begin = time.perf_counter()
    entries = {**(metadata or {}), **_described(volume, half)}
    texts = {PREFIX + name: json.dumps(value) for name, value in entries.items()}
    texts[PREFIX + HAND_OVER] = BLANK
    near = near_matter(volume.medium)
    grids = [to_vdb(grid, name, half) for name, grid in _stored(volume, near)]
    try:
        module.write(str(path), grids, metadata=texts)
        layout.check_whole(path)
    except (OSError, RuntimeError, InputError) as error:
        raise complain(path.parent, path) from error
    seconds = time.perf_counter() - begin
    _fill_in(path, seconds)
    return seconds


def read_metadata(path: Path | str) -> dict[str, Any]:
    """The entries of a file that `write_vdb` wrote: model, parameters, version, seconds, ...

    Raises InputError for any other file.
    """
    where = Path(path)
    found = {}
    for name, text in layout.metadata(where).items():
        if name.startswith(PREFIX):
            try:
                found[name.removeprefix(PREFIX)] = json.loads(text.value)
            except ValueError:
                raise bad(
                    f"{where}'s metadata {name}", "not JSON", "an entry of volillum's"
                ) from None
    if found.get("format") != FORMAT:
        have = found.get("format", "not there")
        raise bad(f"{where}'s volillum format", have, f"{FORMAT}: a bake of this version")
    return found


def read_vdb(path: Path | str) -> IlluminationVolume:
    """The volume that `write_vdb` wrote (zero where it left voxels out).

    Raises InputError for a file that is not one, or not whole.
    """
    where = Path(path)
    entries = read_metadata(where)
    layout.check_whole(where)
    try:
        grids = {grid.name: grid for grid in openvdb().readAll(str(where))[0]}
    except (OSError, RuntimeError, LookupError) as error:
        raise InputError(f"{where} cannot be read ({error}); expected a whole VDB file") from None

    try:
        shape = tuple(entries["shape"])
        matrix = np.array(entries["index_to_world"], np.float64)

        def stored(name: str, label: str) -> Grid:
            if name not in grids:
                raise bad(f"grid {name!r}", "missing", "one of " + ", ".join(grids), str(where))
            grid = grids[name]
            check_readable(grid, f"grid {name!r} of {where}")
            difference = np.linalg.solve(matrix, transform_of(grid, name)) - np.eye(4)
            if np.abs(difference).max() > 1e-6:  # voxels
                raise bad(f"{name}'s transform", "another", "the file's metadata's", str(where))
            return Grid(values_of(grid, (0, 0, 0), shape), matrix, label)

        sigma_t = stored(DENSITY, "sigma_t")
        if entries["albedo"] is None:
            sigma_s = stored(SIGMA_S, "sigma_s")
        else:
            sigma_s = _constant_albedo(sigma_t, entries["albedo"])
        if entries["half"]:
            sigma_s = _at_most(sigma_s, sigma_t)
        emission = stored(EMISSION, "emission") if EMISSION in grids else None
        model = str(entries["model"])
        return IlluminationVolume(
            model=model,
            parameters=get(model).values(entries["parameters"]),
            medium=Medium(sigma_t, sigma_s, emission, entries["g"]),
            channels={name: stored(PREFIX + name, name) for name in entries["channels"]},
            radiance=tuple(_radiance(term) for term in entries["radiance"]),
            image_emission=entries["image_emission"],
            cost=Cost(entries["seconds"], entries["peak_bytes"], entries.get("error_estimate")),
            notes=tuple(entries["notes"]),
        )
    except KeyError as error:
        raise bad(f"{where}'s metadata {error.args[0]!r}", "missing", "a whole bake") from None


def _described(volume: IlluminationVolume, half: bool) -> dict[str, object]:
    medium = volume.medium
    return {
        "format": FORMAT,
        "version": __version__,
        "model": volume.model,
        # JSON has no infinity: the parameter itself reads it back from its name.
        "parameters": {
            name: str(value) if value in (float("inf"), float("-inf")) else value
            for name, value in volume.parameters.items()
        },
        "shape": list(medium.sigma_t.shape),
        "index_to_world": medium.sigma_t.index_to_world.tolist(),
        "albedo": _albedo(medium),
        "g": medium.g,
        "channels": list(volume.channels),
        "radiance": described_radiance(volume),
        "image_emission": volume.image_emission,
        "half": half,
        "seconds": volume.cost.seconds,
        "peak_bytes": volume.cost.peak_bytes,
        "error_estimate": volume.cost.error_estimate,
        "notes": list(volume.notes),
    }  # fmt: skip


def described_radiance(volume: IlluminationVolume) -> list[dict[str, object]]:
    """The radiance terms as JSON values."""
    return [
        {"factors": [[f.channel, f.component] for f in term.factors],
         "weight": [float(w) for w in term.weight],
         "angular": _angular_entry(term.angular)}
        for term in volume.radiance
    ]  # fmt: skip


def _albedo(medium: Medium) -> float | list[float] | None:
    """The constant albedo: one number where sigma_s has sigma_t's channels, or RGB, or None."""
    constant = medium.constant_albedo
    if constant is None or medium.sigma_s.channels < medium.channels:
        return None
    # At most 1, what rounding has put above it notwithstanding.
    rgb = [min(float(value), 1.0) for value in constant]
    return rgb if medium.sigma_s.channels == 3 else rgb[0]


def _constant_albedo(sigma_t: Grid, albedo: float | list[float]) -> Grid:
    if isinstance(albedo, list):
        wide = sigma_t.values if sigma_t.channels == 3 else sigma_t.values[..., None]
        return sigma_t.with_values(wide * np.array(albedo, np.float32), "sigma_s")
    return sigma_t.with_values(sigma_t.values * np.float32(albedo), "sigma_s")


def _at_most(sigma_s: Grid, sigma_t: Grid) -> Grid:
    """sigma_s with what rounding to half precision put above sigma_t taken away."""
    limit = sigma_t.values
    if sigma_s.channels != sigma_t.channels:
        limit = limit[..., None] if sigma_t.channels == 1 else limit.min(axis=-1)
    return sigma_s.with_values(np.minimum(sigma_s.values, limit))


def _radiance(term: Mapping[str, Any]) -> RadianceTerm:
    red, green, blue = term["weight"]
    return RadianceTerm(
        tuple(Factor(channel, component) for channel, component in term["factors"]),
        (red, green, blue),
        _angular(term["angular"]),
    )


def _angular_entry(angular: Angular | None) -> dict[str, object] | None:
    """The fields of a Phase or Moment, and which of them it is."""
    if angular is None:
        return None
    return {"kind": "phase" if isinstance(angular, Phase) else "moment", **asdict(angular)}


def _angular(entry: Mapping[str, Any] | None) -> Angular | None:
    if entry is None:
        return None
    if entry["kind"] == "moment":
        return Moment(entry["index"])
    return Phase(entry["g"], entry["direction"], entry["position"])


def _stored(volume: IlluminationVolume, near: NDArray[np.bool_]) -> Iterator[tuple[str, Grid]]:
    """The file's grids by name, one at a time: the cut copies need not be there together."""
    medium = volume.medium
    yield DENSITY, medium.sigma_t
    if _albedo(medium) is None:
        yield SIGMA_S, medium.sigma_s
    if medium.emission is not None:
        yield EMISSION, medium.emission
    for name, channel in volume.channels.items():
        if not channel.same_lattice(medium.sigma_t):
            raise bad(f"channel {name}'s lattice", channel.shape, f"{medium.sigma_t.shape}")
        yield PREFIX + name, channel.with_planes(channel.planes() * near)


def near_matter(medium: Medium) -> NDArray[np.bool_]:
    """[i, j, k]: whether some voxel at most KEPT_MARGIN away along each axis holds matter."""
    near = occupied(medium.sigma_t.values)
    if medium.emission is not None:
        near |= occupied(medium.emission.values)
    for axis in range(3):
        along = np.moveaxis(near, axis, 0)
        source = along.copy()
        for step in range(1, KEPT_MARGIN + 1):
            along[step:] |= source[:-step]
            along[:-step] |= source[step:]
    return near


def _fill_in(path: Path, seconds: float) -> None:
    """Put the hand-over's seconds into the blanks that were written for them."""
    blank = layout.metadata(path)[PREFIX + HAND_OVER]
    try:
        with path.open("r+b") as file:
            file.seek(blank.offset)
            file.write(f"{seconds:.6f}".rjust(len(BLANK)).encode())
    except OSError as error:
        raise StorageError(
            f"{path} cannot be written ({error.strerror}); expected a file"
        ) from error
