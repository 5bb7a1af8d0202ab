"""Scene presets: what a demonstration scene around a volume looks like, as data.

A preset is `presets/scenes/<name>.json`. Angles are in degrees; azimuths run about the vertical
from the camera's default place in front (-y) toward the right (+x); lengths follow the volume.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, Literal, get_args

from ..core.errors import InputError, bad, choice, colour, number
from ..resources import PRESETS

FOLDER = PRESETS / "scenes"
Axis = Literal["x", "y", "z", "-x", "-y", "-z"]
Background = Literal["transparent", "world"]
Rgb = tuple[float, float, float]


@dataclass(frozen=True)
class Sun:
    """A distant light: where it stands, its irradiance (W/m^2) and full angular diameter."""

    azimuth: float
    elevation: float
    irradiance: Rgb
    angle: float

    def __post_init__(self) -> None:
        number("sun azimuth", self.azimuth, -360, 360, "degrees")
        number("sun elevation", self.elevation, -90, 90, "degrees")
        number("sun angle", self.angle, 0, 180, "degrees")
        object.__setattr__(self, "irradiance", _rgb("sun irradiance", self.irradiance))


@dataclass(frozen=True)
class Sky:
    """A constant sky of this radiance (W/m^2/sr)."""

    radiance: Rgb

    def __post_init__(self) -> None:
        object.__setattr__(self, "radiance", _rgb("sky radiance", self.radiance))


@dataclass(frozen=True)
class View:
    """A perspective camera that frames the volume, leaving `margin` of the image free each side."""

    azimuth: float
    elevation: float
    lens: float
    margin: float

    def __post_init__(self) -> None:
        number("camera azimuth", self.azimuth, -360, 360, "degrees")
        number("camera elevation", self.elevation, -89, 89, "degrees")
        number("camera lens", self.lens, 1, 1000, "mm")
        number("camera margin", self.margin, 0, 0.45, "of the image")


@dataclass(frozen=True)
class Substance:
    """The medium: `optical_depth` along the densest line of voxels, and its albedo."""

    optical_depth: float
    albedo: Rgb

    def __post_init__(self) -> None:
        number("optical depth", self.optical_depth, 1e-6, 1e6)
        object.__setattr__(self, "albedo", _rgb("albedo", self.albedo))
        if max(self.albedo) > 1:
            raise bad("albedo", list(self.albedo), "0 to 1")


@dataclass(frozen=True)
class Picture:
    """The image: its size in pixels, and whether the sky is seen behind the volume."""

    width: int
    height: int
    background: Background

    def __post_init__(self) -> None:
        for name in ("width", "height"):
            size = number(f"image {name}", getattr(self, name), 4, 65536, "pixels")
            object.__setattr__(self, name, round(size))
        choice("background", self.background, get_args(Background))


@dataclass(frozen=True)
class ScenePreset:
    """All of a demonstration scene but the volume; `up` is the file's axis that points upward.
    `medium` is None where the volume brings its own coefficients."""

    summary: str
    up: Axis
    sun: Sun
    sky: Sky
    camera: View
    image: Picture
    medium: Substance | None = None

    def __post_init__(self) -> None:
        choice("up", self.up, get_args(Axis))


_PARTS = {"medium": Substance, "sun": Sun, "sky": Sky, "camera": View, "image": Picture}


def names() -> tuple[str, ...]:
    """The presets there are."""
    return tuple(sorted(path.stem for path in FOLDER.glob("*.json")))


def load(name: str) -> ScenePreset:
    """The preset `name`; InputError for an unknown name or a file that is not as expected."""
    choice("preset", name, names())
    path = FOLDER / f"{name}.json"
    try:
        raw = json.loads(path.read_text(encoding="utf-8"))
    except json.JSONDecodeError as error:
        raise InputError(f"{path.name} is not JSON: {error}; expected a scene preset") from error
    return parsed(raw, path.name)


def parsed(raw: Mapping[str, Any], where: str) -> ScenePreset:
    """The preset of JSON values found in the file `where`."""
    try:
        return ScenePreset(
            **{key: _PARTS[key](**value) if key in _PARTS else value for key, value in raw.items()}
        )
    except TypeError as error:
        expected = ", ".join(field.name for field in fields(ScenePreset))
        raise InputError(f"{where}: {error}; expected a scene preset of {expected}") from error


def _rgb(what: str, value: object) -> Rgb:
    red, green, blue = colour(what, value)  # type: ignore[arg-type]
    return float(red), float(green), float(blue)
