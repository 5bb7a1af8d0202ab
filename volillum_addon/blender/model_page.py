"""A page about each model, printed from what the code says of it. Needs no bpy."""

from __future__ import annotations

import sys
from collections.abc import Iterator

from ..models.model import Model, Parameter, Value
from ..models.terms import terms

PICTURE = "../images/models/{id}.png"


def as_page(model: Model) -> str:
    """The model's page as Markdown: its equation as implemented, what it leaves out and when that
    shows, its parameters, what makes a bake stale, and where it was measured."""
    return "\n".join(_lines(model)) + "\n"


def _lines(model: Model) -> Iterator[str]:
    title, _, equation = _documentation(model).partition("\n\n")
    yield f"# {model.label}"
    yield ""
    yield f"`{model.id}`: {model.summary}"
    yield ""
    yield f"![{model.label}, full scattering, and their difference]({PICTURE.format(id=model.id)})"
    yield ""
    yield "*Smoke: the model's bake, Cycles' full scattering, the signed error.*"
    yield ""
    yield f"{title} {model.citation}."
    yield ""
    yield "## The equation"
    yield ""
    yield equation.strip("\n")
    yield ""
    yield "## What it leaves out, and when that shows"
    yield ""
    for need in model.needs:
        yield f"* {need.treatment} **{need.feature}**: {need.reason}"
    differing = [term for term in terms(model.operator(model.values({}))) if term.differs]
    if differing:
        yield ""
        yield "Beside the full volume rendering equation:"
        yield ""
    for term in differing:
        consequence = term.consequence[0].upper() + term.consequence[1:]
        yield f"* {term.name}: {term.here}. {consequence}."
    yield ""
    yield "## Parameters"
    yield ""
    yield "| parameter | default | range | what it trades |"
    yield "|---|---|---|---|"
    for each in model.parameters:
        yield f"| `{each.name}` | {_shown(each.default)} | {_domain(each)} | {each.description} |"
    yield ""
    yield "## Cost and error"
    yield ""
    yield (
        f"It lights by {_listed(sorted(model.lights))} light, and bakes again when "
        f"{_listed(sorted(model.rebake_on))} changes."
    )
    yield ""
    yield (
        "Measured: [numerical errors](../accuracy.md) on real volumes, [times](../performance.md), "
        "[hard cases](../hard_cases.md). How it is solved and judged: "
        "[the mathematics](../mathematics.md)."
    )


def _documentation(model: Model) -> str:
    """What the model's own module says of it."""
    return sys.modules[model.solve.__module__].__doc__ or ""


def _listed(names: list[str]) -> str:
    return " and ".join(filter(None, (", ".join(names[:-1]), names[-1])))


def _shown(value: Value) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _domain(parameter: Parameter) -> str:
    if parameter.choices:
        return ", ".join(parameter.choices)
    unit = f" {parameter.unit}" if parameter.unit else ""
    return f"{_shown(parameter.minimum)} to {_shown(parameter.maximum)}{unit}"
