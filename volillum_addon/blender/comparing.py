"""A comparison of models in a Blender scene, with Cycles as the renderer."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import bpy

from ..compare.measure import Options
from ..compare.results import Comparison
from ..compare.run import Candidate
from ..compare.run import compare as compare_models
from ..core.control import Control
from ..core.errors import number
from ..models.model import Value
from . import work
from .camera_reader import image_size
from .cycles import CyclesRenderer

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
    full_width, full_height = image_size(scene)
    across = round(number("width", width or full_width, 8, 65536, "pixels"))
    down = max(1, round(across * full_height / full_width))
    renderer = CyclesRenderer(reading.scene, across, down, scene)
    candidates = [Candidate(model, values) for model, values in models.items()]
    return compare_models(renderer, candidates, options, directory, control)
