"""The sidebar of the 3D view: what to bake, the bake, how it fares, what is stale."""

from __future__ import annotations

import bpy

from ..core.errors import InputError
from ..models.illuminate import left_out
from ..models.model import Model
from ..models.registry import get
from . import live_session, modal, side_by_side, staleness, work, wrap
from .medium_reader import volume_material
from .outline import outline

CATEGORY = "Volillum"
# The height of the two buttons that start work, in rows.
BUTTON_SCALE = 1.4


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
        room = wrap.room(context)
        layout.prop(settings, "model", text="")
        lines(layout, model.summary, room)
        group = getattr(settings, model.id)
        for parameter in model.parameters:
            layout.prop(group, parameter.name)
        _left_out(layout, context.scene, model, room)
        header, body = layout.panel("volillum_needs", default_closed=True)
        header.label(text="What it represents")
        if body is not None:
            _needs(body, model, room)


class VOLILLUM_PT_bake(_Sidebar, bpy.types.Panel):
    """Bake and show, and what has come of it."""

    bl_label = "Bake"

    def draw(self, context: bpy.types.Context) -> None:
        """Buttons, progress, the last bake, and what has changed since."""
        layout = _column(self.layout)
        scene = context.scene
        settings = scene.volillum
        layout.prop(settings, "directory")
        progress_or_button(layout, "volillum.bake", "RENDER_STILL")
        progress_or_button(layout, "volillum.bake_frames", "RENDER_ANIMATION", scale=1)
        baked = settings.baked
        live = live_session.current()
        follows = live is not None and live.follows(scene)
        layout.operator("volillum.live", icon="FILE_REFRESH", depress=follows)
        if live is not None and follows:
            lines(layout, live.message, wrap.room(context), "TIME")
        row = layout.row(align=True)
        row.enabled = bool(baked.path)
        shown = baked.shown is not None
        row.operator("volillum.show", text="Show bake", icon="HIDE_OFF", depress=shown).baked = True
        row.operator(
            "volillum.show", text="Show volume", icon="VOLUME_DATA", depress=not shown
        ).baked = False
        if settings.other.path:
            row.operator("volillum.swap", text=f"A/B: {get(settings.other.model).label}")
        progress_or_button(layout, "volillum.side_by_side", "GRID", scale=1)
        if side_by_side.standing(scene) is not None:
            layout.operator("volillum.clear_row", icon="X")
        layout.prop(settings, "as_radiance")
        if baked.path and not follows:
            _baked(layout.box(), scene, wrap.room(context) - wrap.BOX)


class VOLILLUM_PT_compare(_Sidebar, bpy.types.Panel):
    """Errors and times against full scattering."""

    bl_label = "Compare"
    bl_options = {"DEFAULT_CLOSED"}  # noqa: RUF012 - Blender's own form

    def draw(self, context: bpy.types.Context) -> None:
        """What to compare, the button, and the figures of the last comparison."""
        layout = _column(self.layout)
        settings = context.scene.volillum
        for name in ("compare_all", "compare_published", "width", "noise", "budget"):
            layout.prop(settings, name)
        progress_or_button(layout, "volillum.compare", "SORTTIME")
        if not settings.results:
            return
        box = layout.box()
        room = wrap.room(context) - wrap.BOX
        for result in settings.results:
            entry = box.column(align=True)
            entry.label(text=get(result.model).label)
            if result.error < 0:
                lines(entry, result.reason or "not measured", room, "INFO")
                continue
            row = entry.row()
            row.label(text=f"{result.seconds:.2f} s", icon="TIME")
            row.label(text=error_text(result.error, result.noise), icon="DRIVER_DISTANCE")
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


def _baked(box: bpy.types.UILayout, scene: bpy.types.Scene, room: float) -> None:
    """The last bake, and what has changed since it was made or shown."""
    settings = scene.volillum
    baked = settings.baked
    how = "found on disk" if baked.found else f"baked in {baked.seconds:.2f} s"
    if baked.frames:
        how = f"{baked.frames} frames, {how}"
    lines(box, f"{get(baked.model).label}, {how}", room, "CHECKMARK")
    if baked.model != settings.model:  # or the model's own panel says so
        for note in filter(None, baked.notes.split("\n")):
            lines(box, note, room, "INFO")
    volume = work.chosen_volume(scene)
    changes = staleness.changes(scene, volume)
    if changes:
        stale = box.column(align=True)
        stale.alert = True
        stale.label(text="Stale: bake again", icon="ERROR")
        for change in changes:
            lines(stale, change, room)
    elif note := staleness.shown_differs(scene, volume):
        lines(box, note, room, "LIGHT_SUN")


def progress_or_button(
    layout: bpy.types.UILayout, operator: str, icon: str, scale: float = BUTTON_SCALE
) -> None:
    """The button, or how far its job is; other jobs only block it."""
    job = modal.current()
    title = bpy.ops
    for part in operator.split("."):
        title = getattr(title, part)
    label = title.get_rna_type().name
    if job is None or job.label != label:
        row = layout.row()
        row.enabled = job is None
        row.scale_y = scale
        # From a panel's button `invoke` runs: beside the user's work.
        row.operator(operator, icon=icon)
        return
    row = layout.row(align=True)
    row.scale_y = scale
    row.progress(factor=min(max(job.control.fraction, 0.0), 1.0), text=job.progress)
    row.operator("volillum.cancel", text="", icon="X")


def _left_out(
    layout: bpy.types.UILayout, scene: bpy.types.Scene, model: Model, room: float
) -> None:
    """What the model cannot do with this very scene."""
    volume = work.chosen_volume(scene)
    if volume is None:
        return
    try:
        bare = outline(scene, volume)
        model.check(bare)
    except InputError as error:
        lines(layout, str(error), room, "ERROR")
        return
    for note in left_out(bare, model.id):
        lines(layout, note, room, "INFO")


def _needs(layout: bpy.types.UILayout, model: Model, room: float) -> None:
    icons = {"represents": "CHECKMARK", "approximates": "REMOVE", "ignores": "X"}
    for need in model.needs:
        text = f"{need.treatment} {need.feature}: {need.reason}"
        lines(layout, text, room, icons[need.treatment])


def lines(layout: bpy.types.UILayout, text: str, room: float, icon: str = "NONE") -> None:
    """Text over as many lines as it needs; `room` in pixels, of which an icon takes its part."""
    column = layout.column(align=True)
    column.scale_y = 0.8
    below = "NONE" if icon == "NONE" else "BLANK1"
    pixels = room if icon == "NONE" else room - wrap.ICON
    for index, line in enumerate(wrap.lines(text, pixels)):
        column.label(text=line, icon=below if index else icon)


CLASSES = (VOLILLUM_PT_volume, VOLILLUM_PT_model, VOLILLUM_PT_bake, VOLILLUM_PT_compare)
