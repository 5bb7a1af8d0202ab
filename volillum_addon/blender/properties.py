"""What the extension keeps in a scene: its settings, and the last bake and comparison."""

from __future__ import annotations

from typing import Any

import bpy

from ..bake.grids import grid_names
from ..core.errors import InputError
from ..models.composition import Composition
from ..models.model import Model, Parameter, Value
from ..models.registry import get, models
from . import composing, parameters
from .places import block_file
from .stage import Stage


def _is_volume(_settings: Any, item: bpy.types.Object) -> bool:
    return bool(item.type == "VOLUME")


def _grids(settings: Any, _context: bpy.types.Context, text: str) -> list[str]:
    """The names of the grids in the volume's file."""
    if settings.volume is None:
        return []
    path = block_file(settings.volume.data)
    try:
        return [name for name in grid_names(path) if text.lower() in name.lower()]
    except (InputError, OSError):
        return []  # Bake says what is wrong with the file; a list of suggestions need not.


def _still(kind: Any, name: str, description: str = "", **arguments: Any) -> Any:
    """A property without key frames: a change of frame would not bake anything anew."""
    arguments.setdefault("options", set())
    return kind(name=name, description=description, **arguments)


def _text(name: str, description: str = "", **arguments: Any) -> Any:
    return _still(bpy.props.StringProperty, name, description, **arguments)


def _path(name: str, description: str = "") -> Any:
    relative = {"PATH_SUPPORTS_BLEND_RELATIVE"}
    return _text(name, description, subtype="FILE_PATH", options=relative)


def _number(name: str, description: str = "", **arguments: Any) -> Any:
    return _still(bpy.props.FloatProperty, name, description, **arguments)


def _model(description: str = "") -> Any:
    return _still(bpy.props.EnumProperty, "Model", description, items=parameters.items())


# What has not been measured.
NOT_MEASURED = -1.0


class Baked(bpy.types.PropertyGroup):
    """The last bake of a scene."""

    path: _path("File", "Of a sequence, that of its first frame")
    frames: _still(bpy.props.IntProperty, "Frames", "How many of a sequence; 0: one bake", min=0)
    model: _text("Model", "The id of a model or of a composition")
    seconds: _number("Seconds", unit="TIME_ABSOLUTE")
    found: _still(bpy.props.BoolProperty, "Found on disk")
    notes: _text("Left out")
    source: _text("Source", "What the volume looked like when it was baked")
    shown: bpy.props.PointerProperty(name="Shown as", type=bpy.types.Object)
    lighting: _text("Lighting", "What the lights looked like, by frame, when the bake was shown")


class Result(bpy.types.PropertyGroup):
    """One model's line of the last comparison."""

    model: _text("Model", "The id of a model or of a composition")
    seconds: _number("Seconds", default=NOT_MEASURED)
    error: _number("Total error", default=NOT_MEASURED)
    noise: _number("Noise of the error", default=NOT_MEASURED)
    reason: _text("Why not")


