"""Whether the last bake still fits the scene, and what has changed since.

Runs at every redraw of the panel, so it never reads a voxel: the medium's part of a bake's digests
is stood in for by its source (file, place, material), which is noted when the bake is made.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import lru_cache
from hashlib import blake2b
from pathlib import Path
from typing import Any

import bpy

from ..bake.frame_files import files, frame_file, frame_of
from ..bake.hashing import ALSO_SEEN_ONLY, PARTS
from ..bake.radiance_file import shows
from ..bake.vdb import read_metadata
from ..core.errors import InputError
from ..models.model import Model, Value, Values
from ..models.registry import get
from .frames import kept_frame
from .outline import closures, outline, world_state
from .places import baked_file, block_file
from .properties import chosen_model, model_values

# What of a source does not move: of a sequence, all else may differ from frame to frame.
STILL = "the volume's file or grid"


def source(settings: Any, volume: bpy.types.Object) -> dict[str, str]:
    """What the medium comes from, part by part, each as a digest."""
    data = volume.data
    path = block_file(data)
    try:
        state = path.stat()
        file = [path.name, state.st_size, state.st_mtime_ns]  # wherever it has been moved
    except OSError:
        file = [path.name]
    # Loading what is loaded costs nothing.
    frame = data.grids.frame_filepath if data.is_sequence and data.grids.load() else ""
    return {
        STILL: _digest([*file, settings.density_grid]),
        "the frame of the volume's sequence": Path(frame).name,
        "the volume's place": _digest([*_place(volume), data.render.space]),
        "the volume's material": _digest(_coefficients(settings, volume)),
    }


def _place(volume: bpy.types.Object) -> list[list[list[float]]]:
    """What the object's matrix_world comes from: of one that is hidden Blender leaves the matrix as
    it was."""
    found = [volume.matrix_basis]
    parent = volume.parent
    if parent is not None:
        found += [volume.matrix_parent_inverse, parent.matrix_world]
    if volume.constraints or (parent is not None and volume.parent_type != "OBJECT"):
        found.append(volume.matrix_world)
    return [[list(row) for row in matrix] for matrix in found]


def changes(scene: bpy.types.Scene, volume: bpy.types.Object | None) -> tuple[str, ...]:
    """What has changed since the scene's last bake, in plain words; empty when it is fresh."""
    settings = scene.volillum
    baked = settings.baked
    if not baked.path:
        return ()
    try:
        path = baked_file(scene)
        if baked.frames:
            first = frame_of(path)
            last = first + baked.frames - 1
            if not first <= scene.frame_current <= last:
                return (f"frame {scene.frame_current} is outside of the baked {first} to {last}",)
            path = frame_file(path, scene.frame_current)
        metadata = _metadata(str(path))
    except (InputError, OSError):
        return ("the baked file is gone",)
    if volume is None:
        return ("the volume is gone",)
    model = get(metadata["model"])
    now, before = source(settings, volume), json.loads(baked.source or "{}")
    parts = (STILL,) if baked.frames else now
    return (
        *(f"{part} has changed" for part in parts if before.get(part, "") != now[part]),
        *parameters(metadata["parameters"], model_values(settings, model.id)),
        *_parts(scene, volume, model, metadata),
    )


def state(scene: bpy.types.Scene, volume: bpy.types.Object) -> tuple[str, str]:
    """What the chosen model's bake of the scene as it is now would depend on, and the medium's part
    of that, as digests. Raises InputError where the scene cannot be read or served."""
    settings = scene.volillum
    model = get(chosen_model(settings))
    bare = outline(scene, volume)
    model.check(bare)
    medium = _digest([*source(settings, volume).values(), bare.medium.g])
    given = model_values(settings, model.id)
    parts = [PARTS[part](bare, model) for part in _parts_of(bare.seen_only, model, given)]
    values = {name: str(value) for name, value in given.items()}
    return _digest([medium, model.id, values, parts]), medium


