"""Operators and panels in the running Blender."""

from __future__ import annotations

import bpy

from ..resources import PRESETS
from . import (
    analysis_panel,
    compare_operators,
    compare_panel,
    histogram,
    import_operators,
    light_operator,
    live_session,
    modal,
    operators,
    panels,
    show_operators,
    stage,
    transfer_operators,
    transfer_panel,
)

CLASSES = (
    *operators.CLASSES,
    *show_operators.CLASSES,
    *compare_operators.CLASSES,
    *import_operators.CLASSES,
    *light_operator.CLASSES,
    *transfer_operators.CLASSES,
    *live_session.CLASSES,
    *panels.CLASSES,
    *compare_panel.CLASSES,
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
    bpy.app.handlers.load_post.append(stage.hide_linked_again)
    import_operators.register_menu()
    bpy.utils.register_preset_path(PRESET_ROOT)


def unregister() -> None:
    """Cancel what runs and take them out again."""
    modal.stop()
    bpy.utils.unregister_preset_path(PRESET_ROOT)
    import_operators.unregister_menu()
    bpy.app.handlers.load_post.remove(stage.hide_linked_again)
    live_session.unregister()
    histogram.forget()
    for each in reversed(CLASSES):
        bpy.utils.unregister_class(each)
