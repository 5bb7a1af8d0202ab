"""Solving a model in a scene."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from ..core.control import Control
from ..core.errors import bad
from ..core.grid import Grid, Region
from ..core.lights import Light, shines
from ..core.scene import Scene
from .model import Values
from .registry import get
from .volume import Cost, IlluminationVolume

# Void voxels this far from matter are solved too: interpolation must not darken boundaries.
VOID_MARGIN = 2


def illuminate(
    scene: Scene,
    model: str | Mapping[str, str],
    parameters: Mapping[str, object] | None = None,
    control: Control | None = None,
) -> IlluminationVolume:
    """The model's illumination of the scene, in memory; `model` is an id, or one for each kind of
    light: {"sun": ID, "sky": ID}.

    The volume's lattice is the box of the medium's matter grown by VOID_MARGIN voxels; where the
    scene is for its camera's view alone, channels are 0 outside of it. Raises InputError for bad
    input or a scene that the model cannot serve, Cancelled when `control` says so.
    """
    chosen = get(model)
    values = chosen.values(parameters or {})
    chosen.check(scene)
    control = control or Control()
    trimmed = scene.trimmed(VOID_MARGIN)
    begin = time.perf_counter()
    channels = chosen.solve(trimmed, chosen.resolved(trimmed, values), control)
    if trimmed.wanted is not None:
        channels = {name: _only(grid, trimmed.wanted) for name, grid in channels.items()}
    seconds = time.perf_counter() - begin
    return assembled(trimmed, chosen.id, values, channels, seconds)


def _only(grid: Grid, wanted: Region) -> Grid:
    """The grid with zeros outside of a box."""
    inside = tuple(map(slice, *wanted))
    values = np.zeros_like(grid.values)
    values[inside] = grid.values[inside]
    return grid.with_values(values, grid.name)


def assembled(
    scene: Scene, model: str, values: Values, channels: Mapping[str, Grid], seconds: float
) -> IlluminationVolume:
    """The volume of solved channels; `scene` is trimmed."""
    chosen = get(model)
    volume = IlluminationVolume(
        model=model,
        parameters=values,
        medium=scene.medium,
        channels=channels,
        radiance=chosen.radiance(chosen.represented(scene), scene.medium, values),
        image_emission=chosen.shows_emission(values),
        notes=left_out(scene, model),
    )
    return replace(
        volume,
        cost=Cost(seconds, error_estimate=volume.relative_standard_error()),
        notes=(*volume.notes, *chosen.remarks(volume)),
    )


def bake(
    scene: Scene,
    model: str | Mapping[str, str],
    control: Control | None = None,
    **parameters: object,
) -> IlluminationVolume:
    """`illuminate` with the parameters as keywords: bake(scene, "half_angle", theta=0.5)."""
    return illuminate(scene, model, parameters, control)


def relight(volume: IlluminationVolume, lights: tuple[Light, ...]) -> IlluminationVolume:
    """The same channels under other lights: no new visibility, where the model allows that.
    Raises InputError where the bake has not stored what these lights need."""
    model = get(volume.model)
    terms = model.radiance(model.known(lights), volume.medium, volume.parameters)
    for factor in (factor for term in terms for factor in term.factors):
        grid = volume.channels.get(factor.channel)
        if grid is None or (factor.component or 0) >= grid.channels:
            raise bad(
                "the bake",
                f"no {factor.channel} of component {factor.component or 0}",
                "the channels that the new lights need: bake again under them",
            )
    return volume.with_radiance(terms)


def left_out(scene: Scene, model: str) -> tuple[str, ...]:
    """What of the scene the model does not represent, in plain words."""
    chosen = get(model)
    notes = []
    lit = {light.kind for light in scene.lights if shines(light)}
    absent = sorted(lit - chosen.lights)
    if absent:
        notes.append(f"{chosen.label} leaves out lights of the kinds: {', '.join(absent)}")
    if scene.medium.emission is not None and not chosen.shows_emission(chosen.values({})):
        notes.append(f"{chosen.label} leaves out the medium's own emission")
    if scene.medium.g != 0 and not chosen.knows_phase():
        notes.append(f"{chosen.label} scatters isotropically; the medium has g = {scene.medium.g}")
    return tuple(notes)
