"""The volume steps aside for what is shown in its place, and comes back as it was.

Whatever of the user's is changed for that (the volume's visibility, settings of the engine) is
noted in the scene, which undo, saving and appending take along. What the user has changed since
stays as the user has it.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import bpy

# What is noted of one setting: its value before, and the value that it was given.
type Note = tuple[Any, Any]

# What stands in the volume's place.
WAYS = (
    ("VOLUME", "The volume", "The volume itself, as the scene renders it"),
    ("BAKE", "The bake", "Baked illumination"),
    ("SCATTERING", "Full scattering", "The volume with all its scattering, by Cycles"),
    ("ERROR", "Errors", "How far models are from full scattering, as colours"),
    ("ROW", "A row of models", "Several bakes beside each other"),
)
HIDDEN = {"volume.hide_render": True, "volume.hide_viewport": True}


class Stage(bpy.types.PropertyGroup):
    """What has stepped aside in a scene, and what was changed for it."""

    hidden: bpy.props.PointerProperty(name="Stepped aside", type=bpy.types.Object)
    way: bpy.props.EnumProperty(name="In its place", items=WAYS, options={"HIDDEN"})
    changed: bpy.props.StringProperty(name="Changed", options={"HIDDEN"})


def step_aside(scene: bpy.types.Scene, volume: bpy.types.Object) -> None:
    """Hide the volume; another one that had stepped aside comes back."""
    stage = scene.volillum.stage
    if stage.hidden != volume:
        come_back(scene)
        stage.hidden = volume
    _change(scene, HIDDEN)


def come_back(scene: bpy.types.Scene) -> None:
    """The volume is as visible as it was."""
    _restore(scene, "volume.")
    scene.volillum.stage.hidden = None


def set_way(scene: bpy.types.Scene, way: str, engine: Mapping[str, Any]) -> None:
    """One of WAYS and the engine's settings for it, in place of those for the way before; {}: the
    user's own. Keys are `render.NAME` and `cycles.NAME`."""
    scene.volillum.stage.way = way
    _restore(scene, "render.")
    _restore(scene, "cycles.")
    _change(scene, engine)


def stepped_aside() -> set[bpy.types.Object]:
    """The volumes that are hidden for what is shown in their place, in any scene."""
    found = {scene.volillum.stage.hidden for scene in bpy.data.scenes}
    return found - {None}


@bpy.app.handlers.persistent  # type: ignore[untyped-decorator]
def hide_linked_again(*_: object) -> None:
    """A volume that is linked from a library comes from there visible whenever a file is opened."""
    for scene in bpy.data.scenes:
        volume = scene.volillum.stage.hidden
        if volume is not None and volume.library is not None:
            volume.hide_render = volume.hide_viewport = True


def _owner(scene: bpy.types.Scene, key: str) -> tuple[Any, str]:
    owner, name = key.split(".")
    if owner == "volume":
        return scene.volillum.stage.hidden, name
    return getattr(scene, owner, None), name  # there are no settings of an engine that is disabled


def _change(scene: bpy.types.Scene, wanted: Mapping[str, Any]) -> None:
    notes = _notes(scene)
    for key, value in wanted.items():
        owner, name = _owner(scene, key)
        if owner is None:
            continue
        before = _before(scene, key) if key in HIDDEN else None
        if before is None:
            before = notes[key][0] if key in notes else getattr(owner, name)
        if getattr(owner, name) != value:
            setattr(owner, name, value)
        notes[key] = before, getattr(owner, name)  # as Blender rounds it
    _keep(scene, notes)


def _before(scene: bpy.types.Scene, key: str) -> Any:
    """What another scene has noted of a volume that it hides as well; None where there is none."""
    hidden = scene.volillum.stage.hidden
    for other in bpy.data.scenes:
        if other != scene and other.volillum.stage.hidden == hidden:
            return _notes(other).get(key, (None,))[0]
    return None


def _restore(scene: bpy.types.Scene, kind: str) -> None:
    notes = _notes(scene)
    for key in [key for key in notes if key.startswith(kind)]:
        before, given = notes.pop(key)
        owner, name = _owner(scene, key)
        if owner is not None and getattr(owner, name) == given and before != given:
            setattr(owner, name, before)
    _keep(scene, notes)


def _notes(scene: bpy.types.Scene) -> dict[str, Note]:
    text = scene.volillum.stage.changed
    return json.loads(text) if text else {}


def _keep(scene: bpy.types.Scene, notes: Mapping[str, Note]) -> None:
    scene.volillum.stage.changed = json.dumps(notes) if notes else ""
