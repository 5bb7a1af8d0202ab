"""The models in words and as JSON: what `volillum models` prints. Needs no bpy."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from ..models.model import Model, Parameter, Value
from ..models.terms import FULL, Term, terms


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
        "terms": [
            {"term": term.name, "here": term.here, "consequence": term.consequence}
            for term in _terms(model)
        ],
    }


def as_text(model: Model) -> str:
    """The model for a person at a terminal."""
    lines = [f"{model.id}", f"  {model.label}: {model.summary}", f"  {model.citation}"]
    for each in model.parameters:
        domain = ", ".join(each.choices) if each.choices else _domain(each)
        lines.append(f"    {each.name} = {_shown(each.default)}  ({domain})  {each.description}")
    for need in model.needs:
        lines.append(f"  {need.treatment} {need.feature}: {need.reason}")
    for term in _terms(model):
        if term.differs:
            lines.append(f"  {term.name} is {term.here}: {term.consequence}")
    return "\n".join(lines)


def as_markdown(models: Sequence[Model]) -> str:
    """The paper's comparison: what stands in each model's equation beside the full one's, and what
    follows where it differs."""
    columns = [terms(FULL), *(_terms(model) for model in models)]
    head = ["term", "full equation", *(model.label for model in models)]
    rows = [
        [column[0].name, *(_cell(term) for term in column)] for column in zip(*columns, strict=True)
    ]
    lines = [*HEAD, _row(head), _row(["---"] * len(head)), *map(_row, rows)]
    for model in models:
        lines += ["", f"**{model.label}** (Eq. {model.equation})", ""]
        lines += [
            f"* {term.name}: {term.here}. {term.consequence[0].upper()}{term.consequence[1:]}."
            for term in _terms(model)
            if term.differs
        ] or ["* No term differs: what remains is noise, which falls with the number of photons."]
    return "\n".join(lines)


HEAD = (
    "# The models' equations, term by term",
    "",
    "What stands in each model's equation beside the full volume rendering equation, at default "
    "settings; bold where it differs, with what follows below. Printed from the models' operators "
    "by `volillum models --markdown`. How far each is from its own equation is in "
    "[numerical errors](accuracy.md).",
    "",
)


def _terms(model: Model) -> tuple[Term, ...]:
    return terms(model.operator(model.values({})))


def _cell(term: Term) -> str:
    return f"**{term.here}**" if term.differs else term.here


def _row(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cells) + " |"


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
