"""Models' errors in the field, against one photon map of the scene as it is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import bpy

from ..bake.error_file import REFERENCE, FieldError, error_file, reference_file
from ..core.control import Control
from ..models.model import Value
from . import work
from .scene_reader import Reading

# Share of the progress that the reference takes.
REFERENCE_SHARE = 0.7


@dataclass(frozen=True)
class Wanted:
    """How good the reference has to be: its relative noise and time, and a seed of its own."""

    noise: float
    seconds: float
    seed: int

    @classmethod
    def of(cls, scene: bpy.types.Scene) -> Wanted:
        """As the scene's settings for references say."""
        settings = scene.volillum
        # With the same photons as a bake the reference would share its noise.
        seed = getattr(settings, REFERENCE).noise_seed ^ 1
        return cls(settings.noise / 100, settings.budget, seed)


def measure(
    reading: Reading,
    chosen: Mapping[str, Mapping[str, Value]],
    wanted: Wanted,
    directory: Path,
    control: Control,
) -> tuple[work.Bakes, list[FieldError]]:
    """Bake the models that can serve the scene, and their errors. Any thread. Raises InputError
    where none can, Cancelled."""
    with control.stage(0, 1 - REFERENCE_SHARE, "baking"):
        bakes = work.bake_all(reading, chosen, directory, control)
    with control.stage(1 - REFERENCE_SHARE, 1, "full scattering"):
        reference = reference_file(
            reading.scene, directory, reading.stem, wanted.noise, wanted.seconds, wanted.seed,
            control,
        )  # fmt: skip
    return bakes, [error_file(reading.scene, each.path, reference) for each in bakes.done]
