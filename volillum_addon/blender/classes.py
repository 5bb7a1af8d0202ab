"""Operators and panels in the running Blender."""

from __future__ import annotations

import bpy

from . import modal, operators, panels

CLASSES = (*operators.CLASSES, *panels.CLASSES)


def register() -> None:
    """Add them."""
    for each in CLASSES:
        bpy.utils.register_class(each)


def unregister() -> None:
    """Cancel what runs and take them out again."""
    modal.stop()
    for each in reversed(CLASSES):
        bpy.utils.unregister_class(each)
