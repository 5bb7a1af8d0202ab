"""The one registration of the models: everything that lists models iterates over MODELS."""

from __future__ import annotations

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


def get(model: str) -> Model:
    """The model of this id, or an InputError that lists the known ones."""
    if model not in MODELS:
        raise bad("model", repr(model), "one of " + ", ".join(MODELS))
    return MODELS[model]
