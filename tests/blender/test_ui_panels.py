"""Every panel draws, in every state, with names that live RNA knows."""

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import bpy
import pytest
from recording_layout import RecordingLayout

from volillum_addon.blender import compare_panel, modal, panels
from volillum_addon.blender.jobs import Job, Work
from volillum_addon.models.model import Model
from volillum_addon.models.registry import MODELS, get, models

CLASSES = (*panels.CLASSES, *compare_panel.CLASSES)


def draw(panel: type, scene: bpy.types.Scene) -> RecordingLayout:
    layout = RecordingLayout()
    panel.draw(SimpleNamespace(layout=layout), SimpleNamespace(scene=scene))
    assert layout.log
    return layout


def all_drawn(scene: bpy.types.Scene) -> dict[type, RecordingLayout]:
    return {panel: draw(panel, scene) for panel in CLASSES}


def test_panels_live_in_the_sidebar_of_the_3d_view() -> None:
    for panel in CLASSES:
        assert (panel.bl_space_type, panel.bl_region_type) == ("VIEW_3D", "UI")
        assert panel.bl_category == "Volillum"


def test_a_fresh_scene(scene: bpy.types.Scene) -> None:
    drawn = all_drawn(scene)
    assert "volillum.bake" in drawn[panels.VOLILLUM_PT_bake].operators()
    assert "volillum.compare" in drawn[compare_panel.VOLILLUM_PT_compare].operators()
    assert "plume, the only one" in drawn[panels.VOLILLUM_PT_volume].labels()
    # The preset gives the volume a material, so there is nothing to say about its density.
    assert "density_scale" not in drawn[panels.VOLILLUM_PT_volume].properties()


@pytest.mark.usefixtures("extension")
def test_a_scene_without_a_volume() -> None:
    scene = bpy.data.scenes.new("bare")
    try:
        drawn = all_drawn(scene)
        assert "Choose the volume to light" in drawn[panels.VOLILLUM_PT_volume].labels()
    finally:
        bpy.data.scenes.remove(scene)


def test_a_volume_without_a_material(scene: bpy.types.Scene) -> None:
    next(each for each in scene.objects if each.type == "VOLUME").data.materials.clear()
    layout = draw(panels.VOLILLUM_PT_volume, scene)
    assert {"density_scale", "albedo"} <= set(layout.properties())


@pytest.mark.parametrize("model", models(), ids=MODELS)
def test_every_models_parameters_are_shown(scene: bpy.types.Scene, model: Model) -> None:
    scene.volillum.model = model.id
    layout = draw(panels.VOLILLUM_PT_model, scene)
    assert layout.properties() == ["model", "by_light", *(p.name for p in model.parameters)]
    text = " ".join(layout.labels())
    assert model.summary in text
    for need in model.needs:
        assert f"{need.treatment} {need.feature}: {need.reason}" in text


def test_a_composition_takes_the_models_place(scene: bpy.types.Scene) -> None:
    scene.volillum.composition = "sun=half_angle,sky=spherical_harmonics"
    layout = draw(panels.VOLILLUM_PT_model, scene)
    parts = [parameter.name for id_ in ("half_angle", "spherical_harmonics")
             for parameter in get(id_).parameters]  # fmt: skip
    assert layout.properties() == ["sun_model", "sky_model", "by_light", *parts]
    assert "Sun: Half angle" in layout.labels()
    scene.volillum.composition = "sun=half_angle,lamp=half_angle"
    layout = draw(panels.VOLILLUM_PT_model, scene)
    assert "Sun and lamp: Half angle" in layout.labels()
    assert layout.properties().count("theta") == 1
    scene.volillum.composition = "sun=half_angle,moon=half_angle"
    assert "'moon'" in " ".join(draw(panels.VOLILLUM_PT_model, scene).labels())


def test_what_a_model_leaves_out_of_this_scene_is_said(scene: bpy.types.Scene) -> None:
    scene.volillum.model = "multidirectional_occlusion"
    text = " ".join(draw(panels.VOLILLUM_PT_model, scene).labels())
    assert "leaves out lights of the kinds: environment" in text
    sun = next(each for each in scene.objects if each.type == "LIGHT")
    bpy.data.objects.remove(sun)
    text = " ".join(draw(panels.VOLILLUM_PT_model, scene).labels())
    assert "the scene has environment" in text


