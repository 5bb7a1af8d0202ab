"""The sidebar of the 3D view: what to bake, the bake, what is shown, what is stale."""

from __future__ import annotations

import bpy

from ..core.errors import InputError
from ..models.illuminate import left_out
from ..models.model import Model
from ..models.registry import get
from . import composing, exhibit_state, live_session, staleness, work, wrap
from .medium_reader import volume_material
from .outline import outline
from .properties import chosen_model, parameter_groups
from .sidebar import Sidebar, column, lines, progress, progress_or_button, stale


class VOLILLUM_PT_volume(Sidebar, bpy.types.Panel):
    """The volume that is lit."""

    bl_label = "Volume"

    def draw(self, context: bpy.types.Context) -> None:
        """Volume, density grid and, where the volume has no material, how dense it is."""
        layout = column(self.layout)
        settings = context.scene.volillum
        volume = work.chosen_volume(context.scene)
        progress(layout, "volillum.import_volume")
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
            progress_or_button(layout, "volillum.add_transfer", "COLOR", scale=1)
        layout.operator("volillum.light", icon="LIGHT_SUN")


class VOLILLUM_PT_model(Sidebar, bpy.types.Panel):
    """The model and its parameters."""

    bl_label = "Model"

    def draw(self, context: bpy.types.Context) -> None:
        """The choice, its one-line summary, every parameter, and what it leaves out."""
        layout = column(self.layout)
        settings = context.scene.volillum
        room = wrap.room(context)
        kinds = composing.groups(settings)
        if settings.by_light:
            for kind in kinds:
                layout.prop(settings, composing.menu(kind))
        else:
            layout.prop(settings, "model", text="")
        # Of one kind of light there is nothing to put together.
        if settings.by_light or len(kinds) > 1:
            layout.prop(settings, "by_light")
        try:
            model = get(chosen_model(settings))
        except InputError as error:
            lines(layout, str(error), room, "ERROR")
            return
        lines(layout, model.summary, room)
        for title, group, parameters in parameter_groups(settings, model):
            if title:
                layout.label(text=title)
            for parameter in parameters:
                layout.prop(group, parameter.name)
        _left_out(layout, context.scene, model, room)
        header, body = layout.panel("volillum_needs", default_closed=True)
        header.label(text="What it represents")
        if body is not None:
            _needs(body, model, room)


class VOLILLUM_PT_bake(Sidebar, bpy.types.Panel):
    """Bake and show, and what has come of it."""

    bl_label = "Bake"

    def draw(self, context: bpy.types.Context) -> None:
        """Buttons, progress, the last bake, and what has changed since."""
        layout = column(self.layout)
        scene = context.scene
        settings = scene.volillum
        layout.prop(settings, "directory")
        layout.prop(settings, "seen_only")
        progress_or_button(layout, "volillum.bake", "RENDER_STILL")
        progress_or_button(layout, "volillum.bake_frames", "RENDER_ANIMATION", scale=1)
        baked = settings.baked
        live = live_session.current()
        follows = live is not None and live.follows(scene)
        layout.operator("volillum.live", icon="FILE_REFRESH", depress=follows)
        if live is not None and follows:
            lines(layout, live.message, wrap.room(context), "TIME")
        _ways(layout, scene, wrap.room(context))
        view = getattr(context, "space_data", None)
        shading = view.shading.type if isinstance(view, bpy.types.SpaceView3D) else None
        if note := unseen(settings.stage.way, shading):
            lines(layout, note, wrap.room(context), "INFO")
        if settings.other.path:
            label = f"A/B: {get(settings.other.model).label}"
            layout.operator("volillum.swap", text=label, icon="ARROW_LEFTRIGHT")
        progress_or_button(layout, "volillum.side_by_side", "GRID", scale=1)
        layout.prop(settings, "as_radiance")
        if baked.path and not follows:
            _baked(layout.box(), scene, wrap.room(context) - wrap.BOX)


def _ways(layout: bpy.types.UILayout, scene: bpy.types.Scene, room: float) -> None:
    """One switch: what stands in the volume's place; and whether that still holds."""
    settings = scene.volillum
    way = settings.stage.way
    row = layout.row(align=True)
    bake = row.row(align=True)
    bake.enabled = bool(settings.baked.path)
    bake.operator(
        "volillum.show", text="Baked", icon="HIDE_OFF", depress=way == "BAKE"
    ).baked = True
    row.operator("volillum.scatter", text="Scattering", icon="LIGHT", depress=way == "SCATTERING")
    row.operator(
        "volillum.show", text="Volume", icon="VOLUME_DATA", depress=way == "VOLUME"
    ).baked = False
    if settings.exhibit is not None and way in ("ROW", "ERROR"):
        layout.operator("volillum.clear_row", icon="X")
        errors = way == "ERROR"
        note = settings.errors_of if errors else settings.row_of
        exhibit_state.draw(layout, scene, note, errors, room)


def unseen(way: str, shading: str | None) -> str:
    """Why a view of this shading (None: not a view) does not show what stands in the volume's
    place; "" where it does."""
    if way == "SCATTERING" and shading not in (None, "RENDERED"):
        return "Cycles alone scatters: choose Rendered, the last of the four spheres above the view"
    return ""


def _baked(box: bpy.types.UILayout, scene: bpy.types.Scene, room: float) -> None:
    """The last bake, and what has changed since it was made or shown."""
    settings = scene.volillum
    baked = settings.baked
    how = "found on disk" if baked.found else f"baked in {baked.seconds:.2f} s"
    if baked.frames:
        how = f"{baked.frames} frames, {how}"
    lines(box, f"{get(baked.model).label}, {how}", room, "CHECKMARK")
    if baked.model != (settings.composition or settings.model):  # or the model's own panel says so
        for note in filter(None, baked.notes.split("\n")):
            lines(box, note, room, "INFO")
    volume = work.chosen_volume(scene)
    changes = staleness.changes(scene, volume)
    stale(box, "Stale: bake again", changes, room)
    if changes:
        return
    if note := staleness.shown_differs(scene, volume):
        lines(box, note, room, "LIGHT_SUN")


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


CLASSES = (VOLILLUM_PT_volume, VOLILLUM_PT_model, VOLILLUM_PT_bake)
