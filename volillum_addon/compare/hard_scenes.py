"""The catalogue of hard scenes: presets/hard_cases/*.json, data in a small vocabulary.

A file holds a `summary` and `cases`; a case its `id`, what makes it `hard`, what `holds`, and parts
that stand in for the defaults below:

    medium      Matter: a pattern of voxels of one optical depth, on a lattice of any affine
    lights      a list of Lamp
    camera      Eye
    parameters  name -> value, or "minimum" or "maximum" of its range, for the models that have it

Places are in voxels, so that a scene keeps its meaning on any lattice.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.camera import Camera
from ..core.errors import InputError, bad, choice
from ..core.grid import Grid
from ..core.lights import DistantLight, EnvironmentLight, Light, PointLight
from ..core.medium import Medium
from ..core.scene import Scene
from ..models.model import Model, Value
from ..resources import PRESETS

FOLDER = PRESETS / "hard_cases"
Vector = tuple[float, float, float]
PATTERNS = (
    "uniform", "voxel", "noise", "blob", "checkerboard", "sinusoid", "shell", "step", "spikes",
)  # fmt: skip
LAMPS = ("distant", "point", "environment", "image")
# Every `SPIKE_EVERY`-th voxel of "spikes" is `spike`; the seed of what is random.
SPIKE_EVERY, SEED = 29, 7


@dataclass(frozen=True)
class Matter:
    """The medium. `depth` is the optical depth of a voxel of value 1 along its mean edge; `axes`
    are the world vectors of the index axes; `half` rounds what is stored to 16 bits."""

    shape: tuple[int, int, int] = (7, 6, 8)
    pattern: str = "blob"
    depth: float = 0.5
    albedo: float | Vector = 0.8
    colour: float | Vector = 1.0
    g: float = 0.0
    glow: float = 0.0
    spike: float = 1.0
    wave: Vector = (1.0, 0.0, 0.0)
    axes: tuple[Vector, Vector, Vector] = ((0.1, 0.0, 0.0), (0.0, 0.1, 0.0), (0.0, 0.0, 0.1))
    origin: Vector = (0.0, 0.0, 0.0)
    half: bool = False

    def __post_init__(self) -> None:
        choice("pattern", self.pattern, PATTERNS)

    def medium(self) -> Medium:
        """The grids: extinction, scattering, and (1 - albedo) extinction times `glow` emitted."""
        affine = np.eye(4)
        affine[:3, :3] = np.array(self.axes).T
        affine[:3, 3] = self.origin
        density = Grid(self.values().astype(np.float32), affine, "density")
        scale = self.depth / float(density.voxel_size.mean()) * np.asarray(self.colour)
        medium = Medium.from_density(density, scale, self.albedo)
        sigma_t, sigma_s = medium.sigma_t, medium.sigma_s
        if self.half:
            sigma_t, sigma_s = _in_half(sigma_t), _in_half(sigma_s)
            sigma_s = sigma_s.with_values(np.minimum(*_alike(sigma_s, sigma_t)))
        emission = None
        if self.glow > 0:
            emission = sigma_t.with_values(
                np.subtract(*_alike(sigma_t, sigma_s)) * np.float32(self.glow)
            )
        return Medium(sigma_t, sigma_s, emission, self.g)

    def values(self) -> NDArray[np.float64]:
        """Relative density, [i, j, k]."""
        i, j, k = np.meshgrid(*map(np.arange, self.shape), indexing="ij")
        middle = (np.array(self.shape) - 1) / 2
        away = np.stack([i, j, k], axis=-1) - middle
        random = np.random.default_rng(SEED)
        match self.pattern:
            case "uniform":
                return np.ones(self.shape)
            case "voxel":
                lone = np.zeros(self.shape)
                lone[tuple(n // 2 for n in self.shape)] = 1
                return lone
            case "noise":
                return random.random(self.shape)
            case "blob":
                reach = np.maximum(np.array(self.shape) / 4, 1)
                return np.asarray(np.exp(-((away / reach) ** 2).sum(axis=-1)))
            case "checkerboard":
                return np.asarray((i + j + k) % 2 == 0, np.float64)
            case "sinusoid":
                phase = np.stack([i, j, k], axis=-1) @ np.array(self.wave)
                return np.asarray(0.5 + 0.5 * np.cos(math.pi * phase))
            case "shell":
                radius = min(self.shape) / 2 - 1
                return np.asarray(np.abs(np.linalg.norm(away, axis=-1) - radius) <= 0.5, np.float64)
            case "step":
                return np.asarray(i < self.shape[0] // 2, np.float64)
            case _:
                spiky = np.full(self.shape, 1.0)
                spiky.reshape(-1)[SPIKE_EVERY // 2 :: SPIKE_EVERY] = self.spike
                return spiky


def _alike(*grids: Grid) -> list[NDArray[np.float32]]:
    """Their values with as many channels as any of them has."""
    most = max(grid.values.ndim for grid in grids)
    return [grid.values if grid.values.ndim == most else grid.values[..., None] for grid in grids]


def _in_half(grid: Grid) -> Grid:
    """What 16 bits keep of the values (65504 at most)."""
    largest = float(np.finfo(np.float16).max)
    return grid.with_values(np.minimum(grid.values, largest).astype(np.float16).astype(np.float32))


@dataclass(frozen=True)
class Lamp:
    """A light. distant: `toward` is a world direction, in degrees `angle` across; point: `at`, in
    voxels, of a fluence `strength` at the middle of the grid; environment: even; image: `pixels` by
    2 `pixels` of `strength`, the first of them `sun`."""

    kind: str
    strength: float | Vector = 1.0
    toward: Vector = (0.3, -0.5, 0.8)
    angle: float = 5.0
    at: Vector = (0.0, 0.0, 0.0)
    pixels: int = 8
    sun: float = 1.0

    def __post_init__(self) -> None:
        choice("light", self.kind, LAMPS)

    def light(self, grid: Grid) -> Light:
        """The light in this lattice."""
        if self.kind == "distant":
            # Irradiance of the fluence 4 pi: its unoccluded in-scattered radiance is `strength`.
            spread = (1 + math.cos(math.radians(self.angle) / 2)) / 2
            irradiance = 4 * math.pi * spread * np.asarray(self.strength)
            return DistantLight(self.toward, irradiance, math.radians(self.angle))
        if self.kind == "point":
            place = grid.to_world(np.array(self.at, np.float64))
            squared = float(np.sum((grid.centre - place) ** 2))
            return PointLight(place, 4 * math.pi * squared * np.asarray(self.strength))
        if self.kind == "environment":
            return EnvironmentLight(np.broadcast_to(np.asarray(self.strength), (3,)))
        image = np.empty((self.pixels, 2 * self.pixels, 3))
        image[:] = self.strength
        image[self.pixels // 4, self.pixels // 3] = self.sun
        return EnvironmentLight(image)


@dataclass(frozen=True)
class Eye:
    """The camera, in voxels; it looks at the middle of the grid unless `look_at` is given."""

    at: Vector = (30.0, -60.0, 40.0)
    look_at: Vector | None = None
    orthographic: bool = False

    def camera(self, grid: Grid) -> Camera:
        """The camera in this lattice; up is whatever is not along the view."""
        place = grid.to_world(np.array(self.at, np.float64))
        target = grid.centre
        if self.look_at is not None:
            target = grid.to_world(np.array(self.look_at, np.float64))
        forward = np.abs(target - place)
        up = np.eye(3)[int(np.argmin(forward))]
        extent = float(np.ptp(grid.corners(), axis=0).max())
        return Camera(place, target, up, orthographic=self.orthographic, height=extent)


SUN_AND_SKY = (Lamp("distant"), Lamp("environment", strength=0.3))


@dataclass(frozen=True)
class HardCase:
    """One entry of the catalogue."""

    id: str
    hard: str
    holds: str
    medium: Matter = field(default_factory=Matter)
    lights: tuple[Lamp, ...] = SUN_AND_SKY
    camera: Eye = field(default_factory=Eye)
    parameters: Mapping[str, Value] = field(default_factory=dict)
    group: str = ""

    def scene(self) -> Scene:
        """The scene; InputError where the entry's numbers do not make one."""
        medium = self.medium.medium()
        grid = medium.sigma_t
        lights = tuple(lamp.light(grid) for lamp in self.lights)
        return Scene(medium, lights, self.camera.camera(grid))

    def given(self, model: Model) -> dict[str, Value]:
        """The parameters that this model has, with what lies beyond its range at the nearest end:
        one name may have another meaning and unit in each model."""
        found: dict[str, Value] = {}
        for parameter in model.parameters:
            if parameter.name in self.parameters:
                value = self.parameters[parameter.name]
                ends = {"minimum": parameter.minimum, "maximum": parameter.maximum}
                found[parameter.name] = (
                    ends.get(value, value)
                    if isinstance(value, str)
                    else min(max(value, parameter.minimum), parameter.maximum)
                )
        return found


