"""What a bake saves by what its scene lacks: the same bake with each such thing put back, timed on
a coarse grid of the scene.

Empty margins are not timed: a bake's work and its channels are in proportion to its voxels.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ..core.coarse import coarsened
from ..core.control import Control
from ..core.grid import Grid
from ..core.scene import Scene
from ..models.illuminate import VOID_MARGIN, illuminate
from ..models.model import Model, Values
from .results import Saving

VOXELS = 6_000
# Put back so faintly that nothing else changes: three channels that differ, a glow, a direction.
TINT = np.array([1.0, 0.99, 0.98], np.float32)
GLOW, G = np.float32(1e-6), 0.1
# Bakes of this size are short: the fastest of some counts, unless one takes long.
REPEATS, SHORT_SECONDS = 3, 1.0


def savings(scene: Scene, model: Model, values: Values, control: Control) -> tuple[Saving, ...]:
    """One entry for each thing that the scene lacks and the model's equation has. Raises InputError
    where the model cannot serve the scene, and Cancelled."""
    coarse = coarsened(scene, VOXELS)
    # Settings of the cheapest rung: the ratios are the same, and sooner known.
    given = model.resolved(scene, {**values, **(model.ladder[0] if model.ladder else {})})
    seconds, size = _cost(coarse, model, given, control)
    found = []
    for what, other in lacking(coarse, model, values):
        longer, larger = _cost(other, model, given, control)
        found.append(Saving(what, longer / seconds, larger / size))
    whole = math.prod(scene.medium.sigma_t.shape)
    baked = math.prod(scene.trimmed(VOID_MARGIN).medium.sigma_t.shape)
    if baked < whole:
        what = f"matter in {100 * (1 - baked / whole):.0f} % of the grid"
        found.append(Saving(what, whole / baked, whole / baked))
    return tuple(found)


def lacking(scene: Scene, model: Model, values: Values) -> Iterator[tuple[str, Scene]]:
    """What the scene lacks, and the scene with that put back."""
    medium = scene.medium
    grids = medium.sigma_t, medium.sigma_s
    if all(grid.channels == 1 for grid in grids):
        sigma_t, sigma_s = map(_tinted, grids)
        emission = None if medium.emission is None else _tinted(medium.emission)
        tinted = replace(medium, sigma_t=sigma_t, sigma_s=sigma_s, emission=emission)
        yield "coloured matter", replace(scene, medium=tinted)
    gathers = any(own.operator.gathers_emission for own in model.equations(scene, values))
    if medium.emission is None and (gathers or model.shows_emission(values)):
        glow = medium.sigma_t.with_values(medium.sigma_t.values * GLOW, "emission")
        yield "a glow", replace(scene, medium=replace(medium, emission=glow))
    if medium.g == 0 and model.knows_phase():
        yield "a preferred direction of scattering", replace(scene, medium=replace(medium, g=G))


def _tinted(grid: Grid) -> Grid:
    if grid.channels == 3:
        return grid
    return grid.with_values(grid.values[..., None] * TINT)


def _cost(scene: Scene, model: Model, values: Values, control: Control) -> tuple[float, int]:
    """Seconds of a bake, and the bytes of its channels."""
    fastest, size = math.inf, 0
    for _ in range(REPEATS):
        begin = time.perf_counter()
        volume = illuminate(scene, model.id, values, control)
        fastest = min(fastest, time.perf_counter() - begin)
        size = sum(grid.values.nbytes for grid in volume.channels.values())
        if fastest > SHORT_SECONDS:
            break
    return fastest, size
