"""The scene: medium, lights, camera."""

from __future__ import annotations

from dataclasses import dataclass, replace

from .camera import Camera
from .errors import bad
from .grid import Region
from .lights import (
    AreaLight,
    DistantLight,
    EnvironmentLight,
    Light,
    PointLight,
    SpotLight,
    shines,
)
from .medium import Medium
from .view import seen_region

LIGHT_TYPES = (DistantLight, PointLight, SpotLight, AreaLight, EnvironmentLight)


@dataclass(frozen=True, eq=False)
class Scene:
    """What is rendered. The camera may be missing until a model or an image needs it.

    `seen_only`: the illumination is for the camera's view alone. `wanted` is then the box of voxels
    whose illumination counts, of a trimmed scene; what a model makes of the others is left out.
    """

    medium: Medium
    lights: tuple[Light, ...]
    camera: Camera | None = None
    seen_only: bool = False
    wanted: Region | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "lights", tuple(self.lights))
        if not isinstance(self.medium, Medium):
            raise TypeError(f"medium is a {type(self.medium).__name__}; expected a Medium")
        for index, light in enumerate(self.lights):
            if not isinstance(light, LIGHT_TYPES):
                raise TypeError(f"light {index} is a {type(light).__name__}; expected a light")
        if not self.lights and self.medium.emission is None:
            raise bad("the scene's number of lights", 0, "a light, a world or an emitting medium")

    def need_camera(self) -> Camera:
        """The camera, or an InputError that says that one is needed."""
        if self.camera is None:
            raise bad("the scene's camera", "missing", "one that looks at the volume")
        return self.camera

    def trimmed(self, margin: int) -> Scene:
        """The scene with `Medium.trimmed` and without lights of no strength."""
        lights = tuple(light for light in self.lights if shines(light))
        medium = self.medium.trimmed(margin)
        wanted = None
        if self.seen_only:
            wanted = seen_region(self.need_camera(), medium.sigma_t, margin)
        return replace(self, medium=medium, lights=lights, wanted=wanted)