def catalogue() -> tuple[HardCase, ...]:
    """All cases, by file; InputError for a file that is not as expected."""
    cases = [case for path in sorted(FOLDER.glob("*.json")) for case in read(path)]
    ids = [case.id for case in cases]
    for each in ids:
        if ids.count(each) > 1:
            raise bad("hard case", repr(each), "one entry of this id")
    return tuple(cases)


def read(path: Path) -> tuple[HardCase, ...]:
    """The cases of one file."""
    try:
        raw = json.loads(path.read_text(encoding="utf-8"))
        return tuple(_case(entry, path.stem) for entry in raw["cases"])
    except json.JSONDecodeError as error:
        raise InputError(f"{path.name} is not JSON: {error}; expected hard cases") from error
    except (KeyError, TypeError) as error:
        names = ", ".join(each.name for each in fields(HardCase))
        raise InputError(f"{path.name}: {error}; expected hard cases of {names}") from error


def _case(entry: Mapping[str, Any], group: str) -> HardCase:
    parts = {name: _frozen(part) for name, part in entry.items()}
    if "medium" in parts:
        parts["medium"] = Matter(**parts["medium"])
    if "lights" in parts:
        parts["lights"] = tuple(Lamp(**lamp) for lamp in parts["lights"])
    if "camera" in parts:
        parts["camera"] = Eye(**parts["camera"])
    return HardCase(**parts, group=group)


def _frozen(part: Any) -> Any:
    """Lists become tuples."""
    if isinstance(part, list):
        return tuple(_frozen(each) for each in part)
    if isinstance(part, dict):
        return {name: _frozen(each) for name, each in part.items()}
    return part
