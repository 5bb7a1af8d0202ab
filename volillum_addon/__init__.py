"""volillum: volumetric illumination models, baked, displayed and compared in Blender.

The Python interface needs no bpy. Names are loaded on first use, so that importing the package is
cheap and works where only a part of its dependencies is present.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

# Public name -> (module, name in it).
_PUBLIC = {
    "Grid": (".core.grid", "Grid"),
    "Medium": (".core.medium", "Medium"),
    "DistantLight": (".core.lights", "DistantLight"),
    "PointLight": (".core.lights", "PointLight"),
    "SpotLight": (".core.lights", "SpotLight"),
    "AreaLight": (".core.lights", "AreaLight"),
    "EnvironmentLight": (".core.lights", "EnvironmentLight"),
    "Camera": (".core.camera", "Camera"),
    "Scene": (".core.scene", "Scene"),
    "Control": (".core.control", "Control"),
    "Cancelled": (".core.control", "Cancelled"),
    "InputError": (".core.errors", "InputError"),
    "IlluminationVolume": (".models.volume", "IlluminationVolume"),
    "models": (".models.registry", "models"),
    "TransferFunction": (".core.transfer_function", "TransferFunction"),
    "bake": (".models.illuminate", "bake"),
    "bake_histogram": (".models.histogram", "bake_histogram"),
    "relight": (".models.illuminate", "relight"),
    "photon_state": (".models.progressive", "photon_state"),
    "refine": (".models.progressive", "refine"),
    "exact": (".models.exact", "exact"),
    "exact_image": (".models.exact", "exact_image"),
    "line_integral": (".models.image", "line_integral"),
    "read_vdb": (".bake.vdb", "read_vdb"),
    "write_vdb": (".bake.vdb", "write_vdb"),
    "read_grid": (".bake.vdb", "read_grid"),
    "read_volume": (".readers.formats", "read_volume"),
    "import_volume": (".readers.formats", "import_volume"),
}
__all__ = list(_PUBLIC)
__version__ = "0.1.0"


def __getattr__(name: str) -> Any:
    if name not in _PUBLIC:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module, attribute = _PUBLIC[name]
    return getattr(import_module(module, __name__), attribute)


def register() -> None:
    """Add operators, panels and commands to Blender."""
    import_module(".blender", __name__).register()


def unregister() -> None:
    """Remove what `register` added."""
    import_module(".blender", __name__).unregister()
