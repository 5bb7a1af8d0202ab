"""The operators that bake: thin shells around `work`."""

from __future__ import annotations

import json
from typing import Any, override

import bpy

from ..core.control import Control
from . import animation, child, modal, work
from .asked import Asked
from .jobs import Work


class VOLILLUM_OT_bake(modal.WorkOperator, bpy.types.Operator):
    """Bake the chosen model's illumination of the volume into a VDB file."""

    bl_idname = "volillum.bake"
    bl_label = "Bake"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012 - Blender's own form

    @override
    def prepare(self, context: bpy.types.Context) -> Work[Any]:
        """Read the scene; the bake itself knows nothing of Blender."""
        scene = context.scene
        asked, source, reading = Asked.of(scene), work.noted_source(scene), work.read_to_bake(scene)
        return Work(
            lambda control: work.bake(
                reading, asked.model, asked.values, asked.directory, control
            ),
            lambda baked: work.keep(asked.scene, baked, source),
        )  # fmt: skip


class VOLILLUM_OT_bake_frames(modal.WorkOperator, bpy.types.Operator):
    """Bake every frame of the scene's range into a sequence that plays in sync."""

    bl_idname = "volillum.bake_frames"
    bl_label = "Bake animation"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012

    @override
    def prepare(self, context: bpy.types.Context) -> Work[Any]:
        """All in this process: reading a frame moves the scene there, in the main thread."""
        scene = context.scene
        asked, source = Asked.of(scene), work.noted_source(scene)
        frames = range(scene.frame_start, scene.frame_end + 1)

        def compute(control: Control) -> list[dict[str, Any]]:
            baked = animation.bake(
                scene, asked.model, asked.values, frames, asked.directory, control
            )
            return [animation.described(frame) for frame in baked]

        return Work(compute, lambda found: work.keep_frames(asked.scene, found, source))

    @override
    def prepare_beside(self, context: bpy.types.Context) -> Work[Any]:
        """In a Blender of its own, on a copy of the file: the user's own frame stays."""
        scene = context.scene
        asked, source = Asked.of(scene), work.noted_source(scene)
        copy = child.save_copy()
        arguments = [
            "bake", str(copy.file), "--scene", asked.name, "-o", str(asked.directory),
            "--model", asked.model, "--frames", f"{scene.frame_start}-{scene.frame_end}",
        ]  # fmt: skip

        def compute(control: Control) -> list[dict[str, Any]]:
            with copy:
                # A real Blender says hello on the same channel.
                lines = child.run(arguments, control)
                return [json.loads(line) for line in lines if line.startswith("{")]

        return Work(compute, lambda found: work.keep_frames(asked.scene, found, source))


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


CLASSES = (VOLILLUM_OT_bake, VOLILLUM_OT_bake_frames, VOLILLUM_OT_cancel)
