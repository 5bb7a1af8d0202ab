"""Finished parts of a comparison on disk, found again by a hash of all that they depend on."""

from __future__ import annotations

import hashlib
import json
import zipfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..bake.store import replacing


def key_of(parts: dict[str, object]) -> str:
    """16 hexadecimal digits of JSON values and arrays, equal for equal parts."""
    text = json.dumps(parts, sort_keys=True, default=_digest)
    return hashlib.blake2b(text.encode(), digest_size=8).hexdigest()


def _digest(value: object) -> object:
    if isinstance(value, np.ndarray):
        held = np.ascontiguousarray(value)
        digest = hashlib.blake2b(held.tobytes(), digest_size=16).hexdigest()
        return [str(held.dtype), list(held.shape), digest]
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"{type(value).__name__} cannot be hashed; expected JSON values or arrays")


def load(path: Path) -> dict[str, NDArray[np.float64]] | None:
    """The arrays of a stored part; None when there is none that can be read."""
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as held:
            return {name: held[name] for name in held.files}
    except (FileNotFoundError, zipfile.BadZipFile, EOFError, ValueError, KeyError):
        return None


def store(path: Path, **arrays: NDArray[np.floating] | float) -> None:
    """Store a part under its name, all at once. Raises StorageError."""
    with replacing(path) as temporary, temporary.open("wb") as file:
        np.savez(file, allow_pickle=False, **{k: np.asarray(v) for k, v in arrays.items()})
