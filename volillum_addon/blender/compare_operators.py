"""The operator that compares models with Cycles' full scattering in images."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, override

import bpy

from ..compare.measure import Options
from ..core.control import Control
from . import child, comparing, modal, work
from .asked import Asked
from .jobs import Work


class VOLILLUM_OT_compare(modal.WorkOperator, bpy.types.Operator):
    """Measure the models' errors and times against Cycles' full scattering, as a report."""

    bl_idname = "volillum.compare"
    bl_label = "Compare"
    bl_options = {"REGISTER"}  # noqa: RUF012 - Blender's own form

    @override
    def prepare(self, context: bpy.types.Context) -> Work[Any]:
        """All in this process: Cycles renders in the main thread, where scripts run."""
        scene = context.scene
        settings, asked = scene.volillum, Asked.of(scene)

        def compute(control: Control) -> Path:
            options = Options(
                name=asked.name,
                noise=settings.noise / 100,
                seconds=settings.budget,
                published=settings.compare_published,
            )
            chosen = work.chosen_models(scene, _models(settings, asked))
            comparing.compare(scene, chosen, options, settings.width, asked.directory, control)
            return asked.directory / comparing.PAGE

        return Work(compute, lambda page: _keep_report(asked, page), estimates=True)

    @override
    def prepare_beside(self, context: bpy.types.Context) -> Work[Any]:
        """In a Blender of its own, on a copy of the file: the user goes on working, Cycles may take
        its minutes, Esc ends it at once, and nothing of it can touch the open file."""
        scene = context.scene
        settings, asked = scene.volillum, Asked.of(scene)
        copy = child.save_copy()
        arguments = [
            "compare", str(copy.file), "--scene", asked.name, "-o", str(asked.directory),
            "--noise", f"{settings.noise:g}", "--seconds", f"{settings.budget:g}",
            "--width", str(settings.width), "--models", ",".join(_models(settings, asked)),
        ]  # fmt: skip
        if settings.compare_published:
            arguments.append("--published")

        def compute(control: Control) -> Path:
            with copy:
                return Path(child.run(arguments, control)[-1])

        return Work(compute, lambda page: _keep_report(asked, page), estimates=True)


def _models(settings: Any, asked: Asked) -> tuple[str, ...]:
    return work.all_models(settings) if settings.compare_all else (asked.model,)


def _keep_report(asked: Asked, page: Path) -> str:
    report = json.loads(page.with_name("report.json").read_text(encoding="utf-8"))
    return work.keep_report(asked.scene, report, page)


CLASSES = (VOLILLUM_OT_compare,)
