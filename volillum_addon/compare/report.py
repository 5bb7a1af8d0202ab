"""report.json: a comparison as data. `report.schema.json` beside it documents every field."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..bake.store import replacing
from ..core.scene import Scene
from .metrics import Figure
from .reference import Reference
from .results import Comparison, Measured, ModelResult, Timing

# Raised when a field is added; fields are never renamed.
SCHEMA_VERSION = 1
SCHEMA = Path(__file__).with_name("report.schema.json")
ERRORS = ("numerical_field", "numerical", "model", "total", "display")
SECONDS = ("whole", "bake", "hand_over", "display")


def as_json(comparison: Comparison) -> dict[str, Any]:
    """The comparison as JSON values, valid by the schema."""
    truncation = comparison.truncation
    return {
        "schema": SCHEMA_VERSION,
        "scene": _scene(comparison),
        "machine": dict(comparison.machine),
        "versions": dict(comparison.versions),
        "references": {
            "single": _reference(comparison.single),
            "full": _reference(comparison.full)
            | {
                "convergence": {
                    "half_bounces": truncation.half,
                    "gain": truncation.gain,
                    "noise": truncation.noise,
                }
            },
        },
        "models": [_model(model) for model in comparison.models],
        "baselines": [],
    }


def write(comparison: Comparison, path: Path) -> None:
    """Write report.json, whole or not at all."""
    text = json.dumps(as_json(comparison), indent=2, allow_nan=False) + "\n"
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def _scene(comparison: Comparison) -> dict[str, Any]:
    scene: Scene = comparison.scene
    grid, camera = scene.medium.sigma_t, scene.need_camera()
    albedo = scene.medium.constant_albedo
    height, width = comparison.mask.shape
    return {
        "name": comparison.name,
        "voxels": list(grid.shape),
        "voxel_size": _numbers(grid.voxel_size),
        "extinction_channels": grid.channels,
        "optical_depth": {
            axis: float(grid.planes().mean(axis=0).sum(axis=index).max() * grid.voxel_size[index])
            for index, axis in enumerate("ijk")
        },
        "albedo": None if albedo is None else _numbers(albedo),
        "anisotropy": scene.medium.g,
        "emission": scene.medium.emission is not None,
        "lights": [
            {"kind": light.kind, "fluence": _numbers(light.fluence(grid.centre))}
            for light in scene.lights
        ],
        "camera": {
            "position": _numbers(camera.eye),
            "forward": _numbers(camera.forward),
            "orthographic": camera.orthographic,
            "fov": None if camera.orthographic else camera.fov,
        },
        "width": width,
        "height": height,
        "silhouette_pixels": int(comparison.mask.sum()),
    }


def _reference(reference: Reference) -> dict[str, Any]:
    return {
        "bounces": reference.bounces,
        "samples": reference.samples,
        "seeds": reference.seeds,
        "seconds": reference.seconds,
        "noise": reference.noise,
    }


def _model(model: ModelResult) -> dict[str, Any]:
    found = model.measured
    return {
        "id": model.id,
        "label": model.label,
        "citation": model.citation,
        "variant": model.variant,
        "parameters": {name: _value(value) for name, value in model.parameters.items()},
        "left_out": list(model.left_out),
        "reason": model.reason,
        "image": model.file if found else None,
    } | (_measured(found) if found else dict.fromkeys(_MEASURED) | {"errors": _errors({})})


_MEASURED = (
    "seconds", "peak_bytes", "exposure", "errors_after_exposure", "witness",
)  # fmt: skip


def _measured(found: Measured) -> dict[str, Any]:
    witness = found.witness
    return {
        "seconds": {name: _timing(getattr(found.seconds, name)) for name in SECONDS}
        | {"total": found.seconds.total},
        "peak_bytes": found.peak_bytes,
        "errors": _errors(found.errors),
        "exposure": {"factor": found.exposure.factor, "noise": found.exposure.noise},
        "errors_after_exposure": {"total": _figure(found.total_after_exposure)},
        "witness": None
        if witness is None
        else {
            "mean_z_squared": witness.mean_z_squared,
            "spread": witness.spread,
            "bias_z": witness.bias_z,
            "blocks": witness.blocks,
            "agrees": witness.agrees,
        },
    }


def _errors(errors: Mapping[str, Figure]) -> dict[str, Any]:
    return {name: _figure(errors[name]) if name in errors else None for name in ERRORS}


def _figure(figure: Figure) -> dict[str, Any]:
    return {
        "relative_rmse": figure.relative_rmse,
        "noise": figure.noise,
        "bias": figure.bias,
        "bias_noise": figure.bias_noise,
        "is_bound": figure.is_bound,
    }


def _timing(timing: Timing) -> dict[str, Any]:
    return {"median": timing.median, "count": len(timing.seconds)}


def _numbers(values: np.ndarray) -> list[float]:
    return [float(value) for value in values]


def _value(value: object) -> object:
    # JSON has no infinity (a radius without limit): it is written as the word.
    return str(value) if isinstance(value, float) and not math.isfinite(value) else value
