"""Blender's way into the extension. Nothing is imported before Blender registers it."""


def register() -> None:
    """Called by Blender when the extension is enabled."""
    from . import volillum_addon

    volillum_addon.register()


def unregister() -> None:
    """Called by Blender when the extension is disabled."""
    from . import volillum_addon

    volillum_addon.unregister()
