"""The sidebar of the 3D view: what to bake, the bake, how it fares, what is stale."""

from __future__ import annotations

import bpy

from ..core.errors import InputError
from ..models.illuminate import left_out
from ..models.model import Model
from ..models.registry import get
from . import modal, staleness, work
from .medium_reader import volume_material
from .outline import outline

CATEGORY = "Volillum"


class _Sidebar:
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = CATEGORY


class VOLILLUM_PT_volume(_Sidebar, bpy.types.Panel):
    """The volume that is lit."""

    bl_label = "Volume"

    def draw(self, context: bpy.types.Context) -> None:
        """Volume, density grid and, where the volume has no material, how dense it is."""
        layout = _column(self.layout)
        settings = context.scene.volillum
        volume = work.chosen_volume(context.scene)
        layout.prop(settings, "volume")
        if volume is None:
            layout.label(text="Choose the volume to light", icon="INFO")
            return
        if settings.volume is None:
            layout.label(text=f"{volume.name}, the only one", icon="OUTLINER_OB_VOLUME")
        layout.prop(settings, "density_grid", placeholder="density")
        if volume_material(volume) is None:
            layout.prop(settings, "density_scale")
            layout.prop(settings, "albedo")


class VOLILLUM_PT_model(_Sidebar, bpy.types.Panel):
    """The model and its parameters."""

    bl_label = "Model"

    def draw(self, context: bpy.types.Context) -> None:
        """The choice, its one-line summary, every parameter, and what it leaves out."""
        layout = _column(self.layout)
        settings = context.scene.volillum
        model = get(settings.model)
        layout.prop(settings, "model", text="")
        _lines(layout, model.summary)
        group = getattr(settings, model.id)
        for parameter in model.parameters:
            layout.prop(group, parameter.name)
        _left_out(layout, context.scene, model)
        header, body = layout.panel("volillum_needs", default_closed=True)
        header.label(text="What it neglects")
        if body is not None:
            _needs(body, model)


class VOLILLUM_PT_bake(_Sidebar, bpy.types.Panel):
    """Bake and show, and what has come of it."""

    bl_label = "Bake"

    def draw(self, context: bpy.types.Context) -> None:
        """Buttons, progress, the last bake, and what has changed since."""
        layout = _column(self.layout)
        scene = context.scene
        settings = scene.volillum
        layout.prop(settings, "directory")
        _progress_or_button(layout, "volillum.bake", "RENDER_STILL")
        row = layout.row(align=True)
        row.enabled = bool(settings.baked.path)
        row.operator("volillum.show", icon="HIDE_OFF").baked = True
        row.operator("volillum.show", text="Show the volume", icon="VOLUME_DATA").baked = False
        baked = settings.baked
        if not baked.path:
            return
        box = layout.box()
        how = "found on disk" if baked.found else "baked"
        box.label(text=f"{get(baked.model).label}, {how}", icon="CHECKMARK")
        box.label(text=f"{baked.seconds:.2f} s to bake and write", icon="TIME")
        for note in filter(None, baked.notes.split("\n")):
            _lines(box, note, "INFO")
        changes = staleness.changes(scene, work.chosen_volume(scene))
        if changes:
            stale = box.column(align=True)
            stale.alert = True
            stale.label(text="Stale: bake again", icon="ERROR")
            for change in changes:
                _lines(stale, change)


class VOLILLUM_PT_compare(_Sidebar, bpy.types.Panel):
    """Errors and times against full scattering."""

    bl_label = "Compare"
    bl_options = {"DEFAULT_CLOSED"}  # noqa: RUF012 - Blender's own form

    def draw(self, context: bpy.types.Context) -> None:
        """What to compare, the button, and the figures of the last comparison."""
        layout = _column(self.layout)
        settings = context.scene.volillum
        for name in ("compare_all", "width", "noise", "budget"):
            layout.prop(settings, name)
        _progress_or_button(layout, "volillum.compare", "SORTTIME")
        if not settings.results:
            return
        box = layout.box()
        for result in settings.results:
            row = box.row()
            row.label(text=get(result.model).label)
            if result.error < 0:
                _lines(box, result.reason or "not measured", "INFO")
                continue
            row.label(text=f"{result.seconds:.2f} s")
            row.label(text=error_text(result.error, result.noise))
        box.operator("wm.path_open", text="Open the report", icon="URL").filepath = settings.report


def error_text(error: float, noise: float) -> str:
    """A relative error with its noise in percent; below its noise only a bound."""
    if error <= noise:
        return f"< {100 * max(error, noise):.2g} %"
    return f"{100 * error:.3g} ± {100 * noise:.1g} %"


def _column(layout: bpy.types.UILayout) -> bpy.types.UILayout:
    layout.use_property_split = True
    layout.use_property_decorate = False
    return layout.column()


def _progress_or_button(layout: bpy.types.UILayout, operator: str, icon: str) -> None:
    """The button, or how far its job is; other jobs only block it."""
    job = modal.current()
    title = bpy.ops
    for part in operator.split("."):
        title = getattr(title, part)
    label = title.get_rna_type().name
    if job is None or job.label != label:
        row = layout.row()
        row.enabled = job is None
        row.scale_y = 1.4
        # From a panel's button `invoke` runs: beside the user's work.
        row.operator(operator, icon=icon)
        return
    row = layout.row(align=True)
    row.progress(factor=min(max(job.control.fraction, 0.0), 1.0), text=job.progress)
    row.operator("volillum.cancel", text="", icon="X")


def _left_out(layout: bpy.types.UILayout, scene: bpy.types.Scene, model: Model) -> None:
    """What the model cannot do with this very scene."""
    volume = work.chosen_volume(scene)
    if volume is None:
        return
    try:
        bare = outline(scene, volume)
        model.check(bare)
    except InputError as error:
        _lines(layout, str(error), "ERROR")
        return
    for note in left_out(bare, model.id):
        _lines(layout, note, "INFO")


def _needs(layout: bpy.types.UILayout, model: Model) -> None:
    icons = {"represents": "CHECKMARK", "approximates": "REMOVE", "ignores": "X"}
    for need in model.needs:
        _lines(layout, f"{need.treatment} {need.feature}: {need.reason}", icons[need.treatment])


# Characters that fit into a sidebar of Blender's default width.
LINE_LENGTH = 42


def _lines(layout: bpy.types.UILayout, text: str, icon: str = "NONE") -> None:
    """Text over as many lines as it needs: Blender's labels do not wrap."""
    column = layout.column(align=True)
    column.scale_y = 0.8
    line = ""
    lines = []
    for word in text.split():
        if line and len(line) + 1 + len(word) > LINE_LENGTH:
            lines.append(line)
            line = word
        else:
            line = f"{line} {word}".strip()
    for index, each in enumerate([*lines, line]):
        shown = icon if index == 0 else "NONE" if icon == "NONE" else "BLANK1"
        column.label(text=each, icon=shown)


CLASSES = (VOLILLUM_PT_volume, VOLILLUM_PT_model, VOLILLUM_PT_bake, VOLILLUM_PT_compare)
