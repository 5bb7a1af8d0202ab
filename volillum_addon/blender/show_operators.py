"""The operators that put something in the volume's place: bake, full scattering, errors, a row."""

from __future__ import annotations

from pathlib import Path
from typing import Any, override

import bpy

from ..bake.error_file import FieldError
from ..core.control import Control
from ..core.errors import InputError
from . import (
    error_display,
    exhibit_state,
    field_errors,
    live_session,
    modal,
    showing,
    side_by_side,
    work,
)
from .asked import Asked
from .jobs import Work
from .places import baked_file


class VOLILLUM_OT_show(modal.InstantOperator, bpy.types.Operator):
    """Show the last bake, under the lights as they are now, in place of the volume."""

    bl_idname = "volillum.show"
    bl_label = "Show"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012 - Blender's own form

    baked: bpy.props.BoolProperty(
        name="Baked",
        description="Show the bake; off: show the volume itself again",
        default=True,
        options={"SKIP_SAVE"},  # Show means the bake, whatever was pressed last
    )

    @override
    def perform(self, context: bpy.types.Context) -> str:
        """Swap the volume for its bake, or back."""
        scene = context.scene
        live_session.stop()
        if self.baked:
            showing.show(scene, _bake_of(scene))
        else:
            showing.hide(scene)
        return ""


class VOLILLUM_OT_scatter(modal.InstantOperator, bpy.types.Operator):
    """Switch between the bake and full scattering by Cycles, with as many bounces as it takes."""

    bl_idname = "volillum.scatter"
    bl_label = "Full scattering"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012

    @override
    def perform(self, context: bpy.types.Context) -> str:
        """From anything else to full scattering; from there to the bake, or without one to the
        volume as it was. The settings of Cycles come back as they were."""
        scene = context.scene
        live_session.stop()
        settings = scene.volillum
        if settings.stage.way != "SCATTERING":
            return showing.scatter(scene)
        if settings.baked.path:
            showing.show(scene, _bake_of(scene))
        else:
            showing.hide(scene)
        return ""


def _bake_of(scene: bpy.types.Scene) -> Path:
    if not scene.volillum.baked.path:
        raise InputError(f"scene {scene.name!r} has no bake; expected Bake before Show")
    return baked_file(scene)


class VOLILLUM_OT_swap(modal.InstantOperator, bpy.types.Operator):
    """Switch between the last two bakes."""

    bl_idname = "volillum.swap"
    bl_label = "A/B"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only with two bakes."""
        return bool(context.scene.volillum.other.path)

    @override
    def perform(self, context: bpy.types.Context) -> str:
        """Show the other one."""
        live_session.stop()
        side_by_side.swap(context.scene)
        return ""


class VOLILLUM_OT_side_by_side(modal.WorkOperator, bpy.types.Operator):
    """Bake every model that can serve the scene, and show all in a row with their names."""

    bl_idname = "volillum.side_by_side"
    bl_label = "All side by side"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012

    @override
    def prepare(self, context: bpy.types.Context) -> Work[Any]:
        """Read the scene once for all models."""
        scene = context.scene
        asked, reading = Asked.of(scene), work.read(scene)
        chosen = work.chosen_models(scene, work.all_models(scene.volillum))
        note = exhibit_state.noted(scene, chosen, self.bl_label)
        return Work(
            lambda control: work.bake_all(reading, chosen, asked.directory, control),
            lambda bakes: _arranged(asked, bakes, note),
        )


def _arranged(asked: Asked, bakes: work.Bakes, note: str) -> str:
    live_session.stop()
    side_by_side.arrange(asked.scene, bakes.done)
    asked.scene.volillum.row_of = exhibit_state.only(note, [each.model for each in bakes.done])
    return "; ".join([f"{len(bakes.done)} models side by side", *bakes.refused])


class VOLILLUM_OT_show_error(modal.WorkOperator, bpy.types.Operator):
    """Show in the volume how far the chosen model is from full scattering: blue is too dark, red
    too bright."""

    bl_idname = "volillum.show_error"
    bl_label = "Error in the volume"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012

    @override
    def prepare(self, context: bpy.types.Context) -> Work[Any]:
        """Read the scene; bake and reference know nothing of Blender."""
        asked = Asked.of(context.scene)
        return _errors(context.scene, (asked.model,), asked, self.bl_label)


class VOLILLUM_OT_error_row(modal.WorkOperator, bpy.types.Operator):
    """Show the errors of every model that can serve the scene in a row, all on one scale."""

    bl_idname = "volillum.error_row"
    bl_label = "All errors side by side"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012

    @override
    def prepare(self, context: bpy.types.Context) -> Work[Any]:
        """Read the scene once for all models."""
        models = work.all_models(context.scene.volillum)
        return _errors(context.scene, models, Asked.of(context.scene), self.bl_label)


def _errors(
    scene: bpy.types.Scene, models: tuple[str, ...], asked: Asked, button: str
) -> Work[Any]:
    reading, chosen = work.read(scene), work.chosen_models(scene, models)
    note = exhibit_state.noted(scene, chosen, button)
    wanted = field_errors.Wanted.of(scene)

    def compute(control: Control) -> tuple[work.Bakes, list[FieldError]]:
        return field_errors.measure(reading, chosen, wanted, asked.directory, control)

    def finish(found: tuple[work.Bakes, list[FieldError]]) -> str:
        bakes, errors = found
        live_session.stop()
        side_by_side.arrange_errors(asked.scene, bakes.done, errors)
        asked.scene.volillum.errors = error_display.summary(errors)
        asked.scene.volillum.errors_of = exhibit_state.only(note, [e.model for e in errors])
        return "; ".join([*asked.scene.volillum.errors.split("\n"), *bakes.refused])

    return Work(compute, finish)


class VOLILLUM_OT_clear_row(modal.InstantOperator, bpy.types.Operator):
    """Remove the row of models or errors and show the volume itself again."""

    bl_idname = "volillum.clear_row"
    bl_label = "Remove the row"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012

    @override
    def perform(self, context: bpy.types.Context) -> str:
        """Remove it."""
        showing.hide(context.scene)
        return ""


CLASSES = (
    VOLILLUM_OT_show,
    VOLILLUM_OT_scatter,
    VOLILLUM_OT_swap,
    VOLILLUM_OT_side_by_side,
    VOLILLUM_OT_show_error,
    VOLILLUM_OT_error_row,
    VOLILLUM_OT_clear_row,
)
