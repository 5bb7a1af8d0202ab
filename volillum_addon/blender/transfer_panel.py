"""The sidebar's transfer function: histogram, ramp, presets, Apply."""

from __future__ import annotations

import bpy

from ..core.errors import InputError
from . import histogram, transfer, wrap
from .medium_builder import phase_socket
from .sidebar import Sidebar, column, lines, progress_or_button
from .transfer_operators import VOLILLUM_MT_transfer_presets

# The histogram's height, in rows.
ROWS = 8.0


class VOLILLUM_PT_transfer(Sidebar, bpy.types.Panel):
    """How the values of an imported volume become matter."""

    bl_label = "Transfer function"
    bl_parent_id = "VOLILLUM_PT_volume"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only for a volume that has one."""
        return transfer.material_of(context.scene) is not None

    def draw(self, context: bpy.types.Context) -> None:
        """Presets, the histogram in the ramp's colours, the ramp, and what is not yet applied."""
        layout = column(self.layout)
        material = transfer.material_of(context.scene)
        assert material is not None  # poll
        settings, room = material.volillum, wrap.room(context)
        row = layout.row(align=True)
        row.menu("VOLILLUM_MT_transfer_presets", text=VOLILLUM_MT_transfer_presets.bl_label)
        row.operator("volillum.save_transfer", text="", icon="ADD")
        row.operator("volillum.save_transfer", text="", icon="REMOVE").remove_active = True
        stale = True
        try:
            known, function = transfer.about(material), transfer.read(material)
            stale = transfer.signature(material) != settings.applied
            picture = histogram.icon(
                known, function, settings.low, settings.high, settings.logarithmic
            )
            layout.template_icon(icon_value=picture, scale=ROWS)
            unit = f" {known.unit}" if known.unit else ""
            kind = f"{known.kind.upper()}, " if known.kind else ""
            whole = f" in all {settings.frames} frames together" if settings.frames else ""
            lines(layout, f"{kind}{known.low:g} to {known.high:g}{unit}{whole}", room)
        except InputError as error:
            lines(layout, str(error), room, "ERROR")
        layout.prop(settings, "logarithmic")
        layout.template_color_ramp(transfer.ramp_node(material), "color_ramp", expand=True)
        values = layout.column(align=True)
        values.prop(settings, "low")
        values.prop(settings, "high")
        layout.prop(settings, "per_voxel")
        layout.prop(settings, "physical")
        phase = phase_socket(material)
        if phase is not None:
            layout.prop(phase, "default_value", text="Anisotropy")
        if stale:
            lines(layout, "Not applied yet: what is shown and baked is older", room, "INFO")
        progress_or_button(layout, "volillum.apply_transfer", "CHECKMARK")


CLASSES = (VOLILLUM_PT_transfer,)
