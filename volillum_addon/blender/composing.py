"""A composition as menus: for each kind of light one, of the models that know it.

`scene.volillum.composition` is text, which scripts and the command line share (`sun=ID,sky=ID`);
the menus show it and write it. The kinds are those that the scene has, and that the text names.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import bpy

from ..core.errors import InputError
from ..models.composition import GROUPS, parsed
from ..models.model import Model
from ..models.registry import MODELS
from .outline import lights

# Of a menu: these lights have no model.
NONE = ("NONE", "Left out", "Bakes without these lights")
KINDS = {
    "sun": ("Suns", "suns"),
    "lamp": ("Lamps", "point, spot and area lights"),
    "sky": ("Sky", "the world"),
}


def groups(settings: Any) -> tuple[str, ...]:
    """The kinds of light that need a menu."""
    named = _assignments(settings)
    present = _present(settings.id_data)
    return tuple(group for group in GROUPS if group in named or group in present)


def menu(group: str) -> str:
    """The name of the property that is the kind's menu."""
    return f"{group}_model"


def choices(group: str) -> tuple[Model, ...]:
    """The models that know light of this kind."""
    return tuple(model for model in MODELS.values() if GROUPS[group] & model.lights)


def _present(scene: bpy.types.Scene) -> set[str]:
    """The kinds of light in the scene; all where its lights cannot be read, which Bake says."""
    try:
        kinds = {light.kind for light in lights(scene)}
    except InputError:
        return set(GROUPS)
    return {group for group, members in GROUPS.items() if members & kinds}


def _assignments(settings: Any) -> dict[str, str]:
    """The models by kind of light as far as the text is clear."""
    try:
        return parsed(settings.composition)
    except InputError:
        return {}


def _write(settings: Any, assignments: dict[str, str]) -> None:
    settings.composition = ",".join(
        f"{group}={assignments[group]}" for group in GROUPS if group in assignments
    )


def _begun(settings: Any) -> dict[str, str]:
    """What a composition begins with: the one model, where it knows the light; else one that does,
    if possible from everywhere and not only from the camera."""
    found = {}
    for group in groups(settings):
        known = sorted(choices(group), key=lambda model: "camera" in model.rebake_on)
        ids = [model.id for model in known]
        found[group] = settings.model if settings.model in ids else ids[0]
    return found


def _is_on(settings: Any) -> bool:
    return bool(settings.composition.strip())


def _switch(settings: Any, on: bool) -> None:
    _write(settings, _begun(settings) if on else {})


def _getter(group: str) -> Callable[[Any], int]:
    numbers = {model.id: number for number, model in enumerate(choices(group), 1)}
    return lambda settings: numbers.get(_assignments(settings).get(group, ""), 0)


def _setter(group: str) -> Callable[[Any, int], None]:
    def write(settings: Any, number: int) -> None:
        assignments = {**_assignments(settings)}
        assignments.pop(group, None)
        if number:
            assignments[group] = choices(group)[number - 1].id
        _write(settings, assignments)

    return write


def _menu(group: str) -> Any:
    items = [(*NONE, 0)] + [
        (model.id, model.label, model.summary, number)
        for number, model in enumerate(choices(group), 1)
    ]
    title, what = KINDS[group]
    return bpy.props.EnumProperty(
        name=title,
        description=f"The model for {what}, by which their light finds its way through the volume",
        items=items,
        get=_getter(group),
        set=_setter(group),
        options={"SKIP_SAVE"},
    )


PROPERTIES: dict[str, Any] = {
    "by_light": bpy.props.BoolProperty(
        name="By kind of light",
        description="One model for suns, one for lamps, one for the sky, whose light adds up",
        get=_is_on,
        set=_switch,
        options={"SKIP_SAVE"},
    ),
    **{menu(group): _menu(group) for group in GROUPS},
}
