"""A comparison of models in a Blender scene, with Cycles as the renderer."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path

import bpy
import numpy as np

from ..bake.vdb import write_vdb
from ..compare import flip
from ..compare.measure import Options
from ..compare.results import Comparison
from ..compare.run import Candidate
from ..compare.run import compare as compare_models
from ..core.camera import Camera
from ..core.control import Control
from ..core.errors import InputError, number
from ..core.grid import Grid
from ..core.medium import Medium
from ..models.model import Value
from ..models.volume import IlluminationVolume
from . import work
from .camera_reader import image_size
from .cycles import CyclesRenderer
from .display import add_volume, medium_material
from .render import add_camera, clip_range, render_image, set_cycles
from .sandbox import sandbox

PAGE = "report.html"


def compare(
    scene: bpy.types.Scene,
    models: Mapping[str, Mapping[str, Value]],
    options: Options,
    width: int | None,
    directory: Path,
    control: Control,
) -> Comparison:
    """Compare the models, each with its parameters, in images `width` pixels across (None: as the
    scene renders) with the scene's own proportions; the report's files are in `directory` then.

    Renders, so it runs in the main thread only. Raises InputError and Cancelled.
    """
    reading = work.read(scene)
    reading.scene.need_camera()
    check_cycles()
    flip.check()
    full_width, full_height = image_size(scene)
    across = round(number("width", width or full_width, 8, 65536, "pixels"))
    down = max(1, round(across * full_height / full_width))
    renderer = CyclesRenderer(reading.scene, across, down, scene)
    candidates = [Candidate(model, values) for model, values in models.items()]
    return compare_models(renderer, candidates, options, directory, control)


@cache
def check_cycles() -> None:
    """Raise InputError where this Blender's Cycles was built without volumes, as Debian's is: it
    renders every VDB file as if it were empty, and says nothing."""
    grid = Grid(np.ones((4, 4, 4), np.float32), np.eye(4), "probe")
    medium = Medium(grid, grid.with_values(np.zeros_like(grid.values)), emission=grid)
    glow = IlluminationVolume("none", {}, medium, {}, ())
    camera = Camera((1.5, 1.5, 9.5), (1.5, 1.5, 1.5), (0, 1, 0), orthographic=True, height=2)
    with sandbox() as (own, folder):
        path = folder / "glow.vdb"
        write_vdb(glow, path)
        add_volume(own, path, medium_material("glow", glow))
        add_camera(own, camera, clip_range(camera, grid.corners()))
        set_cycles(own, 1, 0)
        own.cycles.volume_biased = True
        if render_image(own, 4, 4, folder)[..., :3].max() <= 0:
            raise InputError(
                f"Cycles of Blender {bpy.app.version_string} at {bpy.app.binary_path or 'bpy'} "
                "renders volumes as empty; expected a Blender whose Cycles reads VDB files, as "
                "the builds of the Blender Foundation do"
            )
