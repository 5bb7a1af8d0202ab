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


class Held:
    """A scene over time: undo replaces it, and it may be renamed or removed meanwhile."""

    def __init__(self, scene: bpy.types.Scene) -> None:
        self.name, self._uid = scene.name, scene.session_uid

    def holds(self, scene: bpy.types.Scene) -> bool:
        """Whether it is this one."""
        return bool(scene.session_uid == self._uid)

    def get(self) -> bpy.types.Scene:
        """The scene as it is now. Raises InputError when it is gone."""
        for scene in bpy.data.scenes:
            if self.holds(scene):
                return scene
        raise InputError(f"scene {self.name!r} is gone; expected it where the result belongs")


@dataclass(frozen=True)
class Asked:
    """The scene, the model or composition with its parameters, and where files go."""

    held: Held
    model: str
    values: Mapping[str, Value]
    directory: Path

    @classmethod
    def of(cls, scene: bpy.types.Scene) -> Asked:
        """Read the settings. Raises InputError."""
        settings = scene.volillum
        model = chosen_model(settings)
        values = model_values(settings, model)
        return cls(Held(scene), model, values, output_directory(settings.directory))

    @property
    def name(self) -> str:
        """The scene's name, when the work began."""
        return str(self.held.name)

    @property
    def scene(self) -> bpy.types.Scene:
        """The scene, when the work has ended."""
        return self.held.get()
