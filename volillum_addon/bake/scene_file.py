"""A scene as one .npz file, bit for bit: how a bake reaches another process."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from ..core.camera import Camera
from ..core.errors import InputError
from ..core.grid import Grid
from ..core.medium import Medium
from ..core.scene import LIGHT_TYPES, Scene
from .store import replacing

LIGHTS = {light.kind: light for light in LIGHT_TYPES}
GRIDS = ("sigma_t", "sigma_s", "emission")


def write_scene(scene: Scene, path: Path | str) -> None:
    """Write the scene, whole or not at all. Raises StorageError."""
    arrays: dict[str, Any] = {"g": scene.medium.g, "lights": [light.kind for light in scene.lights]}
    arrays["seen_only"] = scene.seen_only
    for name in GRIDS:
        grid = getattr(scene.medium, name)
        if grid is not None:
            arrays[f"{name}.values"] = grid.values
            arrays[f"{name}.index_to_world"] = grid.index_to_world
            arrays[f"{name}.name"] = grid.name
    for index, light in enumerate(scene.lights):
        arrays.update(_described(light, f"light {index}"))
    if scene.camera is not None:
        arrays.update(_described(scene.camera, "camera"))
    with replacing(Path(path)) as temporary, temporary.open("wb") as file:
        np.savez(file, allow_pickle=False, **{k: np.asarray(v) for k, v in arrays.items()})


def read_scene(path: Path | str) -> Scene:
    """The scene that `write_scene` wrote. Raises InputError for any other file."""
    try:
        with Path(path).open("rb") as file, np.load(file, allow_pickle=False) as members:
            arrays = dict(members)
        grids = {
            name: Grid(
                arrays[f"{name}.values"],
                arrays[f"{name}.index_to_world"],
                str(arrays[f"{name}.name"]),
            )
            for name in GRIDS
            if f"{name}.values" in arrays
        }
        lights = tuple(
            LIGHTS[str(kind)](**_fields(LIGHTS[str(kind)], f"light {index}", arrays))
            for index, kind in enumerate(arrays["lights"])
        )
        camera = _fields(Camera, "camera", arrays)
        medium = Medium(**grids, g=float(arrays["g"]))
        seen_only = bool(arrays["seen_only"])
        return Scene(medium, lights, Camera(**camera) if camera else None, seen_only)
    except (OSError, BadZipFile, KeyError, ValueError, TypeError, EOFError) as error:
        raise InputError(f"{path} is not a scene file ({error}); expected a whole one") from error


def _described(item: Any, prefix: str) -> dict[str, Any]:
    described = {f"{prefix}.{field.name}": getattr(item, field.name) for field in fields(item)}
    return {name: value for name, value in described.items() if value is not None}


def _fields(kind: Any, prefix: str, arrays: dict[str, Any]) -> dict[str, Any]:
    """The fields of a dataclass: single numbers as Python's own, `shift` as a tuple."""
    found = {}
    for field in fields(kind):
        value = arrays.get(f"{prefix}.{field.name}")
        if value is not None:
            pair = value.shape == (2,)
            found[field.name] = (
                tuple(value.tolist()) if pair else value.item() if value.ndim == 0 else value
            )
    return found
