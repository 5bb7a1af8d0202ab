"""The numerical error of a bake by refinement: baked minus the same on half the voxel size."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..core.control import Control
from ..core.grid import Grid
from ..core.medium import Medium
from ..core.native import native
from ..core.scene import Scene
from ..models.ambient_occlusion import colours
from ..models.illuminate import VOID_MARGIN, illuminate
from ..models.model import Model, Value
from ..models.operator import Operator, brightness
from . import hard_bounds as bounds


def off_refined(
    model: Model,
    scene: Scene,
    given: Mapping[str, Value],
    kept: Collection[str],
    found: NDArray[np.float64],
    control: Control,
) -> NDArray[np.float64]:
    """Baked minus refined at the voxels, [i, j, k, 3], NaN where the finer lattice ends before.

    Refined with the finest settings of the model's ladder but for those that are `kept`. A
    convolution has no such error: its weights are exact, and its field belongs to the lattice. Half
    balls are refined as the sums that they are.
    """
    here = scene.trimmed(VOID_MARGIN).medium
    operator = model.operator(given)
    if operator.law != "exp":
        if operator.axis != "gradient":
            return np.zeros_like(found)
        shine = brightness(model.represented(scene), here.sigma_t.centre)
        return shine * _half_balls_off(operator, here, control)
    off = np.full_like(found, np.nan)
    finest = dict(model.ladder[-1]) if model.ladder else {}
    better = {**given, **{name: finest[name] for name in finest if name not in kept}}
    fine = illuminate(replace(scene, medium=refined(here)), model.id, better, control)
    seen = bounds.radiance(fine, scene.camera)
    # Where each voxel lies in the finer lattice, whose margin is narrower.
    origin = here.sigma_t.to_world(np.zeros(3))
    first = np.rint(fine.medium.sigma_t.to_index(origin)).astype(int)
    places = [f + 2 * np.arange(n) for f, n in zip(first, here.sigma_t.shape, strict=True)]
    shared = [(p >= 0) & (p < n) for p, n in zip(places, fine.medium.sigma_t.shape, strict=True)]
    inside = np.ix_(*shared)
    places_inside = np.ix_(*(p[s] for p, s in zip(places, shared, strict=True)))
    off[inside] = found[inside] - seen[places_inside]
    return off


def _half_balls_off(operator: Operator, medium: Medium, control: Control) -> NDArray[np.float64]:
    """What sums over half balls differ by from those on the finer lattice, as shares of the light,
    [i, j, k, 1 or 3]. What is summed is interpolated, be it opacities."""
    guide = medium.sigma_t
    length = operator.reference_length if operator.law == "bounded" else 0.0
    occluding = -np.expm1(-guide.planes() * length) if length else guide.planes()
    net = np.float32(operator.gathers_colour) * colours(medium, length) - occluding
    field = guide.with_planes(net, "net")
    coarse, fine = (
        np.maximum(0, 1 + _half_ball_sums(operator, *grids, control))
        for grids in ((field, guide), (refined_grid(field), refined_grid(guide)))
    )
    return coarse - fine[1::2, 1::2, 1::2]


def _half_ball_sums(
    operator: Operator, field: Grid, guide: Grid, control: Control
) -> NDArray[np.float64]:
    sums = native.hemisphere_sums(
        field.planes(),
        guide=guide.planes(),
        index_to_world=field.index_to_world,
        radius=operator.radius,
        weight_p=int(operator.weight_p),
        total=1.0 if operator.law == "bounded" else operator.radius,
        control=control.native,
    )
    return np.moveaxis(sums, 0, -1).astype(np.float64)


def refined(medium: Medium) -> Medium:
    """The same trilinear field on a lattice of half the voxel size."""
    emission = medium.emission
    return replace(
        medium,
        sigma_t=refined_grid(medium.sigma_t),
        sigma_s=refined_grid(medium.sigma_s),
        emission=None if emission is None else refined_grid(emission),
    )


def refined_grid(grid: Grid) -> Grid:
    """Likewise; voxel i is number 2 i + 1 of it."""
    values = grid.values.astype(np.float64)
    for axis in range(3):
        padded = np.moveaxis(np.pad(values, _pads(values.ndim, axis)), axis, 0)
        fine = np.empty((2 * len(padded) - 3, *padded.shape[1:]))
        fine[0::2] = (padded[:-1] + padded[1:]) / 2
        fine[1::2] = padded[1:-1]
        values = np.moveaxis(fine, 0, axis)
    affine = grid.index_to_world.copy()
    affine[:3, :3] /= 2
    affine[:3, 3] = grid.to_world(np.array([-0.5, -0.5, -0.5]))
    return Grid(values.astype(np.float32), affine, grid.name)


def _pads(dimensions: int, axis: int) -> list[tuple[int, int]]:
    return [(1, 1) if a == axis else (0, 0) for a in range(dimensions)]