def test_results_and_their_report_are_shown(scene: bpy.types.Scene) -> None:
    settings = scene.volillum
    settings.report = "report.html"
    for error, noise, reason in ((0.123, 0.004, ""), (0.001, 0.004, ""), (-1, -1, "no sun")):
        line = settings.results.add()
        line.error, line.noise, line.reason, line.seconds = error, noise, reason, 1.5
        line.model = "sun=half_angle,sky=spherical_harmonics"
    layout = draw(compare_panel.VOLILLUM_PT_compare, scene)
    labels = layout.labels()
    assert "12.3 ± 0.4 %" in labels
    assert "< 0.4 %" in labels
    assert "no sun" in labels
    assert get("sun=half_angle,sky=spherical_harmonics").label in labels
    assert "wm.path_open" in layout.operators()


def test_a_running_job_shows_its_progress(
    scene: bpy.types.Scene,
    monkeypatch: pytest.MonkeyPatch,
    start_job: Callable[[Work[Any]], Job[Any]],
) -> None:
    job = start_job(Work(lambda _control: None, lambda _result: ""))
    job.label = "Bake"
    monkeypatch.setattr(modal, "_current", job)
    layout = draw(panels.VOLILLUM_PT_bake, scene)
    assert [name for name, _ in layout.log if name == "progress"] == ["progress"]
    assert "volillum.cancel" in layout.operators()
    assert "volillum.bake" not in layout.operators()
    assert "volillum.compare" in draw(compare_panel.VOLILLUM_PT_compare, scene).operators()


def test_a_file_that_is_read_shows_its_progress(
    scene: bpy.types.Scene,
    monkeypatch: pytest.MonkeyPatch,
    start_job: Callable[[Work[Any]], Job[Any]],
) -> None:
    assert "progress" not in [name for name, _ in draw(panels.VOLILLUM_PT_volume, scene).log]
    job = start_job(Work(lambda _control: None, lambda _result: ""))
    job.label = "Import volume"
    monkeypatch.setattr(modal, "_current", job)
    layout = draw(panels.VOLILLUM_PT_volume, scene)
    assert [name for name, _ in layout.log if name == "progress"] == ["progress"]
    assert "volillum.cancel" in layout.operators()


def test_lights_that_changed_are_to_be_shown_anew(scene: bpy.types.Scene) -> None:
    settings = scene.volillum
    settings.model = "spherical_harmonics"
    settings.spherical_harmonics.directions = 8
    bpy.ops.volillum.bake()
    relights = "The lights have changed: Baked, beside Scattering, relights"

    def said() -> str:
        return " ".join(draw(panels.VOLILLUM_PT_bake, scene).labels())

    sun = next(each for each in scene.objects if each.type == "LIGHT")
    sun.data.energy *= 2
    assert relights not in said()  # nothing is shown yet
    bpy.ops.volillum.show()
    assert relights not in said()
    sun.data.energy *= 2
    assert relights in said()
    bpy.ops.volillum.show()
    assert relights not in said()
    background = next(n for n in scene.world.node_tree.nodes if "Strength" in n.inputs)
    background.inputs["Strength"].default_value *= 2
    assert relights in said()
    bpy.ops.volillum.show()
    settings.spherical_harmonics.directions = 10
    bpy.ops.volillum.bake()
    assert "An older bake is shown" in said()


def test_a_narrow_sidebar_wraps_more(scene: bpy.types.Scene) -> None:
    def summary(width: int) -> list[str]:
        layout = RecordingLayout()
        region = SimpleNamespace(width=width)
        panels.VOLILLUM_PT_model.draw(
            SimpleNamespace(layout=layout), SimpleNamespace(scene=scene, region=region)
        )
        return layout.labels()

    assert len(summary(180)) > len(summary(292)) > len(summary(600))
    assert " ".join(summary(180)) == " ".join(summary(600))


def test_the_recording_layout_notices_wrong_names(scene: bpy.types.Scene) -> None:
    layout = RecordingLayout()
    wrong: list[Callable[[], object]] = [
        lambda: layout.lable(text="x"),
        lambda: layout.label(text="x", icon="NO_SUCH_ICON"),
        lambda: layout.label(txt="x"),
        lambda: layout.prop(scene, "no_such_property"),
        lambda: setattr(layout.operator("volillum.show"), "bakd", True),
        lambda: setattr(layout.row(), "scale_q", 1.0),
        lambda: layout.operator("volillum.no_such_operator"),
    ]
    for call in wrong:
        with pytest.raises((AssertionError, KeyError, AttributeError)):
            call()


def test_a_view_that_cannot_show_scattering_says_so() -> None:
    assert "Rendered" in panels.unseen("SCATTERING", "MATERIAL")
    assert panels.unseen("SCATTERING", "RENDERED") == ""
    assert panels.unseen("SCATTERING", None) == ""
    assert panels.unseen("BAKE", "MATERIAL") == ""
