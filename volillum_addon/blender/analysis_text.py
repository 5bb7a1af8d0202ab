"""What a scene needs, in words and as JSON: what `volillum analyse` prints. Needs no bpy."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from ..compare.predict import Prediction, Predictions
from ..compare.recommend import Request
from ..core.analysis import Analysis, Depths, LightAnalysis
from ..models.features import concerned
from ..models.model import Model, Values
from ..models.registry import MODELS, get

Answers = Sequence[tuple[Request, Prediction | None]]


def as_json(found: Predictions, answers: Answers) -> dict[str, Any]:
    """Everything as JSON values; what has no bound is null."""
    return {
        "scene": scene_json(found.analysis),
        "absent": list(absent(found.analysis)),
        "models": [_model_json(get(id_), found) for id_ in _ids(found)],
        "recommendations": [
            {
                "error": request.error,
                "seconds": request.seconds,
                "answer": None if answer is None else prediction_json(answer),
            }
            for request, answer in answers
        ],
        "noise": found.noise,
        "seconds": found.seconds,
    }


def scene_json(scene: Analysis) -> dict[str, Any]:
    """The analysis as JSON values."""
    return {
        "shape": list(scene.shape),
        "matter": scene.matter,
        "channels": {
            "extinction": scene.extinction_channels,
            "scattering": scene.scattering_channels,
            "emission": scene.emission_channels,
        },
        "albedo": {"mean": scene.albedo[0], "largest": scene.albedo[1]},
        "g": scene.g,
        "dark_lights": scene.dark,
        "lights": [_light_json(light) for light in scene.lights],
        "optical_depth_of_view": None if scene.view is None else _depths_json(scene.view),
        "scattering_orders": scene.orders if math.isfinite(scene.orders) else None,
    }


def prediction_json(each: Prediction) -> dict[str, Any]:
    """One setting with what it costs and brings."""
    return {
        "model": each.model,
        "parameters": plain(each.parameters),
        "seconds": each.seconds,
        "peak_bytes": each.peak_bytes,
        "error": each.error,
        "noise": each.noise,
        "error_without_exposure": each.unexposed,
    }


def plain(values: Values) -> dict[str, object]:
    """JSON has no infinity: the parameter itself reads it back from its name."""
    return {
        name: str(value) if isinstance(value, float) and math.isinf(value) else value
        for name, value in values.items()
    }


def _ids(found: Predictions) -> list[str]:
    foreseen = [each.model for each in found.entries]
    return list(dict.fromkeys([*MODELS, *foreseen, *found.reasons]))


def _model_json(model: Model, found: Predictions) -> dict[str, Any]:
    return {
        "id": model.id,
        "label": model.label,
        "needs": [
            {"feature": need.feature, "treatment": need.treatment, "reason": need.reason}
            for need in concerned(model, found.analysis)
        ],
        "reason": found.reasons.get(model.id),
        "settings": [prediction_json(each) for each in found.entries if each.model == model.id],
    }


def _light_json(light: LightAnalysis) -> dict[str, Any]:
    return {
        "kind": light.kind,
        "solid_angle": light.solid_angle,
        "fluence": list(light.fluence),
        "share": light.share,
        "optical_depth": _depths_json(light.depths),
        "band_energy": list(light.bands),
    }


def _depths_json(depths: Depths) -> dict[str, float]:
    return {"median": depths.median, "high": depths.high, "largest": depths.largest}


def absent(scene: Analysis) -> tuple[str, ...]:
    """What the scene lacks, and what is therefore not computed, stored or shaded."""
    words = []
    if scene.extinction_channels == 1:
        words.append("coloured extinction: one channel of visibility instead of three")
    if scene.scattering_channels == 1:
        words.append("coloured scattering: one channel of albedo instead of three")
    if scene.emission_channels == 0:
        words.append("emission: no term for it")
    if scene.g == 0:
        words.append("a phase function: no directional moments, light scatters alike to all sides")
    if "environment" not in scene.kinds:
        words.append("light from all around")
    elif all(light.bands[0] > 1 - 1e-9 for light in scene.lights if light.bands):
        words.append("a sky with directions: band 0 of the harmonics holds all of it (bands = lit)")
    if not scene.kinds - {"environment"}:
        words.append("light of one direction: no hard shadows")
    if scene.dark:
        words.append(f"light from {scene.dark} of its lights, which are dark")
    if scene.matter < 1:
        words.append(
            f"matter in {100 * (1 - scene.matter):.0f} % of the box: no voxels stored there"
        )
    return tuple(words)


def as_text(name: str, found: Predictions, answers: Answers, full: bool = False) -> str:
    """For a person at a terminal; `full` lists every composition too."""
    lines = [*scene_lines(name, found.analysis), ""]
    lines += [f"absent: {words}" for words in absent(found.analysis)]
    lines += ["", "what each model makes of it"]
    for model in MODELS.values():
        lines.append(f"  {model.label}")
        lines += [
            f"    {need.treatment} {need.feature}: {need.reason}"
            for need in concerned(model, found.analysis)
        ]
        if model.id in found.reasons:
            lines.append(f"    cannot serve it: {found.reasons[model.id]}")
    frontier = set(map(id, found.frontier))
    lines += ["", "predicted (* no other is both faster and closer)"]
    lines.append(f"    {'seconds':>8} {'memory':>8} {'error':>15}  model and setting")
    for each in sorted(found.entries, key=lambda each: each.seconds):
        if full or each.model in MODELS or id(each) in frontier:
            lines.append(_row(each, id(each) in frontier))
    lines += ["", *(answer_line(request, answer) for request, answer in answers)]
    lines.append(f"(foreseen in {found.seconds:.0f} s; errors after the best exposure)")
    return "\n".join(lines)


def _row(each: Prediction, is_best: bool) -> str:
    mark = "*" if is_best else " "
    error = f"{100 * each.error:.3g} ± {100 * each.noise:.1g} %"
    memory = f"{each.peak_bytes / 1e6:.0f} MB"
    return f"  {mark} {each.seconds:8.2f} {memory:>8} {error:>15}  {setting(each)}"


def setting(each: Prediction) -> str:
    """The model and its parameters in one line."""
    given = " ".join(f"{name}={_shown(value)}" for name, value in each.parameters.items())
    return f"{each.model} {given}".strip()


def answer_line(request: Request, answer: Prediction | None) -> str:
    """The recommendation for a request."""
    wanted = []
    if request.error is not None:
        wanted.append(f"error up to {100 * request.error:.3g} %")
    if request.seconds is not None:
        wanted.append(f"{request.seconds:.3g} s")
    asked = " in ".join(wanted)
    if answer is None:
        return f"for {asked}: unreachable with any model and setting"
    return f"for {asked}: {setting(answer)} ({answer.seconds:.2f} s, {100 * answer.error:.3g} %)"


def scene_lines(name: str, scene: Analysis) -> list[str]:
    """The scene's terms, a line each."""
    colours = {0: "no", 1: "grey", 3: "coloured"}
    lines = [
        f"{name}: {' x '.join(map(str, scene.shape))} voxels, {100 * scene.matter:.0f} % of them "
        "with matter",
        f"  {colours[scene.extinction_channels]} extinction, "
        f"{colours[scene.scattering_channels]} scattering, "
        f"{colours[scene.emission_channels]} emission",
        f"  albedo {scene.albedo[0]:.3g} (largest {scene.albedo[1]:.4g}), g {scene.g:g}",
    ]
    for light in scene.lights:
        size = f"{light.solid_angle:.3g} sr" if light.solid_angle else "one direction"
        lines.append(
            f"  {light.kind} light: {size}, {100 * light.share:.3g} % of the light, optical depth "
            f"to it {_depth_words(light.depths)}"
        )
        if light.bands:
            shares = ", ".join(f"{100 * share:.3g}" for share in light.bands)
            lines.append(f"    energy in bands 0 to 3 and above: {shares} %")
    if scene.view is not None:
        lines.append(f"  optical depth along the view {_depth_words(scene.view)}")
    orders = f"{scene.orders:.0f}" if math.isfinite(scene.orders) else "without end"
    lines.append(f"  scattering orders until less than 1 % of the light is left: {orders}, at most")
    return lines


def _depth_words(depths: Depths) -> str:
    return f"{depths.median:.3g} (95 %: {depths.high:.3g}, largest {depths.largest:.3g})"


def _shown(value: object) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
