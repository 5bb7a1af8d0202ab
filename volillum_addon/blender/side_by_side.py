"""Several models of one volume in one view: a row of bakes or errors with their names, or two bakes
in turn."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Sequence
from pathlib import Path

import bpy
import numpy as np

from ..bake.error_file import FieldError
from ..bake.run import Baked
from ..bake.vdb import read_metadata
from ..core.errors import InputError
from ..models.registry import get
from . import framing, showing, work
from .display import show_bake
from .error_display import TITLE_WIDTH, error_object, legend, legend_end
from .places import baked_file
from .placing import Place, lattice_corners, place_of, write

# Between two volumes, and the height of a name, as shares of a volume's extent across the row.
GAP, NAME = 0.12, 0.125
# As many letters of a name's line fit below a volume, and so many lines of that height.
LETTERS, LINES = 18, 2
# The first line's foot, and all lines', below the volumes.
FOOT, NAMES = 1.3 * NAME, (0.5 + LINES) * NAME
# How many volumes wide the legend below a row is.
LEGEND = 3


def arrange(scene: bpy.types.Scene, bakes: Sequence[Baked]) -> bpy.types.Collection:
    """Show the bakes in a row across the camera's view, about the volume's own place, each above
    its model's name; the volume and a bake that was shown alone are hidden.

    The bakes are of one scene: each is moved as it is, so a model that sees the camera shows what
    it sees from its own place.
    """
    files = [(each.model, each.path) for each in bakes]
    row = _row(scene, files, "ROW", lambda index, row: show_bake(bakes[index].path, scene, row))
    framing.frame(scene, row, _place(scene, bakes), _width(len(bakes)), NAMES)
    return row


def arrange_errors(
    scene: bpy.types.Scene, bakes: Sequence[Baked], errors: Sequence[FieldError]
) -> bpy.types.Collection:
    """The same of the bakes' errors, with one legend for all; of one bake without its name."""
    limit = scene.volillum.error_limit / 100
    files = [(each.model, each.path) for each in bakes]

    def add(index: int, row: bpy.types.Collection) -> bpy.types.Object:
        shown = error_object(errors[index], limit)
        row.objects.link(shown)
        return shown

    row = _row(scene, files, "ERROR", add)
    place, size = _place(scene, bakes), min(len(bakes), LEGEND)
    for each in legend(place, limit, max(error.noise for error in errors), size):
        row.objects.link(each)
    width = max(_width(len(bakes)), TITLE_WIDTH * size)
    framing.frame(scene, row, place, width, legend_end(size))
    return row


def _place(scene: bpy.types.Scene, bakes: Sequence[Baked]) -> Place:
    return place_of(scene, lattice_corners(read_metadata(bakes[0].path)))


def _width(count: int) -> float:
    """How many volumes wide a row of so many is."""
    return count + (count - 1) * GAP


def _lines(label: str) -> list[str]:
    """The label in lines that fit below a volume."""
    parts = label.replace(", ", ",\n").split("\n")
    return [line for part in parts for line in textwrap.wrap(part, LETTERS)]


def _row(
    scene: bpy.types.Scene,
    files: Sequence[tuple[str, Path]],
    way: str,
    add: Callable[[int, bpy.types.Collection], bpy.types.Object],
) -> bpy.types.Collection:
    """What `add` makes of each (model, file), in a row; nothing is left where that fails."""
    volume = work.chosen_volume(scene)
    corners = np.concatenate([lattice_corners(read_metadata(path)) for _, path in files])
    place = place_of(scene, corners)
    showing.hide(scene)
    row = showing.open_exhibit(scene)
    try:
        for index, (model, _) in enumerate(files):
            along = (index - (len(files) - 1) / 2) * (1 + GAP)
            add(index, row).location = along * place.width * place.turn[:, 0]
            below = -place.height / place.width / 2 - FOOT
            label = _lines(get(model).label)
            share = min(1, LETTERS / max(map(len, label)), LINES / len(label))
            name = write("\n".join(label), share * NAME * place.width,
                         place.point(along, below), place)  # fmt: skip
            row.objects.link(name)
    except BaseException:
        showing.hide(scene)
        raise
    showing.step_aside(scene, volume, way, showing.NO_NOISE)
    return row


def swap(scene: bpy.types.Scene) -> None:
    """Show the bake before the last one, which takes its place: A/B."""
    settings = scene.volillum
    if not settings.other.path:
        raise InputError(f"scene {scene.name!r} has one bake; expected two to switch between")
    _exchange(scene)
    try:
        showing.show(scene, baked_file(scene))
    except InputError:
        _exchange(scene)
        raise


def _exchange(scene: bpy.types.Scene) -> None:
    baked, other = scene.volillum.baked, scene.volillum.other
    for name in work.BAKE:
        kept = getattr(other, name)
        setattr(other, name, getattr(baked, name))
        setattr(baked, name, kept)
