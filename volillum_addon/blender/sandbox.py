"""A Blender scene of our own to render in, which leaves no trace in the user's file."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import bpy

from ..core.errors import InputError

Vector3 = tuple[float, float, float]


@contextmanager
def sandbox() -> Iterator[tuple[bpy.types.Scene, Path]]:
    """A new scene and a temporary folder; every data-block that came with them goes with them.

    What existed before is neither linked nor changed: the work inside only adds data-blocks. They
    are removed by identity, so a failure or a cancel in the middle cleans up as well.
    """
    before = {block.session_uid for block in _blocks()}
    with tempfile.TemporaryDirectory(prefix="volillum-") as folder:
        try:
            yield bpy.data.scenes.new("volillum"), Path(folder)
        finally:
            added = [block for block in _blocks() if block.session_uid not in before]
            bpy.data.batch_remove(added)


def _blocks() -> list[bpy.types.ID]:
    blocks: list[bpy.types.ID] = []
    for prop in bpy.data.bl_rna.properties:
        if prop.type == "COLLECTION" and prop.identifier != "all_ids":
            blocks.extend(getattr(bpy.data, prop.identifier))
    return blocks


def load_volume(path: Path) -> bpy.types.Volume:
    """The file as a volume data-block whose grids Cycles reads in full, in world units."""
    data = bpy.data.volumes.new(path.stem)
    data.filepath = str(path)
    # Half precision is Blender's default (5e-4), OBJECT space rescales density with the object.
    data.render.precision = "FULL"
    data.render.space = "WORLD"
    if not data.grids.load():
        message = data.grids.error_message
        bpy.data.volumes.remove(data)
        raise InputError(f"Blender cannot read {path} ({message}); expected a whole VDB file")
    return data


def add_object(
    scene: bpy.types.Scene, data: bpy.types.ID, name: str = "volillum"
) -> bpy.types.Object:
    """A new object of `data` in the scene."""
    added = bpy.data.objects.new(name, data)
    scene.collection.objects.link(added)
    return added
