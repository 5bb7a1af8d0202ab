"""How good the recommendations of `volillum analyse` are: on the gallery, and on volumes that were
not looked at when the margins were set.

    python tests/benchmarks/recommendations.py [--scenes NAME,NAME] [--seconds 30]
                                               [--parts build/recommendations]
                                               [-o docs/recommendations.md]

For every scene all models' settings are foreseen, then baked and judged against Cycles. A request
is met when the recommended setting's measured total error after exposure stays below the requested
one (or its bake and hand-over below the requested seconds), or when `unreachable` is right: no
measured setting meets it. Finished scenes are kept in the parts' folder. Needs VOLILLUM_DATA.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from volillum_addon.bake.run import bake_file, baked_volume
from volillum_addon.blender import gallery, gallery_presets, properties, work
from volillum_addon.blender.analysis_text import prediction_json
from volillum_addon.blender.cycles import CyclesRenderer
from volillum_addon.compare.bounces import bounce_limit
from volillum_addon.compare.metrics import (
    Image,
    Mask,
    best_exposure,
    figure,
    relative_noise,
    silhouette,
)
from volillum_addon.compare.predict import Prediction, predict
from volillum_addon.compare.recommend import Request, recommended
from volillum_addon.compare.reference import Stopping, gather
from volillum_addon.core.control import Control
from volillum_addon.core.errors import InputError
from volillum_addon.models.image import line_integral
from volillum_addon.models.registry import MODELS

UNSEEN = Path(__file__).resolve().parent / "unseen"
REQUESTS = (
    *(Request(error=error) for error in (0.3, 0.2, 0.1, 0.05, 0.03, 0.02, 0.01)),
    *(Request(seconds=seconds) for seconds in (0.5, 2.0, 10.0)),
)
# Pixels along the longer side, and samples of one seed of the reference.
PIXELS, SAMPLES = 64, 16
# Settings that are foreseen to take longer are not measured, unless they are recommended.
LONGEST = 20.0


def key(model: str, parameters: object) -> str:
    """One name for a setting."""
    return f"{model} {json.dumps(parameters, sort_keys=True)}"


def measured(name: str, folder: Path, parts: Path, seconds: float) -> dict[str, Any]:
    """Everything about one scene, as JSON values."""
    file = parts / f"{name}.json"
    if file.exists():
        found: dict[str, Any] = json.loads(file.read_text())
        return found
    entry = gallery_presets.exhibit(name, folder)
    bpy.ops.wm.open_mainfile(filepath=str(gallery.make_scene(entry, parts).absolute()))
    reading = work.read(bpy.context.scene)
    scene, aspect = reading.scene, reading.width / reading.height
    width, height = round(PIXELS * min(1, aspect)), round(PIXELS * min(1, 1 / aspect))
    predictions = predict(scene, aspect)
    answers = [recommended(predictions.entries, request) for request in REQUESTS]
    asked = {key(a.model, dict(a.parameters)) for a in answers if a is not None}
    renderer = CyclesRenderer(scene, width, height, bpy.context.scene)
    _, transmittance = line_integral(
        baked_volume(scene, bake_file(scene, "ambient_occlusion", parts / "bakes", name).path),
        scene.need_camera(), width, height,
    )  # fmt: skip
    mask = silhouette(transmittance)
    bounces = bounce_limit(scene.medium)
    tally = gather(
        parts / f"reference_{name}.npz",
        lambda seed: renderer.reference(bounces, SAMPLES, seed),
        Stopping(0.005, seconds, SAMPLES), mask, Control(),
    )  # fmt: skip
    full = tally.image()
    settings = []
    for each in predictions.entries:
        recommended_now = key(each.model, dict(each.parameters)) in asked
        simple = each.model in MODELS or each in predictions.frontier
        if recommended_now or (simple and each.seconds < LONGEST):
            row = judged(each, name, renderer, parts, full, mask, recommended_now)
            settings.append({**prediction_json(each), "measured": row})
            print(f"  {key(each.model, dict(each.parameters))[:90]}: foreseen "
                  f"{100 * each.error:.2f} % {each.seconds:.2f} s, is {100 * row['error']:.2f} % "
                  f"{row['seconds']:.2f} s", flush=True)  # fmt: skip
    result = {
        "name": name,
        "unseen": folder == UNSEEN,
        "summary": entry.summary,
        "voxels": list(predictions.analysis.shape),
        "foreseeing_seconds": predictions.seconds,
        "reference": {"noise": relative_noise(full, mask), "seconds": tally.seconds},
        "settings": settings,
    }  # fmt: skip
    file.write_text(json.dumps(result, indent=1) + "\n")
    return result


def judged(
    each: Prediction,
    name: str,
    renderer: CyclesRenderer,
    parts: Path,
    full: Image,
    mask: Mask,
    displayed: bool,
) -> dict[str, Any]:
    """The bake's time and error; of Blender's display, or of the line integral for those that are
    only compared with."""
    scene = renderer.scene
    baked = bake_file(scene, each.model, parts / "bakes", name, each.parameters)
    if displayed:
        pixels = np.asarray(renderer.display(baked.path, 1, 0, 2), np.float64)
    else:
        pixels, _ = line_integral(
            baked_volume(scene, baked.path), scene.need_camera(), renderer.width, renderer.height
        )
    image = Image.noiseless(pixels)
    error = figure(image.scaled(best_exposure(image, full, mask).factor), full, mask)
    baked.path.unlink()
    return {
        "seconds": baked.seconds_bake + baked.seconds_hand_over,
        "error": error.relative_rmse,
        "noise": error.noise,
        "is_bound": error.is_bound,
        "displayed": displayed,
    }


@dataclass(frozen=True)
class Case:
    """One request in one scene: whether it was met, and what that cost beside the best choice."""

    scene: str
    unseen: bool
    request: str
    answer: str
    error: float | None
    seconds: float | None
    met: bool
    best: str
    best_seconds: float | None
    best_error: float | None


def cases(found: dict[str, Any]) -> Iterator[Case]:
    """The requests of one scene."""
    rows = {key(s["model"], s["parameters"]): s["measured"] for s in found["settings"]}
    entries = [
        Prediction(s["model"], s["parameters"], s["seconds"], s["peak_bytes"], s["error"],
                   s["noise"], s["error_without_exposure"])
        for s in found["settings"]
    ]  # fmt: skip
    for request in REQUESTS:
        # Of the margins as they are now: what was foreseen does not depend on them.
        answer = recommended(entries, request)
        asked = {
            "error": request.error,
            "seconds": request.seconds,
            "answer": None if answer is None else key(answer.model, dict(answer.parameters)),
        }
        by_error = asked["error"] is not None

        def meets(row: dict[str, Any], asked: dict[str, Any] = asked) -> bool:
            if asked["error"] is not None:
                return bool(row["error"] <= asked["error"] + row["noise"])
            return bool(row["seconds"] <= asked["seconds"])

        able = [name for name, row in rows.items() if meets(row)]
        best = min(able, key=lambda n: rows[n]["seconds" if by_error else "error"], default=None)
        mine = rows.get(asked["answer"]) if asked["answer"] else None
        yield Case(
            found["name"],
            found["unseen"],
            f"{100 * asked['error']:g} %" if by_error else f"{asked['seconds']:g} s",
            asked["answer"] or "unreachable",
            mine["error"] if mine else None,
            mine["seconds"] if mine else None,
            meets(mine) if mine else best is None,
            best or "unreachable",
            rows[best]["seconds"] if best else None,
            rows[best]["error"] if best else None,
        )


def page(scenes: list[dict[str, Any]]) -> str:
    """docs/recommendations.md."""
    found = [case for scene in scenes for case in cases(scene)]
    lines = [
        "# How good the recommendations are",
        "",
        "`volillum analyse` foresees every model's time and error from bakes on two coarse grids "
        "and recommends a setting. Here each is then baked and judged against Cycles' full "
        "scattering; `make recommendations` writes this page. A request is met when the total "
        "error after exposure stays below the requested one (within its standard error), when bake "
        "and hand-over stay below the requested seconds, or when nothing that was measured meets "
        "it and the answer is `unreachable`. The goal is nine of ten. The margins were set on the "
        "gallery; the other volumes were not looked at before. Seconds are of a machine that did "
        "other work too. Compositions are tried where they are foreseen to be best."
        + unmeasured({scene["name"] for scene in scenes}),
        "",
        "| | requests | met |",
        "| --- | --- | --- |",
    ]
    for label, chosen in (
        ("gallery", [case for case in found if not case.unseen]),
        ("unseen volumes", [case for case in found if case.unseen]),
        ("errors asked", [case for case in found if case.request.endswith("%")]),
        ("seconds asked", [case for case in found if case.request.endswith("s")]),
        ("all", found),
    ):
        met = sum(case.met for case in chosen)
        share = f" ({100 * met / len(chosen):.0f} %)" if chosen else ""
        lines.append(f"| {label} | {len(chosen)} | {met}{share} |")
    lines += ["", *foreseen(scenes), "", *missed(found), "", *table(scenes, found)]
    return "\n".join(lines) + "\n"


def unmeasured(done: set[str]) -> str:
    """The scenes that this page lacks, so that nobody takes it for all of them."""
    known = {*gallery_presets.names(), *gallery_presets.names(UNSEEN)}
    left = ", ".join(sorted(known - done))
    return f" Not measured yet: {left}." if left else ""


def foreseen(scenes: list[dict[str, Any]]) -> list[str]:
    """How far predictions are off."""
    errors, times = [], []
    for scene in scenes:
        for each in scene["settings"]:
            if not each["measured"]["is_bound"]:
                errors.append(each["measured"]["error"] / each["error"])
            times.append(each["measured"]["seconds"] / each["seconds"])
    words = []
    for label, ratios in (("errors", errors), ("seconds", times)):
        low, middle, high = np.quantile(ratios, (0.05, 0.5, 0.95))
        words.append(
            f"Measured {label} are {middle:.2f} times the foreseen ones in the median, "
            f"{low:.2f} to {high:.2f} times in nine of ten ({len(ratios)} settings)."
        )
    seconds = [scene["foreseeing_seconds"] for scene in scenes]
    words.append(f"Foreseeing took {min(seconds):.0f} to {max(seconds):.0f} s a scene.")
    return words


def missed(found: list[Case]) -> list[str]:
    """The requests that were not met, and why."""
    lines = ["## Not met", ""]
    for case in found:
        if not case.met:
            have = "" if case.error is None else f" ({percent(case.error)}, {case.seconds:.2f} s)"
            lines.append(f"* {case.scene}, {case.request}: {case.answer}{have}; best: {case.best}")
    return lines if len(lines) > 2 else [*lines, "None."]


def table(scenes: list[dict[str, Any]], found: list[Case]) -> list[str]:
    """Every request beside the best possible choice."""
    lines = ["## All requests", ""]
    lines += ["The best choice is the fastest measured setting that meets an error, or the most "
              "accurate one that meets a time; cost is the ratio of the seconds (of the errors "
              "where seconds were asked).", ""]  # fmt: skip
    for scene in scenes:
        size = " x ".join(map(str, scene["voxels"]))
        noise = percent(scene["reference"]["noise"])
        kind = ", unseen" if scene["unseen"] else ""
        lines += [f"### {scene['name']}{kind}", "", f"{scene['summary']} {size} voxels; noise of "
                  f"the reference {noise}.", "",
                  "| asked | answer | error | seconds | met | best | cost |",
                  "| --- | --- | --- | --- | --- | --- | --- |"]  # fmt: skip
        for case in (each for each in found if each.scene == scene["name"]):
            lines.append(
                f"| {case.request} | {short(case.answer)} | {percent(case.error)} | "
                f"{plain(case.seconds)} | {'yes' if case.met else '**no**'} | {short(case.best)} | "
                f"{cost(case)} |"
            )
        lines.append("")
    return lines


def cost(case: Case) -> str:
    """The recommended setting's seconds (or error) over the best one's."""
    by_error = case.request.endswith("%")
    mine, best = (case.seconds, case.best_seconds) if by_error else (case.error, case.best_error)
    return f"{mine / best:.2f}" if mine and best and case.met else ""


def short(setting: str) -> str:
    """A setting without the punctuation of JSON."""
    return setting.replace('"', "").replace("{", "").replace("}", "").replace(": ", "=").strip()


def percent(value: float | None) -> str:
    return "" if value is None else f"{100 * value:.3g} %"


def plain(value: float | None) -> str:
    return "" if value is None else f"{value:.2f}"


def main() -> None:
    parser = argparse.ArgumentParser(description="How good the recommendations are.")
    parser.add_argument("--scenes", default="", help="default: the gallery and the unseen ones")
    parser.add_argument("--seconds", type=float, default=30.0, help="of each reference")
    parser.add_argument("--parts", type=Path, default=Path("build/recommendations"))
    parser.add_argument("-o", "--output", type=Path, help="write the page there")
    options = parser.parse_args()
    known = [(name, gallery_presets.FOLDER) for name in gallery_presets.names()]
    known += [(name, UNSEEN) for name in gallery_presets.names(UNSEEN)]
    chosen = options.scenes.split(",") if options.scenes else [name for name, _ in known]
    options.parts.mkdir(parents=True, exist_ok=True)
    properties.register()
    scenes = []
    for name, folder in known:
        if name in chosen:
            print(name, flush=True)
            try:
                scenes.append(measured(name, folder, options.parts, options.seconds))
            except InputError as error:
                print(f"{name} NOT MEASURED: {error}", file=sys.stderr)
    if options.output:
        options.output.write_text(page(scenes), encoding="utf-8")
    else:
        print(page(scenes))


if __name__ == "__main__":
    main()