class Settings(bpy.types.PropertyGroup):
    """`scene.volillum`: what to bake, how, and where to."""

    volume: bpy.props.PointerProperty(
        name="Volume",
        description="The volume to light; may stay empty when the scene has only one",
        type=bpy.types.Object,
        poll=_is_volume,
    )
    density_grid: _text(
        "Density grid",
        "The grid of the file that is the density; empty: `density`, or the only grid",
        search=_grids,
    )
    density_scale: _number(
        "Density scale",
        "Extinction for density 1, per world unit, of a volume without a material",
        default=1,
        min=0,
        soft_max=100,
    )
    albedo: _still(
        bpy.props.FloatVectorProperty,
        "Albedo",
        "The share of light that scatters on, of a volume without a material",
        subtype="COLOR",
        size=3,
        min=0,
        max=1,
        default=(0.9, 0.9, 0.9),
    )
    model: _model("How light finds its way through the volume")
    as_radiance: _still(
        bpy.props.BoolProperty,
        "Show as one grid",
        "Store the radiance for the lights as they are as one colour grid in a file of its own, "
        "and show that. EEVEE gets it anyway from bakes of more grids than it reads",
    )
    seen_only: _still(
        bpy.props.BoolProperty,
        "Only what is seen",
        "Bake no light where the scene's camera does not look: close views bake faster, into "
        "smaller files. Other views then need another bake",
    )
    directory: _text(
        "Output",
        "Where bakes and reports go",
        subtype="DIR_PATH",
        default="//volillum",
        options={"PATH_SUPPORTS_BLEND_RELATIVE"},
    )
    compare_all: _still(
        bpy.props.BoolProperty,
        "All models",
        "Compare every model, each with its own parameters, and not only this one",
        default=True,
    )
    compare_published: _still(
        bpy.props.BoolProperty,
        "Published ones too",
        "Set the algorithm that each model was published with beside the solution of its equation",
        default=False,
    )
    noise: _number(
        "Noise",
        "Render references until their noise is below this",
        subtype="PERCENTAGE",
        default=2,
        min=0.01,
        max=100,
    )
    budget: _number(
        "Time limit",
        "Stop rendering references after this long, whatever their noise",
        unit="TIME_ABSOLUTE",
        default=120,
        min=1,
        soft_max=3600,
    )
    error_limit: _number(
        "Full colour at",
        "The error in the volume that has the full colour, relative to the RMS of the radiance of "
        "full scattering; one scale for all models",
        subtype="PERCENTAGE",
        default=100,
        min=1,
        soft_max=200,
    )
    errors: _text("Errors", "The figures of the errors that were shown last")
    errors_of: _text("Errors of", "What they depend on, as it was then")
    row_of: _text("Row of", "What the last row of models depends on, as it was then")
    width: _still(
        bpy.props.IntProperty,
        "Width",
        "Pixels across of the compared images; the height follows the scene's shape",
        subtype="PIXEL",
        default=128,
        min=8,
        soft_max=1024,
    )
    composition: _text(
        "Composition",
        "A model for each kind of light, as sun=ID,lamp=ID,sky=ID; empty: one model for all",
    )
    wanted_error: _number(
        "Error",
        "What the bake's total error may be, after the best exposure; 0: answers for usual ones",
        subtype="PERCENTAGE",
        default=0,
        min=0,
        max=100,
    )
    wanted_seconds: _number(
        "Time",
        "How long the bake may take; 0: any time",
        unit="TIME_ABSOLUTE",
        default=0,
        min=0,
        soft_max=3600,
    )
    analysis: _text("Analysis", "What the last analysis said, as JSON")
    baked: bpy.props.PointerProperty(type=Baked)
    other: bpy.props.PointerProperty(type=Baked, description="The bake before the last one")
    stage: bpy.props.PointerProperty(type=Stage)
    exhibit: bpy.props.PointerProperty(
        name="Exhibit",
        description="What stands in the volume's place beside a single bake",
        type=bpy.types.Collection,
    )
    results: bpy.props.CollectionProperty(type=Result)
    report: _path("Report")


# Each model's group is a property named by the model's id.
Settings.__annotations__ |= {
    id_: bpy.props.PointerProperty(type=group) for id_, group in parameters.GROUPS.items()
}
Settings.__annotations__ |= composing.PROPERTIES
CLASSES = (*parameters.GROUPS.values(), Baked, Result, Stage, Settings)


def chosen_model(settings: Any) -> str:
    """The model to bake: the composition where one is named. Raises InputError."""
    return get(settings.composition.strip() or settings.model).id


def model_values(settings: Any, model: str) -> dict[str, Value]:
    """The parameters of a model as they are set in the scene; a composition has its models'."""
    chosen = get(model)
    if not isinstance(chosen, Composition):
        return parameters.values(getattr(settings, model), chosen)
    found: dict[str, Value] = {}
    for part in chosen.parts:
        found |= part.named(model_values(settings, part.model.id))
    return found


def parameter_groups(
    settings: Any, model: Model
) -> list[tuple[str, bpy.types.PropertyGroup, tuple[Parameter, ...]]]:
    """Where the model's parameters are set: a title, the group, the parameters; of a composition
    each model's, once."""
    if not isinstance(model, Composition):
        return [("", getattr(settings, model.id), model.parameters)]
    parts: dict[str, list[str]] = {}
    for part in model.parts:
        parts.setdefault(part.model.id, []).append(part.name)
    return [
        (
            f"{' and '.join(names).capitalize()}: {get(id_).label}",
            getattr(settings, id_),
            get(id_).parameters,
        )
        for id_, names in parts.items()
    ]


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
