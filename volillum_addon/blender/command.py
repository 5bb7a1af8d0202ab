"""The command line inside Blender: `blender --background FILE --command volillum ...`."""

from __future__ import annotations

from typing import Any

import bpy

from . import cli

# The handle of the command while it is registered.
_handles: list[Any] = []


def register() -> None:
    """Add the command."""
    _handles.append(bpy.utils.register_cli_command("volillum", cli.main))


def unregister() -> None:
    """Take it out again."""
    while _handles:
        bpy.utils.unregister_cli_command(_handles.pop())
