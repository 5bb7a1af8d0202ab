"""Operators and panels in the running Blender."""

from __future__ import annotations

import bpy

from . import live_session, modal, operators, panels

CLASSES = (*operators.CLASSES, *live_session.CLASSES, *panels.CLASSES)


def register() -> None:
    """Add them."""
    for each in CLASSES:
        bpy.utils.register_class(each)
    live_session.register()


def unregister() -> None:
    """Cancel what runs and take them out again."""
    modal.stop()
    live_session.unregister()
    for each in reversed(CLASSES):
        bpy.utils.unregister_class(each)
