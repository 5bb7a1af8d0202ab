"""Everything that touches Blender: the only importer of `bpy`."""

from typing import Any

import bpy

from . import cli

# The handles of what is registered, while it is.
_commands: list[Any] = []


def register() -> None:
    """Adds the command `blender --command volillum` to the running Blender."""
    _commands.append(bpy.utils.register_cli_command("volillum", cli.main))


def unregister() -> None:
    """Takes out again what `register` added."""
    while _commands:
        bpy.utils.unregister_cli_command(_commands.pop())
