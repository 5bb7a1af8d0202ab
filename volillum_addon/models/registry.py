"""The one registration of the models: everything that lists models iterates over MODELS."""

from __future__ import annotations

from collections.abc import Mapping

from ..core.errors import bad
from . import (
    ambient_occlusion,
    directional_occlusion,
    half_angle,
    multidirectional_occlusion,
    photon_mapping,
    shadow_propagation,
    spherical_harmonics,
)
from .composition import compose, parsed
from .model import Model

MODELS: dict[str, Model] = {
    module.MODEL.id: module.MODEL
    for module in (
        half_angle,
        directional_occlusion,
        multidirectional_occlusion,
        shadow_propagation,
        spherical_harmonics,
        ambient_occlusion,
        photon_mapping,
    )
}


def models() -> tuple[Model, ...]:
    """The registered models, in the order of the paper's sections."""
    return tuple(MODELS.values())


def get(model: str | Mapping[str, str]) -> Model:
    """The model of this id, or an InputError that lists the known ones.

    `sun=ID,sky=ID`, or the same as a mapping, is the composition of these (models/composition.py).
    """
    if not isinstance(model, str):
        return compose(model, MODELS)
    if "=" in model:
        return compose(parsed(model), MODELS)
    if model not in MODELS:
        raise bad("model", repr(model), "one of " + ", ".join(MODELS))
    return MODELS[model]
