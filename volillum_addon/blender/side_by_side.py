"""Several models of one volume in one view: a row of bakes with their names, or two in turn."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from pathlib import Path

import bpy
import numpy as np
from mathutils import Matrix
from numpy.typing import NDArray

from ..bake.run import Baked
from ..bake.vdb import read_metadata
from ..core.errors import InputError
from ..models.registry import get
from . import work
from .display import show_bake

ROW = "Volillum row"
# Between two volumes, and the height of a name, as shares of a volume's extent across the row.
GAP, NAME = 0.12, 0.09


def arrange(scene: bpy.types.Scene, bakes: Sequence[Baked]) -> bpy.types.Collection:
    """Show the bakes in a row across the camera's view, about the volume's own place, each above
    its model's name; the volume and a bake that was shown alone are hidden.

    The bakes are of one scene: each is moved as it is, so a model that sees the camera shows what
    it sees from its own place.
    """
    clear(scene)
    work.hide(scene)
    volume = work.chosen_volume(scene)
    row = bpy.data.collections.new(ROW)
    scene.collection.children.link(row)
    shown = [(each.model, show_bake(each.path, scene, row)) for each in bakes]
    turn = _view(scene)
    right, up = turn[:, 0], turn[:, 1]
    corners = np.concatenate([_corners(each.path) for each in bakes])
    width, height = (float(np.ptp(corners @ axis)) for axis in (right, up))
    middle = (corners.min(0) + corners.max(0)) / 2
    for index, (model, each) in enumerate(shown):
        along = (index - (len(shown) - 1) / 2) * width * (1 + GAP)
        each.location = along * right
        name = _name(get(model).label, NAME * width, turn)
        name.location = middle + along * right - up * (height / 2 + 2 * NAME * width)
        row.objects.link(name)
    if volume is not None:
        scene.volillum.volume = volume
        volume.hide_render = volume.hide_viewport = True
    return row


def clear(scene: bpy.types.Scene) -> None:
    """Remove the row, with all that it brought; the volume itself is shown again."""
    row = standing(scene)
    if row is None:
        return
    for each in list(row.objects):
        if each.type == "VOLUME":
            work.discard(each)
        else:
            bpy.data.batch_remove([each, each.data])
    bpy.data.collections.remove(row)
    work.hide(scene)


def standing(scene: bpy.types.Scene) -> bpy.types.Collection | None:
    """The row that the scene shows now."""
    rows = (each for each in scene.collection.children if each.name.startswith(ROW))
    return next(rows, None)


def swap(scene: bpy.types.Scene) -> None:
    """Show the bake before the last one, which takes its place: A/B."""
    settings = scene.volillum
    if not settings.other.path:
        raise InputError(f"scene {scene.name!r} has one bake; expected two to switch between")
    _exchange(scene)
    try:
        work.show(scene, Path(bpy.path.abspath(settings.baked.path)))
    except InputError:
        _exchange(scene)
        raise


def _exchange(scene: bpy.types.Scene) -> None:
    baked, other = scene.volillum.baked, scene.volillum.other
    for name in work.BAKE:
        kept = getattr(other, name)
        setattr(other, name, getattr(baked, name))
        setattr(baked, name, kept)


def _view(scene: bpy.types.Scene) -> NDArray[np.float64]:
    """Columns: right, up, and toward the viewer; without a camera, as seen from -y."""
    if scene.camera is None:
        return np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]])
    axes = np.array(scene.camera.matrix_world, np.float64)[:3, :3]
    return np.asarray(axes / np.linalg.norm(axes, axis=0))


def _corners(file: Path) -> NDArray[np.float64]:
    """World positions [8, 3] of the corners of the bake's lattice."""
    entries = read_metadata(file)
    affine = np.array(entries["index_to_world"], np.float64)
    ends = [(-0.5, size - 0.5) for size in entries["shape"]]
    index = np.array(list(itertools.product(*ends)))
    return np.asarray(index @ affine[:3, :3].T + affine[:3, 3])


def _name(text: str, size: float, turn: NDArray[np.float64]) -> bpy.types.Object:
    data = bpy.data.curves.new(text, "FONT")
    data.body, data.size, data.align_x = text, size, "CENTER"
    placed = bpy.data.objects.new(text, data)
    placed.rotation_euler = Matrix(turn.tolist()).to_euler()
    return placed
