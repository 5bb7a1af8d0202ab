"""The operators: thin shells around `work`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, override

import bpy

from ..compare.measure import Options
from ..core.control import Control
from ..core.errors import InputError
from . import animation, child, comparing, live_session, modal, side_by_side, work
from .failures import EXPECTED, one_line
from .jobs import Work
from .places import output_directory
from .properties import chosen_model, model_values


def _scene(name: str) -> bpy.types.Scene:
    """The scene of a job that has ended; it may have been removed meanwhile."""
    scene = bpy.data.scenes.get(name)
    if scene is None:
        raise InputError(f"scene {name!r} is gone; expected it where the result belongs")
    return scene


class VOLILLUM_OT_bake(modal.WorkOperator, bpy.types.Operator):
    """Bake the chosen model's illumination of the volume into a VDB file."""

    bl_idname = "volillum.bake"
    bl_label = "Bake"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012 - Blender's own form

    @override
    def prepare(self, context: bpy.types.Context) -> Work[Any]:
        """Read the scene; the bake itself knows nothing of Blender."""
        scene = context.scene
        settings = scene.volillum
        name, model = scene.name, chosen_model(settings)
        source, reading = work.noted_source(scene), work.read(scene)
        values = model_values(settings, model)
        directory = output_directory(settings.directory)
        return Work(
            lambda control: work.bake(reading, model, values, directory, control),
            lambda baked: work.keep(_scene(name), baked, source),
        )


class VOLILLUM_OT_bake_frames(modal.WorkOperator, bpy.types.Operator):
    """Bake every frame of the scene's range into a sequence that plays in sync."""

    bl_idname = "volillum.bake_frames"
    bl_label = "Bake animation"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012

    @override
    def prepare(self, context: bpy.types.Context) -> Work[Any]:
        """All in this process: reading a frame moves the scene there, in the main thread."""
        scene = context.scene
        settings, name = scene.volillum, scene.name
        source = work.noted_source(scene)
        model = chosen_model(settings)
        values = model_values(settings, model)
        directory = output_directory(settings.directory)
        frames = range(scene.frame_start, scene.frame_end + 1)

        def compute(control: Control) -> list[dict[str, Any]]:
            baked = animation.bake(scene, model, values, frames, directory, control)
            return [animation.described(frame) for frame in baked]

        return Work(compute, lambda found: work.keep_frames(_scene(name), found, source))

    @override
    def prepare_beside(self, context: bpy.types.Context) -> Work[Any]:
        """In a Blender of its own, on a copy of the file: the user's own frame stays."""
        scene = context.scene
        settings, name = scene.volillum, scene.name
        source = work.noted_source(scene)
        directory = output_directory(settings.directory)
        copy = child.save_copy()
        arguments = [
            "bake", str(copy.file), "--scene", name, "-o", str(directory),
            "--model", chosen_model(settings), "--frames", f"{scene.frame_start}-{scene.frame_end}",
        ]  # fmt: skip

        def compute(control: Control) -> list[dict[str, Any]]:
            with copy:
                # A real Blender says hello on the same channel.
                lines = child.run(arguments, control)
                return [json.loads(line) for line in lines if line.startswith("{")]

        return Work(compute, lambda found: work.keep_frames(_scene(name), found, source))


class VOLILLUM_OT_show(bpy.types.Operator):
    """Show the last bake, under the lights as they are now, in place of the volume."""

    bl_idname = "volillum.show"
    bl_label = "Show"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012

    baked: bpy.props.BoolProperty(
        name="Baked",
        description="Show the bake; off: show the volume itself again",
        default=True,
        options={"SKIP_SAVE"},  # Show means the bake, whatever was pressed last
    )

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Swap the volume for its bake, or back."""
        scene = context.scene
        path = scene.volillum.baked.path
        try:
            live_session.stop()
            if not self.baked:
                work.hide(scene)
                return {"FINISHED"}
            if not path:
                raise InputError(f"scene {scene.name!r} has no bake; expected Bake before Show")
            work.show(scene, Path(bpy.path.abspath(path)))
        except EXPECTED as error:
            self.report({"ERROR"}, one_line(error))
            return {"CANCELLED"}
        return {"FINISHED"}


class VOLILLUM_OT_side_by_side(modal.WorkOperator, bpy.types.Operator):
    """Bake every model that can serve the scene, and show all in a row with their names."""

    bl_idname = "volillum.side_by_side"
    bl_label = "All side by side"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012

    @override
    def prepare(self, context: bpy.types.Context) -> Work[Any]:
        """Read the scene once for all models."""
        scene = context.scene
        name, reading = scene.name, work.read(scene)
        directory = output_directory(scene.volillum.directory)
        chosen = work.chosen_models(scene, ())
        return Work(
            lambda control: work.bake_all(reading, chosen, directory, control),
            lambda bakes: _arranged(_scene(name), bakes),
        )


def _arranged(scene: bpy.types.Scene, bakes: work.Bakes) -> str:
    side_by_side.arrange(scene, bakes.done)
    refused = "".join(f"; {reason}" for reason in bakes.refused)
    return f"{len(bakes.done)} models side by side{refused}"


class VOLILLUM_OT_clear_row(bpy.types.Operator):
    """Remove the row of models and show the volume itself again."""

    bl_idname = "volillum.clear_row"
    bl_label = "Remove the row"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Remove it."""
        side_by_side.clear(context.scene)
        return {"FINISHED"}


