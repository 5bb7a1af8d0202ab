"""Errors and rows do not follow the scene by themselves, and the panel says so."""

from __future__ import annotations

from types import SimpleNamespace

import bpy
import pytest
from mathutils import Matrix
from recording_layout import RecordingLayout

from volillum_addon.blender import compare_panel, panels
from volillum_addon.models.registry import MODELS

pytestmark = pytest.mark.usefixtures("quick_models")


def said(scene: bpy.types.Scene, panel: type = panels.VOLILLUM_PT_bake) -> str:
    layout = RecordingLayout()
    panel.draw(SimpleNamespace(layout=layout), SimpleNamespace(scene=scene))
    return " ".join(layout.labels())


def light(scene: bpy.types.Scene) -> bpy.types.Light:
    return next(each.data for each in scene.objects if each.type == "LIGHT")


def test_an_error_is_stale_by_whatever_it_depends_on(scene: bpy.types.Scene) -> None:
    settings, again = scene.volillum, "Stale: press Error in the volume again"
    assert bpy.ops.volillum.show_error() == {"FINISHED"}

    def check(change: str) -> None:
        for panel in (panels.VOLILLUM_PT_bake, compare_panel.VOLILLUM_PT_compare):
            text = said(scene, panel)
            assert again in text
            assert change in text

    def assert_fresh() -> None:
        for panel in (panels.VOLILLUM_PT_bake, compare_panel.VOLILLUM_PT_compare):
            assert "Stale" not in said(scene, panel)

    assert_fresh()
    before = light(scene).energy
    light(scene).energy *= 2  # the sun alone, beside the sky
    check("the light has changed")
    light(scene).energy = before
    assert_fresh()
    group = settings.multidirectional_occlusion
    group.directions = 12
    check("Multidirectional occlusion: directions was 8, is 12")
    group.directions = 8
    settings.model = "half_angle"
    check("Half angle is not in it")
    settings.model = "multidirectional_occlusion"
    settings.error_limit = 50
    check("full colour was at 100 %, is at 50 %")
    settings.error_limit = 100
    # This medium is isotropic, and this model does not see the camera.
    scene.camera.location[0] += 1
    scene.view_layers[0].update()
    assert_fresh()
    # It is hidden, and Blender does not evaluate what is hidden.
    scene.objects["plume"].matrix_world = Matrix.Translation((0.5, 0, 0))
    check("the volume's place has changed")


def test_a_new_bake_leaves_an_old_error_stale_until_it_is_made_again(
    scene: bpy.types.Scene,
) -> None:
    settings = scene.volillum
    bpy.ops.volillum.show_error()
    settings.multidirectional_occlusion.directions = 12
    bpy.ops.volillum.bake()
    assert settings.stage.way == "ERROR"
    assert "Stale: press Error in the volume again" in said(scene)
    assert "Stale: bake again" not in said(scene)
    bpy.ops.volillum.show_error()
    assert "Stale" not in said(scene)
    # The figures stay when the view is taken away, and are still said to be old.
    bpy.ops.volillum.clear_row()
    settings.multidirectional_occlusion.directions = 8
    assert "Stale" in said(scene, compare_panel.VOLILLUM_PT_compare)
    assert "press Error" not in said(scene)


def test_a_row_of_errors_knows_every_model_in_it(scene: bpy.types.Scene) -> None:
    settings, again = scene.volillum, "Stale: press All errors side by side again"
    assert bpy.ops.volillum.error_row() == {"FINISHED"}
    assert "Stale" not in said(scene)
    settings.model = "half_angle"  # all are there already
    assert "Stale" not in said(scene)
    settings.spherical_harmonics.order = 2
    assert "Spherical harmonic lighting: order was 3, is 2" in said(scene)
    assert again in said(scene)
    settings.spherical_harmonics.property_unset("order")
    # One of them looks from the camera.
    before = scene.camera.location.copy()
    scene.camera.location[0] += 1
    scene.view_layers[0].update()
    assert "the camera has changed" in said(scene)
    scene.camera.location = before
    scene.view_layers[0].update()
    assert "Stale" not in said(scene)
    settings.composition = "sun=half_angle,sky=spherical_harmonics"
    assert "sun by half angle, sky by spherical harmonic lighting" in said(scene)
    assert "is not in it" in said(scene)
    settings.composition = "moon=half_angle,sky=spherical_harmonics"
    assert "moon" in said(scene)


def test_a_row_of_models_is_stale_too(scene: bpy.types.Scene) -> None:
    settings = scene.volillum
    assert bpy.ops.volillum.side_by_side() == {"FINISHED"}
    assert "press All" not in said(scene)
    settings.error_limit = 50  # is no matter of bakes
    assert "press All" not in said(scene)
    light(scene).energy *= 2
    assert "Stale: press All side by side again" in said(scene)
    bpy.ops.volillum.side_by_side()
    assert "press All" not in said(scene)


def test_models_that_cannot_serve_are_not_asked_for(scene: bpy.types.Scene) -> None:
    for each in scene.objects:
        if each.type == "LIGHT":
            each.hide_render = True
    assert bpy.ops.volillum.error_row() == {"FINISHED"}
    shown = [each for each in scene.volillum.exhibit.objects if each.type == "VOLUME"]
    assert len(shown) < len(MODELS)
    scene.volillum.half_angle.directions = 12  # it knows no sky
    assert "Stale" not in said(scene)
