"""What a row of models or a view of errors was made of, and what has changed since.

It does not follow by itself, because a reference takes as long as it takes: the panel says when it
is of another scene, other parameters or other models than there are now. Like `staleness`, which
does the same for a bake, it never reads a voxel.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from typing import Any

import bpy

from ..bake.error_file import REFERENCE
from ..bake.hashing import PARTS
from ..core.errors import InputError
from ..models.model import Value
from ..models.registry import get
from . import staleness, work
from .outline import outline
from .properties import chosen_model, model_values
from .sidebar import stale

LIGHT, CAMERA = "the light", "the camera"


def noted(scene: bpy.types.Scene, chosen: Mapping[str, Mapping[str, Value]], button: str) -> str:
    """What these models' bakes, and full scattering, depend on in the scene as it is, as text;
    `button` is what was pressed for it. Raises InputError without a volume."""
    volume = work.chosen_volume(scene)
    if volume is None:
        raise InputError(f"scene {scene.name!r} names no volume; expected one volume object")
    note = {
        "button": button,
        "every": set(work.all_models(scene.volillum)) <= set(chosen),
        "models": {id_: dict(values) for id_, values in chosen.items()},
        "shown": list(chosen),
        "limit": scene.volillum.error_limit,
        "parts": _parts(scene, volume, chosen),
    }
    return json.dumps(note)


def only(note: str, models: Iterable[str]) -> str:
    """The note without the models that could not serve the scene."""
    entry = json.loads(note)
    entry["shown"] = list(models)
    return json.dumps(entry)


def changes(
    scene: bpy.types.Scene, volume: bpy.types.Object | None, note: str, errors: bool
) -> tuple[str, ...]:
    """What has changed since, in plain words; empty when what is shown still holds. `errors`: of
    errors, which have a scale."""
    if not note:
        return ()
    if volume is None:
        return ("the volume is gone",)
    settings, before = scene.volillum, json.loads(note)
    found = []
    try:
        wanted = work.all_models(settings) if before["every"] else (chosen_model(settings),)
        found += [f"{get(id_).label} is not in it" for id_ in wanted if id_ not in before["models"]]
    except InputError as error:
        found.append(str(error))
    now = _parts(scene, volume, before["shown"])
    found += [f"{part} has changed" for part in now if before["parts"].get(part, "") != now[part]]
    for id_ in before["shown"]:
        own = staleness.parameters(before["models"][id_], model_values(settings, id_))
        found += [f"{get(id_).label}: {each}" for each in own]
    if errors and before["limit"] != settings.error_limit:
        was, now_at = before["limit"], settings.error_limit
        found.append(f"full colour was at {was:.4g} %, is at {now_at:.4g} %")
    return tuple(found)


def draw(
    layout: bpy.types.UILayout, scene: bpy.types.Scene, note: str, errors: bool, room: float
) -> None:
    """In a panel: the changes and the button to press because of them."""
    found = changes(scene, work.chosen_volume(scene), note, errors)
    if found:
        stale(layout, f"Stale: press {json.loads(note)['button']} again", found, room)


def _parts(
    scene: bpy.types.Scene, volume: bpy.types.Object, models: Iterable[str]
) -> dict[str, Any]:
    """All parts of the scene that count, by name, as digests."""
    parts: dict[str, Any] = dict(staleness.source(scene.volillum, volume))
    parts[LIGHT] = staleness.lighting(scene, volume, get(REFERENCE))
    seen = [get(id_) for id_ in models if "camera" in get(id_).rebake_on]
    try:
        bare = outline(scene, volume)
        # An anisotropic medium looks different from everywhere.
        if bare.camera is not None and (seen or bare.medium.g != 0):
            parts[CAMERA] = PARTS["camera"](bare, get(REFERENCE))
    except InputError as error:
        parts[CAMERA] = str(error)
    return parts
