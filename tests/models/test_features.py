"""Needs that concern a scene, read off its analysis."""

from dataclasses import replace

import pytest
from media import smooth_random

from volillum_addon.core.analysis import Analysis, analysis
from volillum_addon.core.errors import InputError
from volillum_addon.core.lights import DistantLight, EnvironmentLight, PointLight
from volillum_addon.core.scene import Scene
from volillum_addon.models.features import FEATURES, concerned
from volillum_addon.models.model import Model, Need
from volillum_addon.models.registry import MODELS, get

SUN, SKY = DistantLight((0, 0, 1), 1.0), EnvironmentLight(1.0)


def known(*lights: object) -> Analysis:
    return analysis(Scene(smooth_random((8, 8, 8), 1), lights))  # type: ignore[arg-type]


@pytest.mark.parametrize("model", MODELS.values(), ids=lambda model: model.id)
def test_every_need_speaks_of_a_feature_that_analysis_finds(model: Model) -> None:
    assert {need.feature for need in model.needs} <= FEATURES.keys()


def test_only_what_the_scene_has_is_told() -> None:
    model = get("multidirectional_occlusion")
    features = {need.feature for need in concerned(model, known(SUN))}
    assert "light size" in features
    assert not features & {"environment light", "point lights", "emission", "phase function"}
    both = {need.feature for need in concerned(model, known(SUN, SKY))}
    assert both - features == {"environment light"}
    lamp = {need.feature for need in concerned(model, known(PointLight((0, 0, 9), 1.0)))}
    assert "point lights" in lamp


def test_a_part_of_a_composition_answers_for_its_own_lights() -> None:
    pair = get("sun=multidirectional_occlusion,sky=spherical_harmonics")
    needs = concerned(pair, known(SUN, SKY))
    by_part = {(need.reason.partition(":")[0], need.feature) for need in needs}
    assert ("sun", "environment light") not in by_part
    assert ("sky", "environment light") in by_part
    assert ("sky", "distant light") not in by_part


def test_an_unknown_feature_is_an_error() -> None:
    odd = replace(get("half_angle"), needs=(Need("moonlight", "ignores", "no moon"),))
    with pytest.raises(InputError, match="moonlight"):
        concerned(odd, known(SUN))
