"""A composition as menus: one for each kind of light that the scene has, over one text."""

from __future__ import annotations

from types import SimpleNamespace

import bpy
import pytest
from blender_scenes import add_light
from recording_layout import RecordingLayout

from volillum_addon.blender import composing, panels
from volillum_addon.blender.properties import chosen_model
from volillum_addon.core.errors import InputError
from volillum_addon.models.composition import GROUPS
from volillum_addon.models.registry import get, models

PAIR = "sun=half_angle,sky=spherical_harmonics"


def draw(scene: bpy.types.Scene) -> RecordingLayout:
    layout = RecordingLayout()
    panels.VOLILLUM_PT_model.draw(SimpleNamespace(layout=layout), SimpleNamespace(scene=scene))
    return layout


def add_lamp(scene: bpy.types.Scene) -> bpy.types.Object:
    placed = add_light(scene, "POINT", 100.0)
    scene.view_layers[0].update()
    return placed


def test_there_is_a_menu_for_each_kind_of_light(scene: bpy.types.Scene) -> None:
    settings = scene.volillum
    assert composing.groups(settings) == ("sun", "sky")
    settings.by_light = True
    assert draw(scene).properties()[:3] == ["sun_model", "sky_model", "by_light"]
    lamp = add_lamp(scene)
    assert draw(scene).properties()[:4] == ["sun_model", "lamp_model", "sky_model", "by_light"]
    assert settings.lamp_model == "NONE"
    settings.lamp_model = "half_angle"
    # A kind that has gone is still in the text, and so still to be seen.
    bpy.data.objects.remove(lamp)
    assert "lamp_model" in draw(scene).properties()
    settings.lamp_model = "NONE"
    assert "lamp_model" not in draw(scene).properties()


def test_one_kind_of_light_has_one_model(scene: bpy.types.Scene) -> None:
    scene.world = None
    assert composing.groups(scene.volillum) == ("sun",)
    assert draw(scene).properties()[0] == "model"
    assert "by_light" not in draw(scene).properties()


def test_the_menus_write_the_text_and_show_it(scene: bpy.types.Scene) -> None:
    settings = scene.volillum
    settings.model = "half_angle"  # knows no sky: it gets a model that does, without the camera
    settings.by_light = True
    assert settings.composition == "sun=half_angle,sky=spherical_harmonics"
    assert (settings.sun_model, settings.sky_model) == ("half_angle", "spherical_harmonics")
    settings.by_light = False
    settings.model = "directional_occlusion"  # knows both, and is kept
    settings.by_light = True
    assert settings.composition == "sun=directional_occlusion,sky=directional_occlusion"
    settings.sky_model = "spherical_harmonics"
    settings.model = "half_angle"
    settings.sun_model = "shadow_propagation"
    assert settings.composition == "sun=shadow_propagation,sky=spherical_harmonics"
    assert chosen_model(settings) == settings.composition
    settings.composition = f" {PAIR}"  # a script's, or the analysis's
    assert settings.by_light
    assert (settings.sun_model, settings.sky_model) == ("half_angle", "spherical_harmonics")
    settings.by_light = False
    assert settings.composition == ""
    assert chosen_model(settings) == "half_angle"
    assert draw(scene).properties()[:2] == ["model", "by_light"]


def test_what_is_left_out_or_unclear_is_said(scene: bpy.types.Scene) -> None:
    settings = scene.volillum
    add_lamp(scene)
    settings.composition = PAIR
    assert "leaves out lights of the kinds: point" in " ".join(draw(scene).labels())
    settings.sky_model = "NONE"
    with pytest.raises(InputError):
        chosen_model(settings)
    assert "number of parts is 1; expected at least 2" in " ".join(draw(scene).labels())
    settings.composition = "sun=half_angle,moon=half_angle"
    assert "'moon'" in " ".join(draw(scene).labels())
    settings.sky_model = "ambient_occlusion"
    assert settings.composition == "sun=half_angle,sky=ambient_occlusion"
    # Half angle knows no sky: the menu cannot show it, the panel says it.
    settings.composition = "sun=half_angle,sky=half_angle"
    assert settings.sky_model == "NONE"
    assert "the model of sky is half_angle" in " ".join(draw(scene).labels())


def test_menus_hold_the_models_that_know_the_light_and_explain_them(
    scene: bpy.types.Scene,
) -> None:
    for group, kinds in GROUPS.items():
        rna = scene.volillum.bl_rna.properties[composing.menu(group)]
        items = {item.identifier: item.description for item in rna.enum_items}
        wanted = {model.id: model.summary for model in models() if kinds & model.lights}
        assert items == {"NONE": composing.NONE[2], **wanted}
        assert rna.description


def test_what_the_menus_say_is_baked(scene: bpy.types.Scene) -> None:
    settings = scene.volillum
    settings.by_light = True
    settings.sun_model, settings.sky_model = "half_angle", "ambient_occlusion"
    settings.half_angle.directions = 8
    assert bpy.ops.volillum.bake() == {"FINISHED"}
    assert settings.baked.model == get("sun=half_angle,sky=ambient_occlusion").id
