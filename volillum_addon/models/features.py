"""Which of a model's needs concern a scene: each feature that needs speak of, found by analysis."""

from __future__ import annotations

from collections.abc import Callable

from ..core.analysis import Analysis
from ..core.errors import bad
from .composition import Composition
from .model import Model, Need

LOCAL = frozenset({"point", "spot", "area"})


def _scatters_on(scene: Analysis) -> bool:
    return scene.albedo[1] > 0 and scene.orders > 1


# A scene has the feature when this is true of it.
FEATURES: dict[str, Callable[[Analysis], bool]] = {
    "light direction": lambda scene: bool(scene.kinds - {"environment"}),
    "light brightness": lambda scene: bool(scene.lights),
    "light size": lambda scene: "distant" in scene.kinds,
    "distant light": lambda scene: "distant" in scene.kinds,
    "environment light": lambda scene: "environment" in scene.kinds,
    "local lights": lambda scene: bool(scene.kinds & LOCAL),
    "point lights": lambda scene: "point" in scene.kinds,
    "spot and area lights": lambda scene: bool(scene.kinds & {"spot", "area"}),
    "several lights": lambda scene: len(scene.lights) > 1,
    "every kind of light": lambda scene: bool(scene.lights),
    "far shadows": lambda scene: scene.extinction_channels > 0,
    "multiple scattering": _scatters_on,
    "phase function": lambda scene: scene.g != 0,
    "phase function of other light": lambda scene: scene.g != 0,
    "phase function of area lights": lambda scene: scene.g != 0 and "area" in scene.kinds,
    "emission": lambda scene: scene.emission_channels > 0,
    "chromatic extinction": lambda scene: scene.extinction_channels == 3,
}


def concerned(model: Model, scene: Analysis) -> tuple[Need, ...]:
    """The model's needs about what the scene has; of a composition, each part's own."""
    if isinstance(model, Composition):
        return tuple(
            Need(need.feature, need.treatment, f"{part.name}: {need.reason}")
            for part in model.parts
            for need in concerned(part.model, scene.of_kinds(part.kinds))
        )
    for need in model.needs:
        if need.feature not in FEATURES:
            raise bad(f"{model.id}'s need", repr(need.feature), "one of " + ", ".join(FEATURES))
    return tuple(need for need in model.needs if FEATURES[need.feature](scene))
