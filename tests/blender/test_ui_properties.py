"""The models' properties in a scene mirror MODELS, and give its values back exactly."""

import math

import bpy
import numpy as np
import pytest

from volillum_addon.blender import parameters, properties
from volillum_addon.models.model import Model, Parameter
from volillum_addon.models.registry import MODELS, models

ALL = [(model, parameter) for model in models() for parameter in model.parameters]
IDS = [f"{model.id}-{parameter.name}" for model, parameter in ALL]


def test_there_is_one_group_for_each_model() -> None:
    assert list(parameters.GROUPS) == list(MODELS)
    for model in models():
        group = parameters.GROUPS[model.id]
        assert list(group.__annotations__) == [p.name for p in model.parameters]


def test_the_choice_of_models_is_the_registry(scene: bpy.types.Scene) -> None:
    rna = scene.volillum.bl_rna.properties["model"]
    assert [(i.identifier, i.name, i.description) for i in rna.enum_items] == [
        (model.id, model.label, model.summary) for model in models()
    ]


@pytest.mark.parametrize("model", models(), ids=MODELS)
def test_untouched_properties_are_the_defaults(scene: bpy.types.Scene, model: Model) -> None:
    # Exactly: properties are float32, but panel and command line must find each other's bakes.
    assert properties.model_values(scene.volillum, model.id) == model.values({})


@pytest.mark.parametrize(("model", "parameter"), ALL, ids=IDS)
def test_each_property_has_the_parameters_text_and_range(
    scene: bpy.types.Scene, model: Model, parameter: Parameter
) -> None:
    rna = getattr(scene.volillum, model.id).bl_rna.properties[parameter.name]
    assert rna.description.startswith(parameter.description)
    if parameter.choices:
        assert [item.identifier for item in rna.enum_items] == list(parameter.choices)
        return
    if math.isfinite(parameter.minimum) and math.isfinite(parameter.default):
        assert rna.hard_min == pytest.approx(parameter.minimum, rel=1e-7)  # float32
    if math.isfinite(parameter.maximum):
        assert rna.hard_max == pytest.approx(parameter.maximum, rel=1e-7)
    if parameter.unit == "radians":
        assert rna.unit == "ROTATION"


@pytest.mark.parametrize(("model", "parameter"), ALL, ids=IDS)
def test_the_ends_of_the_range_and_decimals_come_back_exactly(
    scene: bpy.types.Scene, model: Model, parameter: Parameter
) -> None:
    group = getattr(scene.volillum, model.id)
    if parameter.choices:
        for name in parameter.choices:
            setattr(group, parameter.name, name)
            assert properties.model_values(scene.volillum, model.id)[parameter.name] == name
        return
    tried = [value for value in (parameter.minimum, parameter.maximum) if math.isfinite(value)]
    if isinstance(parameter.default, float):
        # A decimal that float32 can tell from its neighbours.
        tried.append(float(str(np.float32(parameter.minimum + 0.1))))
    for value in tried:
        setattr(group, parameter.name, value)
        assert properties.model_values(scene.volillum, model.id)[parameter.name] == value


def test_no_limit_is_written_as_zero(scene: bpy.types.Scene) -> None:
    unlimited = [(m, p) for m, p in ALL if p.default == math.inf]
    assert unlimited  # or this test and what it is for can go
    for model, parameter in unlimited:
        group = getattr(scene.volillum, model.id)
        assert getattr(group, parameter.name) == 0
        assert "0: no limit" in group.bl_rna.properties[parameter.name].description
        setattr(group, parameter.name, 2.5)
        assert properties.model_values(scene.volillum, model.id)[parameter.name] == 2.5
        setattr(group, parameter.name, 0)
        assert properties.model_values(scene.volillum, model.id)[parameter.name] == math.inf


def test_the_density_grids_suggestions_are_the_files(scene: bpy.types.Scene) -> None:
    settings = scene.volillum
    assert properties._grids(settings, bpy.context, "") == []
    settings.volume = next(each for each in scene.objects if each.type == "VOLUME")
    assert properties._grids(settings, bpy.context, "DENS") == ["density"]
    assert properties._grids(settings, bpy.context, "heat") == []