class VOLILLUM_OT_swap(bpy.types.Operator):
    """Switch between the last two bakes."""

    bl_idname = "volillum.swap"
    bl_label = "A/B"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only with two bakes."""
        return bool(context.scene.volillum.other.path)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Show the other one."""
        live_session.stop()
        try:
            side_by_side.swap(context.scene)
        except EXPECTED as error:
            self.report({"ERROR"}, one_line(error))
            return {"CANCELLED"}
        return {"FINISHED"}


class VOLILLUM_OT_compare(modal.WorkOperator, bpy.types.Operator):
    """Measure the models' errors and times against Cycles' full scattering, as a report."""

    bl_idname = "volillum.compare"
    bl_label = "Compare"
    bl_options = {"REGISTER"}  # noqa: RUF012

    @override
    def prepare(self, context: bpy.types.Context) -> Work[Any]:
        """All in this process: Cycles renders in the main thread, where scripts run."""
        scene = context.scene
        settings, name = scene.volillum, scene.name
        directory = output_directory(settings.directory)
        models = () if settings.compare_all else (chosen_model(settings),)

        def compute(control: Control) -> Path:
            options = Options(
                name=name,
                noise=settings.noise / 100,
                seconds=settings.budget,
                published=settings.compare_published,
            )
            chosen = work.chosen_models(scene, models)
            comparing.compare(scene, chosen, options, settings.width, directory, control)
            return directory / comparing.PAGE

        return Work(compute, lambda page: _keep_report(name, page), estimates=True)

    @override
    def prepare_beside(self, context: bpy.types.Context) -> Work[Any]:
        """In a Blender of its own, on a copy of the file: the user goes on working, Cycles may take
        its minutes, Esc ends it at once, and nothing of it can touch the open file."""
        scene = context.scene
        settings, name = scene.volillum, scene.name
        directory = output_directory(settings.directory)
        copy = child.save_copy()
        arguments = [
            "compare", str(copy.file), "--scene", name, "-o", str(directory),
            "--noise", f"{settings.noise:g}", "--seconds", f"{settings.budget:g}",
            "--width", str(settings.width),
        ]  # fmt: skip
        if not settings.compare_all:
            arguments += ["--models", chosen_model(settings)]
        if settings.compare_published:
            arguments.append("--published")

        def compute(control: Control) -> Path:
            with copy:
                return Path(child.run(arguments, control)[-1])

        return Work(compute, lambda page: _keep_report(name, page), estimates=True)


def _keep_report(name: str, page: Path) -> str:
    report = json.loads(page.with_name("report.json").read_text(encoding="utf-8"))
    return work.keep_report(_scene(name), report, page)


class VOLILLUM_OT_cancel(bpy.types.Operator):
    """Stop the work that is running; the last good result stays."""

    bl_idname = "volillum.cancel"
    bl_label = "Cancel"

    @classmethod
    def poll(cls, _context: bpy.types.Context) -> bool:
        """Only while something runs."""
        return modal.current() is not None

    def execute(self, _context: bpy.types.Context) -> set[str]:
        """The job ends at its next poll."""
        modal.stop()
        return {"FINISHED"}


CLASSES = (
    VOLILLUM_OT_bake,
    VOLILLUM_OT_bake_frames,
    VOLILLUM_OT_show,
    VOLILLUM_OT_swap,
    VOLILLUM_OT_side_by_side,
    VOLILLUM_OT_clear_row,
    VOLILLUM_OT_compare,
    VOLILLUM_OT_cancel,
)
