"""The models in words and as JSON: what `volillum models` prints. Needs no bpy."""

from __future__ import annotations

import math
from typing import Any

from ..models.model import Model, Parameter, Value


def as_json(model: Model) -> dict[str, Any]:
    """The model as JSON values: a bound that does not exist is null, an infinite value "inf"."""
    return {
        "id": model.id,
        "label": model.label,
        "citation": model.citation,
        "equation": model.equation,
        "summary": model.summary,
        "parameters": [_parameter(each) for each in model.parameters],
        "needs": [
            {"feature": need.feature, "treatment": need.treatment, "reason": need.reason}
            for need in model.needs
        ],
        "lights": sorted(model.lights),
        "rebake_on": sorted(model.rebake_on),
    }


def as_text(model: Model) -> str:
    """The model for a person at a terminal."""
    lines = [f"{model.id}", f"  {model.label}: {model.summary}", f"  {model.citation}"]
    for each in model.parameters:
        domain = ", ".join(each.choices) if each.choices else _domain(each)
        lines.append(f"    {each.name} = {_shown(each.default)}  ({domain})  {each.description}")
    for need in model.needs:
        lines.append(f"  {need.treatment} {need.feature}: {need.reason}")
    return "\n".join(lines)


def _parameter(parameter: Parameter) -> dict[str, Any]:
    return {
        "name": parameter.name,
        "default": _plain(parameter.default),
        "minimum": _bound(parameter.minimum),
        "maximum": _bound(parameter.maximum),
        "unit": parameter.unit,
        "choices": list(parameter.choices),
        "description": parameter.description,
    }


def _plain(value: Value) -> Value:
    return str(value) if isinstance(value, float) and math.isinf(value) else value


def _bound(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _shown(value: Value) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _domain(parameter: Parameter) -> str:
    unit = f" {parameter.unit}" if parameter.unit else ""
    return f"{_shown(parameter.minimum)} to {_shown(parameter.maximum)}{unit}"
