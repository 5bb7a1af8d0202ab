"""What the extension keeps in a scene: its settings, and the last bake and comparison."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy

from ..bake.grids import grid_names
from ..core.errors import InputError
from ..models.model import Value
from ..models.registry import get, models
from . import parameters


def _is_volume(_settings: Any, item: bpy.types.Object) -> bool:
    return bool(item.type == "VOLUME")


def _grids(settings: Any, _context: bpy.types.Context, text: str) -> list[str]:
    """The names of the grids in the volume's file."""
    if settings.volume is None:
        return []
    path = Path(bpy.path.abspath(settings.volume.data.filepath))
    try:
        return [name for name in grid_names(path) if text.lower() in name.lower()]
    except (InputError, OSError):
        return []  # Bake says what is wrong with the file; a list of suggestions need not.


class Baked(bpy.types.PropertyGroup):
    """The last bake of a scene."""

    path: bpy.props.StringProperty(name="File", subtype="FILE_PATH", options=set())
    model: bpy.props.EnumProperty(name="Model", items=parameters.items(), options=set())
    seconds: bpy.props.FloatProperty(name="Seconds", unit="TIME_ABSOLUTE", options=set())
    found: bpy.props.BoolProperty(name="Found on disk", options=set())
    notes: bpy.props.StringProperty(name="Left out", options=set())
    source: bpy.props.StringProperty(
        name="Source", description="What the volume looked like when it was baked", options=set()
    )
    shown: bpy.props.PointerProperty(name="Shown as", type=bpy.types.Object)


class Result(bpy.types.PropertyGroup):
    """One model's line of the last comparison; a negative error or time was not measured."""

    model: bpy.props.EnumProperty(name="Model", items=parameters.items(), options=set())
    seconds: bpy.props.FloatProperty(name="Seconds", default=-1, options=set())
    error: bpy.props.FloatProperty(name="Total error", default=-1, options=set())
    noise: bpy.props.FloatProperty(name="Noise of the error", default=-1, options=set())
    reason: bpy.props.StringProperty(name="Why not", options=set())


class Settings(bpy.types.PropertyGroup):
    """`scene.volillum`: what to bake, how, and where to."""

    volume: bpy.props.PointerProperty(
        name="Volume",
        description="The volume to light; may stay empty when the scene has only one",
        type=bpy.types.Object,
        poll=_is_volume,
    )
    density_grid: bpy.props.StringProperty(
        name="Density grid",
        description="The grid of the file that is the density; empty: `density`, or the only grid",
        search=_grids,
        options=set(),
    )
    density_scale: bpy.props.FloatProperty(
        name="Density scale",
        description="Extinction for density 1, per world unit, of a volume without a material",
        default=1,
        min=0,
        soft_max=100,
        options=set(),
    )
    albedo: bpy.props.FloatVectorProperty(
        name="Albedo",
        description="The share of light that scatters on, of a volume without a material",
        subtype="COLOR",
        size=3,
        min=0,
        max=1,
        default=(0.9, 0.9, 0.9),
        options=set(),
    )
    model: bpy.props.EnumProperty(
        name="Model",
        description="How light finds its way through the volume",
        items=parameters.items(),
        options=set(),
    )
    directory: bpy.props.StringProperty(
        name="Output",
        description="Where bakes and reports go",
        subtype="DIR_PATH",
        default="//volillum",
        options={"PATH_SUPPORTS_BLEND_RELATIVE"},
    )
    compare_all: bpy.props.BoolProperty(
        name="All models",
        description="Compare every model, each with its own parameters, and not only this one",
        default=True,
        options=set(),
    )
    noise: bpy.props.FloatProperty(
        name="Noise",
        description="Render references until their noise is below this",
        subtype="PERCENTAGE",
        default=2,
        min=0.01,
        max=100,
        options=set(),
    )
    budget: bpy.props.FloatProperty(
        name="Time limit",
        description="Stop rendering references after this long, whatever their noise",
        unit="TIME_ABSOLUTE",
        default=120,
        min=1,
        soft_max=3600,
        options=set(),
    )
    width: bpy.props.IntProperty(
        name="Width",
        description="Pixels across of the compared images; the height follows the scene's shape",
        default=128,
        min=8,
        soft_max=1024,
        options=set(),
    )
    baked: bpy.props.PointerProperty(type=Baked)
    results: bpy.props.CollectionProperty(type=Result)
    report: bpy.props.StringProperty(name="Report", subtype="FILE_PATH", options=set())


# Each model's group is a property named by the model's id.
Settings.__annotations__ |= {
    id_: bpy.props.PointerProperty(type=group) for id_, group in parameters.GROUPS.items()
}
CLASSES = (*parameters.GROUPS.values(), Baked, Result, Settings)


def model_values(settings: Any, model: str) -> dict[str, Value]:
    """The parameters of a model as they are set in the scene."""
    return parameters.values(getattr(settings, model), get(model))


def all_values(settings: Any) -> dict[str, dict[str, Value]]:
    """`model_values` of every model."""
    return {model.id: model_values(settings, model.id) for model in models()}


def register() -> None:
    """Give every scene its settings."""
    for each in CLASSES:
        bpy.utils.register_class(each)
    bpy.types.Scene.volillum = bpy.props.PointerProperty(type=Settings)


def unregister() -> None:
    """Take them away again; what is stored in files stays."""
    del bpy.types.Scene.volillum
    for each in reversed(CLASSES):
        bpy.utils.unregister_class(each)


def is_registered() -> bool:
    """Whether scenes have the settings now."""
    return hasattr(bpy.types.Scene, "volillum")
