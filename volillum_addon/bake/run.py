"""One bake: from a scene and a model to a VDB file, unless that file is there already."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from ..core.control import Control
from ..core.errors import InputError, bad
from ..core.scene import Scene
from ..models.illuminate import VOID_MARGIN, illuminate, left_out, relight
from ..models.registry import get
from ..models.volume import IlluminationVolume
from . import layout, memory, store
from .hashing import combined, input_digests
from .openvdb_module import openvdb
from .vdb import HAND_OVER, read_metadata, read_vdb, write_into

# Share of the whole work that the model's own takes, for the progress bar.
SOLVE_SHARE = 0.9


@dataclass(frozen=True)
class Baked:
    """A bake's file and what it took. Seconds of the model's own work, of the hand-over (grids
    built, compressed, written), and the process's peak memory; `found`: not computed now."""

    path: Path
    model: str
    hash: str
    seconds_bake: float
    seconds_hand_over: float
    peak_bytes: int
    found: bool
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Plan:
    """A checked bake that is not done yet: the trimmed scene, the file, and what it depends on."""

    scene: Scene
    model: str
    values: Mapping[str, float | int | str]
    path: Path
    half: bool
    digests: Mapping[str, str] = field(repr=False)

    @property
    def hash(self) -> str:
        """The digest of the inputs, 16 hex digits."""
        return combined(self.digests)

    def found(self) -> Baked | None:
        """The finished bake of the same inputs, or None when it is missing or not whole."""
        try:
            entries = read_metadata(self.path)
            layout.check_whole(self.path)
            if entries["hash"] != self.hash or entries["model"] != self.model:
                return None
            return Baked(
                path=self.path,
                model=self.model,
                hash=self.hash,
                seconds_bake=float(entries["seconds"]),
                seconds_hand_over=float(entries[HAND_OVER]),
                peak_bytes=int(entries["peak_bytes"]),
                found=True,
                notes=left_out(self.scene, self.model),
            )
        except (InputError, KeyError, TypeError, ValueError):
            return None

    def solve_into(self, target: Path, control: Control) -> Baked:
        """Compute the bake and write it straight to `target`."""
        openvdb()  # where it is missing, that is known before the work
        with control.stage(0, SOLVE_SHARE, get(self.model).label):
            volume = illuminate(self.scene, self.model, self.values, control)
        with control.stage(SOLVE_SHARE, 1, "writing"):
            peak = memory.peak_bytes()
            volume = replace(volume, cost=replace(volume.cost, peak_bytes=peak))
            metadata = {"hash": self.hash, "inputs": dict(self.digests)}
            seconds = write_into(volume, target, metadata, self.half)
            control.check()
        return Baked(
            path=self.path,
            model=self.model,
            hash=self.hash,
            seconds_bake=volume.cost.seconds,
            seconds_hand_over=seconds,
            peak_bytes=peak,
            found=False,
            notes=volume.notes,
        )


def plan_bake(
    scene: Scene,
    model: str,
    directory: Path | str,
    name: str,
    parameters: Mapping[str, object] | None = None,
    half: bool = False,
    frame: int | None = None,
    sequence: str | None = None,
) -> Plan:
    """Check everything that a bake needs but the directory, and name its file.

    `<name>.<model>.<hash>.vdb`, or `<name>.<model>.<hash>_<frame>.vdb` for a frame: then
    `sequence` is the hash that all frames share (`combined` of the frames' own), so that Blender
    plays them as one. Raises InputError.
    """
    chosen = get(model)
    values = chosen.values(parameters or {})
    chosen.check(scene)
    if not name or name in (".", "..") or any(c in name for c in "/\\\0"):
        raise bad("the bake's name", repr(name), "a file name without folders")
    if frame is not None and frame < 0:
        raise bad("the frame", frame, "0 or more: Blender plays no others from files")
    trimmed = scene.trimmed(VOID_MARGIN)
    digests = input_digests(trimmed, chosen, values, half)
    number = "" if frame is None else f"_{frame:04d}"
    file = f"{name}.{model}.{sequence or combined(digests)}{number}.vdb"
    return Plan(trimmed, model, values, Path(directory) / file, half, digests)


def bake_file(
    scene: Scene,
    model: str,
    directory: Path | str,
    name: str,
    parameters: Mapping[str, object] | None = None,
    control: Control | None = None,
    half: bool = False,
    frame: int | None = None,
    sequence: str | None = None,
) -> Baked:
    """The model's bake of the scene as a file in `directory`: found, or computed and written.

    Raises InputError (StorageError where the directory cannot be written) before any work where
    that is possible, and Cancelled; neither leaves anything behind.
    """
    plan = plan_bake(scene, model, directory, name, parameters, half, frame, sequence)
    found = plan.found()
    if found is not None:
        store.prepare(plan.path.parent)
        return found
    with store.replacing(plan.path) as temporary:
        return plan.solve_into(temporary, control or Control())


def baked_volume(scene: Scene, path: Path | str) -> IlluminationVolume:
    """The volume of a bake of this scene under the scene's lights as they are now.

    A found bake may have been made under other intensities, or another anisotropy that its model
    ignores: both are taken from the scene.
    """
    volume = relight(read_vdb(path), scene.lights)
    return replace(
        volume,
        medium=replace(volume.medium, g=scene.medium.g),
        notes=left_out(scene, volume.model),
    )
