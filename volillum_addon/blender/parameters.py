"""A property group per model, made from its parameters: no list of them is kept by hand."""

from __future__ import annotations

import math
from typing import Any

import bpy
import numpy as np

from ..models.model import Model, Parameter, Value
from ..models.registry import models

# The units of parameters that Blender has a kind of property for (its own display and keypad).
SUBTYPES = {"radians": "ANGLE", "world units": "DISTANCE"}
# Blender has no infinity in properties: a parameter without limit by default is this instead.
UNLIMITED = 0.0


def _has_no_limit(parameter: Parameter) -> bool:
    return isinstance(parameter.default, float) and math.isinf(parameter.default)


def _bound(value: float, otherwise: float) -> float:
    return value if math.isfinite(value) else otherwise


def _annotation(parameter: Parameter) -> Any:
    """The Blender property that mirrors the parameter."""
    common: dict[str, Any] = {
        "name": parameter.name.replace("_", " ").capitalize(),
        "description": parameter.description,
        "default": parameter.default,
        "options": set(),
    }
    if parameter.choices:
        items = [(name, name.replace("_", " ").capitalize(), "") for name in parameter.choices]
        return bpy.props.EnumProperty(items=items, **common)
    if isinstance(parameter.default, int):
        limits = _bound(parameter.minimum, -(2**31)), _bound(parameter.maximum, 2**31 - 1)
        return bpy.props.IntProperty(min=int(limits[0]), max=int(limits[1]), **common)
    largest = float(np.finfo(np.float32).max)
    minimum, maximum = _bound(parameter.minimum, -largest), _bound(parameter.maximum, largest)
    if _has_no_limit(parameter):
        common |= {"default": UNLIMITED, "description": f"{parameter.description} (0: no limit)"}
        minimum = UNLIMITED
    subtype = SUBTYPES.get(parameter.unit, "NONE")
    return bpy.props.FloatProperty(min=minimum, max=maximum, subtype=subtype, **common)


def _value(parameter: Parameter, stored: Any) -> Value:
    """The parameter's value behind a property, without the rounding of Blender's float32."""
    if not isinstance(stored, float):
        return stored  # type: ignore[no-any-return]
    if _has_no_limit(parameter) and stored == UNLIMITED:
        return math.inf
    known = [parameter.default, parameter.minimum, parameter.maximum]
    for exact in known:
        if isinstance(exact, float) and float(np.float32(exact)) == stored:
            return exact
    # The shortest decimal that is this float32: 0.1 and not 0.10000000149.
    return float(str(np.float32(stored)))


def group_of(model: Model) -> type[bpy.types.PropertyGroup]:
    """A new property group class with one property for each parameter of the model."""
    members = {
        "__annotations__": {each.name: _annotation(each) for each in model.parameters},
        "__doc__": f"Parameters of {model.label}",
    }
    return type(f"VOLILLUM_PG_{model.id}", (bpy.types.PropertyGroup,), members)


def values(group: bpy.types.PropertyGroup, model: Model) -> dict[str, Value]:
    """The model's parameters as they are set in its property group."""
    given = {each.name: _value(each, getattr(group, each.name)) for each in model.parameters}
    return model.values(given)


def items() -> list[tuple[str, str, str]]:
    """The models as items of an enumeration: id, label, one-line summary."""
    return [(model.id, model.label, model.summary) for model in models()]


GROUPS = {model.id: group_of(model) for model in models()}
