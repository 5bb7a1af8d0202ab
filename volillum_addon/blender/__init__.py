"""Everything that touches Blender: the only importer of `bpy`.

Its modules import bpy themselves; the command line's do so only when a command needs it.
"""

from __future__ import annotations

from importlib import import_module

# In this order: properties first, because panels and operators show them.
_MODULES = (".properties", ".transfer", ".classes", ".command")


def register() -> None:
    """Add properties, operators, panels and the command to the running Blender."""
    for name in _MODULES:
        import_module(name, __name__).register()


def unregister() -> None:
    """Take out again what `register` added, and stop what is running."""
    for name in reversed(_MODULES):
        import_module(name, __name__).unregister()