def noted_lighting(scene: bpy.types.Scene, volume: bpy.types.Object | None) -> str:
    """`lighting` of the last bake's model as it is shown: of a sequence, at each of its frames."""
    baked = scene.volillum.baked
    model = get(baked.model)
    if not baked.frames:
        return lighting(scene, volume, model)
    noted = {}
    with kept_frame(scene):
        for frame in files(baked_file(scene)):
            scene.frame_set(frame)
            noted[frame] = lighting(scene, volume, model)
    return json.dumps(noted)


def lighting(scene: bpy.types.Scene, volume: bpy.types.Object | None, model: Model) -> str:
    """What a shown bake's brightness and colours come from, as a digest: the lights as they are,
    of a world's image its name and strength. Empty where the scene cannot be read."""
    if volume is None:
        return ""
    try:
        bare = outline(scene, volume)
    except InputError:
        return ""
    return _digest([PARTS["light"](bare, model), world_state(scene.world)])


def shown_differs(scene: bpy.types.Scene, volume: bpy.types.Object | None) -> str:
    """What Show would change about the bake that is shown, in plain words; empty for nothing."""
    baked = scene.volillum.baked
    if baked.shown is None:
        return ""
    if baked.shown.name not in scene.objects:
        return "What was shown has been removed: Baked, beside Scattering, shows it again"
    if not shows(block_file(baked.shown.data), baked_file(scene)):
        return "An older bake is shown: Baked, beside Scattering, shows the new one"
    noted = baked.lighting
    if baked.frames:
        noted = json.loads(noted).get(str(scene.frame_current))
    if noted is not None and noted != lighting(scene, volume, get(baked.model)):
        return "The lights have changed: Baked, beside Scattering, relights"
    return ""


def parameters(before: Mapping[str, Any], now: Mapping[str, Value]) -> list[str]:
    """Parameters are stored as they were given: the same number reads as the same value."""
    return [
        f"{name} was {_shown(before.get(name))}, is {_shown(value)}"
        for name, value in now.items()
        if _shown(before.get(name)) != _shown(value)
    ]


def _shown(value: object) -> str:
    try:
        return f"{float(value):.6g}"  # type: ignore[arg-type]
    except (TypeError, ValueError):
        return str(value)


def _parts_of(seen_only: bool, model: Model, values: Values) -> list[str]:
    """What a bake with these settings depends on beside the medium."""
    parts = model.rebakes_on(model.values(values)) | ALSO_SEEN_ONLY[seen_only]
    return [part for part in sorted(parts) if part in PARTS]


def _parts(
    scene: bpy.types.Scene, volume: bpy.types.Object, model: Model, metadata: Mapping[str, Any]
) -> list[str]:
    """The lights' and the camera's digests against those of the bake."""
    before = metadata["inputs"]
    try:
        seen_only = scene.volillum.seen_only
        if seen_only != ("view" in before):
            return ["all was baked" if seen_only else "only what the camera saw was baked"]
        parts = _parts_of(seen_only, model, metadata["parameters"])
        if not parts:
            return []
        bare = outline(scene, volume)
        return [
            f"the {part} has changed"
            for part in parts
            if PARTS[part](bare, model) != before.get(part)
        ]
    except InputError as error:
        return [str(error)]


def _coefficients(settings: Any, volume: bpy.types.Object) -> list[Any]:
    """What the medium's coefficients are made of, beside the grids."""
    try:
        parts = closures(volume)
    except InputError as error:
        return [str(error)]
    fields = [field for part in parts for field in (part.sigma_s, part.sigma_a, part.emission)]
    plain = [
        [field.constant.tolist(), {name: m.tolist() for name, m in sorted(field.grids.items())}]
        for field in fields
    ]
    return plain or [settings.density_scale, *settings.albedo]


# Baked files never change under their name.
@lru_cache(maxsize=16)
def _metadata(path: str) -> Mapping[str, Any]:
    return read_metadata(path)


def _digest(value: list[Any]) -> str:
    return blake2b(json.dumps(value).encode(), digest_size=8).hexdigest()
