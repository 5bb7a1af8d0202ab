"""The file of a progressive photon run: what has been counted, and of which inputs."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Sequence
from hashlib import blake2b
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError, bad
from ..core.lights import light_shape
from ..core.scene import Scene
from .model import Values
from .photon_part import Part

FORMAT = 4


def write(path: Path | str, parts: Sequence[Part], inputs: str) -> None:
    """Write the parts' counts, whole or not at all (a temporary file, then renamed)."""
    target = Path(path)
    arrays: dict[str, NDArray[np.generic]] = {
        "format": np.array(FORMAT),
        "inputs": np.array(inputs),
        "passes": np.array([part.passes for part in parts]),
    }
    for index, part in enumerate(parts):
        arrays |= {f"{name}_{index}": values for name, values in part.counts().items()}
    handle, temporary = tempfile.mkstemp(dir=target.parent, suffix=".part")
    try:
        with os.fdopen(handle, "wb") as file:
            np.savez(file, **arrays)  # type: ignore[arg-type]
        Path(temporary).replace(target)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise


def read(path: Path | str, parts: Sequence[Part], inputs: str) -> None:
    """Give the parts the counts that `write` wrote for the same inputs.

    Raises InputError for a file that is not such a state, or one of other inputs.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            stored = dict(file)
    except (OSError, ValueError, EOFError) as error:
        raise InputError(f"{path} cannot be read ({error}); expected a saved state") from None
    if int(stored.get("format", -1)) != FORMAT:
        raise bad(f"{path}", "another file", "a state that this version saved")
    if str(stored["inputs"]) != inputs:
        raise bad(f"{path}'s inputs", "others", "this scene, photons, seed and estimate")
    for index, part in enumerate(parts):
        for name in part.counts():
            setattr(part, name, stored[f"{name}_{index}"])
        part.passes = int(stored["passes"][index])


def fingerprint(scene: Scene, values: Values) -> str:
    """Of all that photons depend on."""
    digest = blake2b(digest_size=16)
    medium = scene.medium
    for grid in (medium.sigma_t, medium.sigma_s, medium.emission):
        if grid is not None:
            digest.update(repr(grid.values.shape).encode() + grid.index_to_world.tobytes())
            digest.update(grid.planes())
    names = ["photons", "noise_seed", "estimate"]
    if values["estimate"] == "kernel":
        names += ["radius", "alpha"]
    digest.update(repr((medium.g, [values[name] for name in names])).encode())
    for light in scene.lights:
        digest.update(light.kind.encode())
        for name, value in light_shape(light):
            digest.update(name.encode() + np.asarray(value, np.float64).tobytes())
    return digest.hexdigest()
