"""What the operators and the command line do: plain functions, so that both do the same."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import bpy

from ..bake.grids import grid_names
from ..bake.run import Baked, bake_file
from ..bake.store import StorageError
from ..core.control import Control
from ..core.errors import InputError
from ..models.model import Value
from ..models.registry import models
from . import stage, staleness
from .medium_reader import MediumSettings
from .places import relative
from .properties import chosen_model, model_values
from .scene_reader import Reading, evaluate, read_scene, volume_path

# What a kept bake is, apart from how it is shown now.
BAKE = ("path", "frames", "model", "seconds", "found", "notes", "source")


def chosen_volume(scene: bpy.types.Scene) -> bpy.types.Object | None:
    """The volume that the settings name, or else the only one that is not a shown bake."""
    settings = scene.volillum
    if settings.volume is not None:
        return settings.volume
    shown, aside = settings.baked.shown, stage.stepped_aside()
    exhibited = [] if settings.exhibit is None else list(settings.exhibit.objects)
    volumes = [
        each for each in scene.objects
        if each.type == "VOLUME" and each != shown and each not in exhibited
        and (not each.hide_render or each in aside)
    ]  # fmt: skip
    return volumes[0] if len(volumes) == 1 else None


def grids_of(volume: bpy.types.Object) -> tuple[str, ...]:
    """The names of the grids in the volume's file. Raises InputError."""
    return grid_names(volume_path(volume))


def read(scene: bpy.types.Scene) -> Reading:
    """The scene as the core sees it, by the scene's settings. Raises InputError."""
    settings = scene.volillum
    plain = MediumSettings(settings.density_scale, tuple(settings.albedo))
    return read_scene(scene, chosen_volume(scene), settings.density_grid or None, plain)


def read_to_bake(scene: bpy.types.Scene) -> Reading:
    """The same for a bake, which may be for the camera's view alone. Raises InputError."""
    reading = read(scene)
    return replace(reading, scene=replace(reading.scene, seen_only=scene.volillum.seen_only))


def bake(
    reading: Reading, model: str, values: Mapping[str, object], directory: Path, control: Control
) -> Baked:
    """The model's bake as a file, found or computed. Any thread. Raises InputError, Cancelled."""
    return bake_file(reading.scene, model, directory, reading.stem, values, control)


@dataclass(frozen=True)
class Bakes:
    """Bakes of several models, and why others cannot serve the scene."""

    done: tuple[Baked, ...]
    refused: tuple[str, ...]


def bake_all(
    reading: Reading, chosen: Mapping[str, Mapping[str, Value]], directory: Path, control: Control
) -> Bakes:
    """`bake` of each model. Any thread. Raises InputError where none can serve the scene."""
    done, refused = [], []
    for index, (model, values) in enumerate(chosen.items()):
        begin, end = index / len(chosen), (index + 1) / len(chosen)
        with control.stage(begin, end, model):
            try:
                done.append(bake(reading, model, values, directory, control))
            except StorageError:
                raise
            except InputError as error:
                refused.append(str(error))
    if not done:
        raise InputError("; ".join(refused))
    return Bakes(tuple(done), tuple(refused))


def keep(
    scene: bpy.types.Scene, baked: Baked, source: Mapping[str, str], aside: bool = True
) -> str:
    """Note the bake in the scene's settings and return the line to say about it. The last one is
    set `aside` for A/B, if it is another one."""
    kept = scene.volillum.baked
    path = relative(baked.path)
    if aside and kept.path != path:
        set_aside(scene)
    kept.frames = 0
    kept.path = path
    kept.model = baked.model
    kept.seconds = baked.seconds_bake + baked.seconds_hand_over
    kept.found = baked.found
    kept.notes = "\n".join(baked.notes)
    kept.source = json.dumps(source)
    how = "found" if baked.found else f"baked in {kept.seconds:.2f} s"
    return f"{baked.path.name} {how}"


def keep_frames(
    scene: bpy.types.Scene, frames: Sequence[Mapping[str, Any]], source: Mapping[str, str]
) -> str:
    """The same for a sequence, each frame as the command line describes it."""
    kept = scene.volillum.baked
    path = relative(Path(frames[0]["path"]))
    if kept.path != path:
        set_aside(scene)
    kept.path, kept.model = path, frames[0]["model"]
    kept.frames = len(frames)
    kept.seconds = sum(each["seconds_bake"] + each["seconds_hand_over"] for each in frames)
    kept.found = all(each["found"] for each in frames)
    kept.notes = "\n".join(dict.fromkeys(note for each in frames for note in each["notes"]))
    kept.source = json.dumps(source)
    solved = sum(not each["found"] for each in frames)
    return f"{len(frames)} frames, {solved} of them baked now: {Path(kept.path).name}"


def set_aside(scene: bpy.types.Scene) -> None:
    """The last bake becomes the other one, which A/B switches to."""
    baked, other = scene.volillum.baked, scene.volillum.other
    for name in BAKE:
        setattr(other, name, getattr(baked, name))


def noted_source(scene: bpy.types.Scene) -> dict[str, str]:
    """What the bake about to be made comes from; InputError without a volume."""
    volume = chosen_volume(scene)
    if volume is None:
        raise InputError(f"scene {scene.name!r} names no volume; expected one volume object")
    evaluate(scene, volume)
    return staleness.source(scene.volillum, volume)


def all_models(settings: Any) -> tuple[str, ...]:
    """Every model, and the composition where one is named. Raises InputError."""
    return tuple(dict.fromkeys([*(model.id for model in models()), chosen_model(settings)]))


def chosen_models(scene: bpy.types.Scene, ids: tuple[str, ...]) -> dict[str, dict[str, Value]]:
    """The models to compare with their parameters; all of them for an empty choice."""
    wanted = ids or tuple(model.id for model in models())
    return {id_: model_values(scene.volillum, id_) for id_ in wanted}


def keep_report(scene: bpy.types.Scene, report: Mapping[str, Any], page: Path) -> str:
    """Note a comparison's figures in the scene's settings; returns the line to say about it."""
    settings = scene.volillum
    settings.results.clear()
    for model in report["models"]:
        line = settings.results.add()
        line.model = model["id"]
        line.reason = model["reason"] or ""
        total = model["errors"]["total"]
        if total is not None:
            line.error, line.noise = total["relative_rmse"], total["noise"]
            line.seconds = model["seconds"]["total"]
    settings.report = relative(page)
    return f"compared {len(settings.results)} models: {page}"
