"""Operators and panels in the running Blender."""

from __future__ import annotations

import bpy

from ..resources import PRESETS
from . import (
    analysis_panel,
    histogram,
    import_operators,
    live_session,
    modal,
    operators,
    panels,
    transfer_operators,
    transfer_panel,
)

CLASSES = (
    *operators.CLASSES,
    *import_operators.CLASSES,
    *transfer_operators.CLASSES,
    *live_session.CLASSES,
    *panels.CLASSES,
    *analysis_panel.CLASSES,
    *transfer_panel.CLASSES,
)
# Blender looks for a folder presets/ in here.
PRESET_ROOT = str(PRESETS.parent)


def register() -> None:
    """Add them."""
    for each in CLASSES:
        bpy.utils.register_class(each)
    live_session.register()
    import_operators.register_menu()
    bpy.utils.register_preset_path(PRESET_ROOT)


def unregister() -> None:
    """Cancel what runs and take them out again."""
    modal.stop()
    bpy.utils.unregister_preset_path(PRESET_ROOT)
    import_operators.unregister_menu()
    live_session.unregister()
    histogram.forget()
    for each in reversed(CLASSES):
        bpy.utils.unregister_class(each)
