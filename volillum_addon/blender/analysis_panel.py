"""The sidebar's analysis: what the scene needs, what is recommended, and taking it over."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any, override

import bpy

from ..compare.predict import predict
from ..compare.recommend import Request, recommended, usual
from ..core.control import Control
from ..core.errors import InputError
from ..models.composition import Composition
from ..models.registry import get
from . import modal, work, wrap
from .analysis_text import absent, answer_line, prediction_json, scene_lines
from .asked import Held
from .jobs import Work
from .sidebar import Sidebar, column, lines, progress_or_button


def kept(scene: bpy.types.Scene) -> Mapping[str, Any]:
    """What the last analysis said; empty before the first."""
    text = scene.volillum.analysis
    return json.loads(text) if text else {}


class VOLILLUM_OT_analyse(modal.WorkOperator, bpy.types.Operator):
    """Say what the scene needs, and foresee every model's time and error from a coarse run."""

    bl_idname = "volillum.analyse"
    bl_label = "Analyse"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012 - Blender's own form

    @override
    def prepare(self, context: bpy.types.Context) -> Work[Any]:
        """Read the scene; predicting knows nothing of Blender."""
        scene = context.scene
        settings, held = scene.volillum, Held(scene)
        reading = work.read(scene)
        reading.scene.need_camera()
        request = Request(
            settings.wanted_error / 100 if settings.wanted_error > 0 else None,
            settings.wanted_seconds or None,
        )

        def compute(control: Control) -> dict[str, Any]:
            found = predict(reading.scene, reading.width / reading.height, control)
            asked = request != Request()
            answers = [(request, recommended(found.entries, request))] if asked else usual(found)
            return {
                "scene": scene_lines(reading.stem, found.analysis),
                "absent": list(absent(found.analysis)),
                "answers": [
                    {
                        "line": answer_line(each, answer),
                        "use": None if answer is None else prediction_json(answer),
                    }
                    for each, answer in answers
                ],
            }

        def keep(result: dict[str, Any]) -> str:
            held.get().volillum.analysis = json.dumps(result)
            return str(result["answers"][0]["line"])

        return Work(compute, keep)


class VOLILLUM_OT_use(modal.InstantOperator, bpy.types.Operator):
    """Set the recommended model and its parameters."""

    bl_idname = "volillum.use"
    bl_label = "Use it"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012

    index: bpy.props.IntProperty(name="Answer", default=0, min=0, options={"SKIP_SAVE"})

    @override
    def perform(self, context: bpy.types.Context) -> str:
        """The parameters that the answer does not name stay as they are."""
        answers = kept(context.scene).get("answers", [])
        if self.index >= len(answers) or answers[self.index]["use"] is None:
            raise InputError(f"there is no answer {self.index} to use; expected one of Analyse")
        take_over(context.scene.volillum, answers[self.index]["use"])
        return ""


def take_over(settings: Any, answer: Mapping[str, Any]) -> None:
    """Set model, or composition, and parameters. Raises InputError."""
    chosen = get(answer["model"])
    values = chosen.values(answer["parameters"])
    given = {name: values[name] for name in answer["parameters"]}
    if not isinstance(chosen, Composition):
        settings.model, settings.composition = chosen.id, ""
        _set(getattr(settings, chosen.id), given)
        return
    settings.composition = chosen.id
    for part in chosen.parts:
        _set(getattr(settings, part.model.id), part.values(given))


def _set(group: bpy.types.PropertyGroup, values: Mapping[str, Any]) -> None:
    for name, value in values.items():
        setattr(group, name, value)


class VOLILLUM_PT_analysis(Sidebar, bpy.types.Panel):
    """What to bake for this scene."""

    bl_label = "What to bake"
    bl_options = {"DEFAULT_CLOSED"}  # noqa: RUF012

    def draw(self, context: bpy.types.Context) -> None:
        """The request, the button, the answers, and what the scene has and lacks."""
        layout = column(self.layout)
        settings = context.scene.volillum
        room = wrap.room(context)
        for name in ("wanted_error", "wanted_seconds"):
            layout.prop(settings, name)
        progress_or_button(layout, "volillum.analyse", "VIEWZOOM")
        found = kept(context.scene)
        for index, answer in enumerate(found.get("answers", ())):
            box = layout.box()
            lines(box, answer["line"], room - wrap.BOX, "INFO")
            if answer["use"] is not None:
                box.operator("volillum.use", icon="CHECKMARK").index = index
        if not found:
            return
        header, body = layout.panel("volillum_analysis", default_closed=True)
        header.label(text="What the scene holds")
        if body is not None:
            for line in found["scene"]:
                lines(body, line.strip(), room)
            for line in found["absent"]:
                lines(body, f"absent: {line}", room, "X")


CLASSES = (VOLILLUM_OT_analyse, VOLILLUM_OT_use, VOLILLUM_PT_analysis)
