"""What a bake saves by what its scene lacks."""

from __future__ import annotations

import numpy as np
import pytest
from comparisons import synthetic_scene

from volillum_addon.compare.savings import lacking, savings
from volillum_addon.core.control import Control
from volillum_addon.core.medium import Medium
from volillum_addon.core.scene import Scene
from volillum_addon.models.illuminate import illuminate
from volillum_addon.models.model import Model
from volillum_addon.models.registry import MODELS, models


def grey() -> Scene:
    """A soft ball of one colour in a grid with wide margins, under a sun."""
    scene = synthetic_scene()
    grid = scene.medium.sigma_t
    values = np.where(grid.values > 2, grid.values, 0).astype(np.float32)
    density = grid.with_values(values, "density")
    medium = Medium.from_density(density, 1.0, 0.8)
    return Scene(medium, scene.lights[:1], scene.camera)


@pytest.mark.parametrize("model", models(), ids=lambda model: model.id)
def test_what_is_stored_is_what_a_bake_would_store(model: Model) -> None:
    scene = grey()
    values = model.values(model.ladder[0] if model.ladder else {})
    found = {each.what: each for each in savings(scene, model, values, Control())}
    size = stored(scene, model)
    for what, other in lacking(scene.trimmed(0), model, values):
        assert found[what].stored == pytest.approx(stored(other, model) / size, rel=1e-12)
        assert found[what].seconds > 0
    margins = found[next(what for what in found if what.startswith("matter in"))]
    assert margins.seconds == margins.stored > 1


def stored(scene: Scene, model: Model) -> int:
    volume = illuminate(scene, model.id, model.ladder[0] if model.ladder else {})
    return sum(grid.values.nbytes for grid in volume.channels.values())


def test_what_a_scene_has_is_not_put_back() -> None:
    scene = grey()
    photons = MODELS["photon_mapping"]
    names = [what for what, _ in lacking(scene, photons, photons.values({}))]
    assert names == ["coloured matter", "a glow", "a preferred direction of scattering"]
    for what, other in lacking(scene, photons, photons.values({})):
        assert what not in [each for each, _ in lacking(other, photons, photons.values({}))]
    # Terms that an equation does not have cost nothing anyway.
    occlusion = MODELS["half_angle"]
    assert "a glow" not in [what for what, _ in lacking(scene, occlusion, occlusion.values({}))]


def test_coloured_matter_costs_three_channels() -> None:
    scene = grey()
    model = MODELS["spherical_harmonics"]
    (found,) = [
        each
        for each in savings(scene, model, model.values({}), Control())
        if each.what == "coloured matter"
    ]
    assert found.stored == pytest.approx(3)
