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
from .figures import FRAMES, BreakEven, Reach, summary
from .flip import Flip
from .metrics import Figure
from .reference import Reference
from .results import Baseline, Comparison, Measured, ModelResult, Timing

# Raised when a field is added; fields are never renamed.
SCHEMA_VERSION = 3
SCHEMA = Path(__file__).with_name("report.schema.json")
ERRORS = ("numerical_field", "numerical", "model", "total", "display")
SECONDS = ("whole", "bake", "hand_over", "display")


def as_json(comparison: Comparison) -> dict[str, Any]:
    """The comparison as JSON values, valid by the schema."""
    truncation, found = comparison.truncation, summary(comparison)
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
        "baselines": [_baseline(baseline) for baseline in comparison.baselines],
        "time_to_error": [
            {
                "series": one.id,
                "label": one.label,
                "targets": [_reach(reach) for reach in reaches],
            }
            for one, reaches in zip(found.series, found.reaches, strict=True)
        ],
        "break_even": [
            {"series": one.id, "label": one.label} | _break_even(move)
            for one, move in zip(found.models, found.break_even, strict=True)
        ],
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
        "ladder": [
            {
                "settings": {name: _value(value) for name, value in rung.settings.items()},
                "reason": rung.reason,
            }
            | (_measured(rung.measured) if rung.measured else _nothing())
            for rung in model.ladder
        ],
    } | (_measured(found) if found else _nothing())


def _nothing() -> dict[str, Any]:
    fields = ("seconds", "peak_bytes", "exposure", "errors_after_exposure", "flip", "witness")
    return dict.fromkeys(fields) | {"errors": _errors({}), "savings": []}


def _measured(found: Measured) -> dict[str, Any]:
    witness = found.witness
    return {
        "seconds": {name: _timing(getattr(found.seconds, name)) for name in SECONDS}
        | {"total": found.seconds.total},
        "peak_bytes": found.peak_bytes,
        "errors": _errors(found.errors),
        "exposure": {"factor": found.exposure.factor, "noise": found.exposure.noise},
        "errors_after_exposure": {"total": _figure(found.total_after_exposure)},
        "flip": None if found.flip is None else _flip(found.flip),
        "savings": [
            {"lacks": each.what, "seconds_ratio": each.seconds, "stored_ratio": each.stored}
            for each in found.savings
        ],
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


def _baseline(baseline: Baseline) -> dict[str, Any]:
    way, found = baseline.way, baseline.measured
    return {
        "id": way.id,
        "label": way.label,
        "samples": baseline.samples,
        "biased": way.biased,
        "denoised": way.denoised,
        "reason": baseline.reason,
        "seconds": found.seconds.median if found else None,
        "count": len(found.seconds.seconds) if found else None,
        "errors": {"total": _figure(found.total) if found else None},
        "exposure": {"factor": found.exposure.factor, "noise": found.exposure.noise}
        if found
        else None,
        "errors_after_exposure": {"total": _figure(found.total_after_exposure)} if found else None,
        "flip": _flip(found.flip) if found else None,
    }


def _reach(found: Reach) -> dict[str, Any]:
    return {
        "relative_rmse": found.target,
        "seconds": found.seconds,
        "how": found.how,
        "best": _figure(found.best),
    }


def _break_even(found: BreakEven) -> dict[str, Any]:
    return {
        "seconds_once": found.once,
        "seconds_each_frame": found.each,
        "frames": [
            {"frames": count, "seconds": seconds}
            for count, seconds in zip(FRAMES, found.seconds, strict=True)
        ],
        "path_tracing": None
        if found.traced is None
        else {"label": found.traced_by, "seconds": found.traced.seconds, "how": found.traced.how},
        "break_even_frames": found.frames,
    }


def _flip(flip: Flip) -> dict[str, Any]:
    return {"mean": flip.value, "noise": flip.noise, "is_bound": flip.is_bound}


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
