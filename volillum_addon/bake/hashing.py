"""The digest of everything that a bake's file depends on, and of each part of it.

The lights' brightness is no part unless a model says so: relighting a bake is free (`relight`).
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping
from hashlib import blake2b
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import ArrayLike

from .. import __version__
from ..core.colour import luminance
from ..core.grid import Grid
from ..core.lights import Light, light_shape
from ..core.scene import Scene
from ..models.model import Model, Values
from ..models.operator import highest_band

# Raised when a kernel or model gives other values for the same input.
KERNEL_REVISION = 15
# Directions that agree to this many decimals are one: a moved orthographic camera has the same
# view direction but for its rounding.
DIRECTION_DECIMALS = 9
DIGEST_BYTES = 8


def input_digests(scene: Scene, model: Model, values: Values, half: bool) -> dict[str, str]:
    """The digest of each part, by the part's name; `scene` is trimmed.

    The medium's grids are parts of every bake because its file holds them. Comparing two of these
    says what has changed.
    """
    medium = scene.medium
    digests = {
        "extinction": _grid(medium.sigma_t),
        "scattering": _grid(medium.sigma_s),
        "emission": _grid(medium.emission) if medium.emission is not None else _digest("none"),
        "parameters": _digest(json.dumps(dict(values), sort_keys=True)),
        "program": _digest(f"{model.id} {KERNEL_REVISION} {__version__} {'half' if half else ''}"),
    }
    for part in (model.rebakes_on(values) | ALSO_SEEN_ONLY[scene.seen_only]) - digests.keys():
        digests[part] = PARTS[part](scene, model)
    return dict(sorted(digests.items()))


def combined(digests: Mapping[str, str] | Iterable[str]) -> str:
    """One digest of several: of a bake's parts, or of the frames of a sequence."""
    if isinstance(digests, Mapping):
        digests = [f"{name}={digest}" for name, digest in sorted(digests.items())]
    return _digest("\n".join(digests))


def _light_directions(scene: Scene, model: Model) -> str:
    """Kinds, directions and positions of the lights that the model represents, in order."""
    digest = blake2b(digest_size=DIGEST_BYTES)
    for light in model.represented(scene):
        digest.update(light.kind.encode() + b"\0")
        if hasattr(light, "direction"):
            digest.update(_direction(light.direction))
        if hasattr(light, "position"):
            digest.update(_bytes(light.position))
    return digest.hexdigest()


def _lights(scene: Scene, model: Model) -> str:
    """Everything of the lights that the model represents, in order."""
    return combined(_light(light) for light in model.represented(scene))


def _light_shapes(scene: Scene, model: Model) -> str:
    """Everything of the lights but their brightness; an image's pixels are its shape."""
    return combined(_light_shape(light) for light in model.represented(scene))


def _once_a_light[Result](work: Callable[[Light], Result]) -> Callable[[Light], Result]:
    """The work done once for each light as long as it lives: an image's pixels take time, and a
    panel asks at every redraw. Lights never change."""
    known: WeakKeyDictionary[Light, Result] = WeakKeyDictionary()

    def result(light: Light) -> Result:
        if light not in known:
            known[light] = work(light)
        return known[light]

    return result


@_once_a_light
def _light(light: Light) -> str:
    return _named(light.kind, sorted(vars(light).items()))


@_once_a_light
def _light_shape(light: Light) -> str:
    return _named(light.kind, light_shape(light))


@_once_a_light
def _highest_band(light: Light) -> int:
    return highest_band(light)


def _named(kind: str, values: Iterable[tuple[str, Any]]) -> str:
    digest = blake2b(kind.encode() + b"\0", digest_size=DIGEST_BYTES)
    for name, value in values:
        digest.update(name.encode() + b"\0")
        digest.update(value.encode() if isinstance(value, str) else _numbers(value))
    return digest.hexdigest()


def _phase(scene: Scene, model: Model) -> str:
    """The phase function of the medium."""
    return _digest(_bytes(scene.medium.g))


def _light_hues(scene: Scene, model: Model) -> str:
    """Colours of the model's lights relative to their luminance; where the medium glows, as they
    are, because what counts there is their ratio to the glow."""
    digest = blake2b(digest_size=DIGEST_BYTES)
    for light in model.represented(scene):
        # A local light's distance is part of its place.
        rgb = getattr(light, "intensity", None)
        rgb = np.asarray(light.fluence(np.zeros(3)) if rgb is None else rgb)
        if scene.medium.emission is None and luminance(rgb) > 0:
            rgb = rgb / luminance(rgb)
        digest.update(_direction(rgb))
    return digest.hexdigest()


def _lit_bands(scene: Scene, model: Model) -> str:
    """The highest harmonic band in which the model's lights have energy, for each kind of them:
    parts of a composition know one kind each."""
    bands: dict[str, int] = {}
    for light in model.represented(scene):
        bands[light.kind] = max(bands.get(light.kind, 0), _highest_band(light))
    return _digest(json.dumps(bands, sort_keys=True))


def _camera(scene: Scene, model: Model) -> str:
    """What the direction toward the eye depends on: the eye, or an orthographic view's axis."""
    camera = scene.need_camera()
    if camera.orthographic:
        return _digest(b"orthographic" + _direction(camera.forward))
    return _digest(b"perspective" + _bytes(camera.eye))


def _view(scene: Scene, model: Model) -> str:
    """Everything that a camera's image depends on."""
    camera = scene.need_camera()
    span = camera.height if camera.orthographic else camera.fov
    axes = (camera.eye, camera.forward, camera.up, (span, camera.aspect or 0, *camera.shift))
    return _digest(f"{camera.orthographic}".encode() + b"".join(map(_direction, axes)))


# What a model may name in `rebake_on` and `rebake_when` beside the medium's grids.
PARTS: dict[str, Callable[[Scene, Model], str]] = {
    "light direction": _light_directions,
    "light": _lights,
    "light shape": _light_shapes,
    "phase function": _phase,
    "light hue": _light_hues,
    "highest lit band": _lit_bands,
    "camera": _camera,
    "view": _view,
}


# What a bake for the camera's view alone also depends on.
ALSO_SEEN_ONLY: dict[bool, frozenset[str]] = {False: frozenset(), True: frozenset({"view"})}


def _grid(grid: Grid) -> str:
    digest = blake2b(digest_size=DIGEST_BYTES)
    digest.update(_bytes(grid.values.shape) + _bytes(grid.index_to_world))
    for plane in grid.values:
        digest.update(np.ascontiguousarray(plane + np.float32(0)))
    return digest.hexdigest()


def _direction(vector: ArrayLike) -> bytes:
    return _bytes(np.round(np.asarray(vector, np.float64), DIRECTION_DECIMALS))


def _numbers(value: ArrayLike | None) -> bytes:
    """A number or an array with its shape; None counts as none at all."""
    return b"none" if value is None else _bytes(np.shape(value)) + _bytes(value)


def _bytes(numbers: ArrayLike) -> bytes:
    """As little-endian float64; adding 0 makes -0 the 0 that it equals."""
    return (np.asarray(numbers, np.float64) + 0.0).astype("<f8").tobytes()


def _digest(data: str | bytes) -> str:
    raw = data.encode() if isinstance(data, str) else data
    return blake2b(raw, digest_size=DIGEST_BYTES).hexdigest()
