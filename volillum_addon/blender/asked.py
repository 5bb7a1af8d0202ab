"""What a user of the panel asks for: the scene's settings as they are when work begins."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import bpy

from ..core.errors import InputError
from ..models.model import Value
from .places import output_directory
from .properties import chosen_model, model_values


def scene_named(name: str) -> bpy.types.Scene:
    """The scene of work that has ended; InputError where it was removed meanwhile."""
    scene = bpy.data.scenes.get(name)
    if scene is None:
        raise InputError(f"scene {name!r} is gone; expected it where the result belongs")
    return scene


@dataclass(frozen=True)
class Asked:
    """The scene's name, the model or composition with its parameters, and where files go."""

    name: str
    model: str
    values: Mapping[str, Value]
    directory: Path

    @classmethod
    def of(cls, scene: bpy.types.Scene) -> Asked:
        """Read the settings. Raises InputError."""
        settings = scene.volillum
        model = chosen_model(settings)
        values = model_values(settings, model)
        return cls(scene.name, model, values, output_directory(settings.directory))

    @property
    def scene(self) -> bpy.types.Scene:
        """The scene, when the work has ended."""
        return scene_named(self.name)
