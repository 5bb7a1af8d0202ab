"""Transfer functions as files: presets/transfer_functions/<name>.json.

`points` are [value, density, red, green, blue]; `per_voxel` is the optical depth of a voxel of
density 1 (with `physical`: its extinction per unit of length). `kind` says what data it is for. A
`relative` one has values from 0, the data's background, to 1, where all but its brightest voxels
end: for kinds whose numbers have no scale.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ..core.errors import InputError, bad, choice
from ..core.transfer_function import TransferFunction
from ..resources import PRESETS
from .imported import About

FOLDER = PRESETS / "transfer_functions"
# The share of the voxels above the background that end below the value 1 of a relative preset.
BRIGHTEST = 0.998
# What is taken for a volume that nobody has chosen for, by its kind.
DEFAULTS = {"ct": "ct_bone", "mr": "mri", "microscopy": "microscopy", "cloud": "cloud"}
# Of other kinds: what is stored as floats is mostly a density, as integers mostly a scan.
FLOATS, INTEGERS = "smoke", "solid"


def names() -> tuple[str, ...]:
    """The presets there are."""
    return tuple(sorted(path.stem for path in FOLDER.glob("*.json")))


def load(name: str, about: About) -> TransferFunction:
    """The preset `name`, fitted to a volume where it is a relative one. Raises InputError."""
    choice("transfer function", name, names())
    return load_file(FOLDER / f"{name}.json", about)


def load_file(path: Path, about: About) -> TransferFunction:
    """The transfer function of a preset's file. Raises InputError for a file that is none."""
    try:
        entry = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(f"{path} cannot be read ({error}); expected a transfer function") from None
    if not isinstance(entry, dict):
        raise bad(str(path), "not an object", "a transfer function")
    try:
        return fitted(entry, about)
    except (TypeError, ValueError) as error:
        raise InputError(f"{error} (in {path})") from None


def fitted(entry: Mapping[str, Any], about: About) -> TransferFunction:
    """A preset's entries as a transfer function of the volume's own values."""
    found = TransferFunction.from_json(entry)
    if not entry.get("relative", False):
        return found
    low, scale = span(about)
    return replace(found, values=low + scale * np.asarray(found.values))


def span(about: About) -> tuple[float, float]:
    """Where the values of a relative preset begin in a volume, and how far they go."""
    low, high = about.background, about.quantile(BRIGHTEST)
    return low, high - low if high > low else 1.0


def default_name(about: About) -> str:
    """The preset for a volume that nobody has chosen for."""
    if about.kind in DEFAULTS and (about.kind != "ct" or about.unit == "HU"):
        return DEFAULTS[about.kind]
    return FLOATS if np.dtype(about.stored).kind == "f" else INTEGERS
