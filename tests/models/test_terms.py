"""The comparison of the models' terms is read off their operators."""

import math
from dataclasses import fields, replace

import pytest
from project_files import ROOT

from volillum_addon.blender.describe import as_markdown
from volillum_addon.models.model import Model
from volillum_addon.models.operator import Operator
from volillum_addon.models.registry import models
from volillum_addon.models.terms import FULL, READERS, terms

# A row that differs from the full equation in one field, and the terms that must say so.
CHANGES: list[tuple[dict[str, object], set[str]]] = [
    ({"lobe": "sphere"}, {"phase function"}),
    ({"lobe": "hemisphere", "axis": "gradient"}, {"phase function", "directions"}),
    ({"lobe": "cone", "axis": "view", "theta": 0.5}, {"phase function", "directions"}),
    (
        {"lobe": "phong", "axis": "light", "theta": 0.5, "beta": 7.0, "source": "light"},
        {"phase function", "directions", "incoming light"},
    ),
    ({"source": "constant"}, {"incoming light"}),
    ({"source": "environment"}, {"incoming light"}),
    ({"basis": (2, "none"), "source": "environment"}, {"incoming light"}),
    ({"radius": 3.0}, {"reach"}),
    ({"law": "linear", "weight_p": 1.0}, {"attenuation"}),
    ({"law": "bounded"}, {"attenuation"}),
    ({"order": 1, "rescatter": "none"}, {"scattering orders"}),
    ({"rescatter": "lobe"}, {"scattering orders"}),
    ({"gathers_emission": False}, {"emission"}),
    ({"gathers_emission": False, "image_emission": False}, {"emission"}),
    ({"split": "luminance"}, {"luminance and chroma"}),
]


def test_the_full_equation_differs_in_nothing() -> None:
    assert not [term.name for term in terms(FULL) if term.differs]


@pytest.mark.parametrize(("change", "names"), CHANGES, ids=lambda value: str(value))
def test_what_differs_is_said_where_it_differs(change: dict[str, object], names: set[str]) -> None:
    row = replace(FULL, **change)  # type: ignore[arg-type]
    assert {term.name for term in terms(row) if term.differs} == names


def test_every_field_of_the_operator_shows_in_some_term() -> None:
    """A new field of the operator must not be forgotten by the comparison."""
    unseen = {field.name for field in fields(Operator)} - {
        name for change, _ in CHANGES for name in change
    }
    # How the display treats negative values, what an opacity refers to, and the share of bleeding
    # are details of terms that do show.
    assert unseen == {"clamped", "reference_length", "gathers_colour"}
    bleeding = replace(FULL, order=1, gathers_colour=0.5)
    assert "luminance and chroma" in {term.name for term in terms(bleeding) if term.differs}


@pytest.mark.parametrize("model", models(), ids=lambda model: model.id)
def test_every_model_differs_from_the_full_equation_as_its_notes_say(model: Model) -> None:
    operator = model.operator(model.values({}))
    differing = {term.name for term in terms(operator) if term.differs}
    treatment = {need.feature: need.treatment for need in model.needs}
    if operator.order == 1:
        assert "scattering orders" in differing
        assert treatment["multiple scattering"] == "ignores"
    assert ("emission" not in differing) <= operator.image_emission
    if not operator.image_emission and not operator.gathers_emission:
        assert treatment["emission"] == "ignores"
    assert all(math.isfinite(len(term.here)) and term.here for term in terms(operator))
    assert len(terms(operator)) == len(READERS)


def test_the_documentation_has_the_table_that_the_code_prints() -> None:
    """`volillum models --markdown > docs/comparison.md` after a change of a model's equation."""
    page = (ROOT / "docs" / "comparison.md").read_text()
    assert page == as_markdown(models()) + "\n"
