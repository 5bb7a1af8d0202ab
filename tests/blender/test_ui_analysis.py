"""The analysis in the sidebar: asking, answering, taking over."""

import json
from types import SimpleNamespace

import bpy
import pytest
from recording_layout import RecordingLayout

from volillum_addon.blender import analysis_panel
from volillum_addon.blender.properties import chosen_model, model_values

PAIR = "sun=multidirectional_occlusion,sky=spherical_harmonics"


def draw(scene: bpy.types.Scene) -> RecordingLayout:
    layout = RecordingLayout()
    shell = SimpleNamespace(layout=layout)
    analysis_panel.VOLILLUM_PT_analysis.draw(shell, SimpleNamespace(scene=scene))
    return layout


def answered(scene: bpy.types.Scene, model: str, **parameters: object) -> None:
    use = {"model": model, "parameters": parameters}
    scene.volillum.analysis = json.dumps(
        {"scene": ["plume: 8 voxels"], "absent": ["emission"],
         "answers": [{"line": "for 5 %: this", "use": use}, {"line": "unreachable", "use": None}]}
    )  # fmt: skip


def test_a_fresh_scene_offers_the_analysis_alone(scene: bpy.types.Scene) -> None:
    layout = draw(scene)
    assert "volillum.analyse" in layout.operators()
    assert "volillum.use" not in layout.operators()


def test_answers_are_shown_and_taken_over(scene: bpy.types.Scene) -> None:
    answered(scene, "half_angle", directions=24, spacing=1.5)
    layout = draw(scene)
    text = " ".join(layout.labels())
    assert "for 5 %: this" in text
    assert "absent: emission" in text
    assert layout.operators().count("volillum.use") == 1
    before = scene.volillum.half_angle.near
    assert bpy.ops.volillum.use(index=0) == {"FINISHED"}
    assert chosen_model(scene.volillum) == "half_angle"
    values = model_values(scene.volillum, "half_angle")
    assert (values["directions"], values["spacing"], values["near"]) == (24, 1.5, before)


def test_a_composition_is_taken_over_and_baked(scene: bpy.types.Scene) -> None:
    answered(scene, PAIR, sun_directions=8, sun_near=0, sky_directions=8, sky_near=0)
    bpy.ops.volillum.use(index=0)
    assert chosen_model(scene.volillum) == PAIR
    values = model_values(scene.volillum, PAIR)
    assert (values["sun_directions"], values["sky_near"]) == (8, 0)
    bpy.ops.volillum.bake()
    assert scene.volillum.baked.model == PAIR
    bpy.ops.volillum.show()
    assert scene.volillum.baked.shown is not None


def test_there_has_to_be_an_answer(scene: bpy.types.Scene) -> None:
    with pytest.raises(RuntimeError, match="no answer 0"):
        bpy.ops.volillum.use(index=0)
    answered(scene, PAIR)
    with pytest.raises(RuntimeError, match="no answer 1"):
        bpy.ops.volillum.use(index=1)


def test_a_bad_composition_is_refused_in_words(scene: bpy.types.Scene) -> None:
    scene.volillum.composition = "sun=half_angle,moon=half_angle"
    with pytest.raises(RuntimeError, match="'moon'"):
        bpy.ops.volillum.bake()
