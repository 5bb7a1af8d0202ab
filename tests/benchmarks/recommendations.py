"""How good the recommendations of `volillum analyse` are: on the gallery, and on volumes that were
not looked at when the margins were set.

    python tests/benchmarks/recommendations.py [--scenes NAME,NAME] [--seconds 90]
                                               [--parts build/recommendations]
                                               [-o docs/recommendations.md]

For every scene all models' settings are foreseen, then baked and judged against Cycles
(recommendations_page.py says when a request is met). The parts' folder keeps references, what was
foreseen (`foreseen_*.json`) and measured (`measured/`); what is deleted there is made anew, and a
reference of more `--seconds` goes on from where it was.
Needs VOLILLUM_DATA.
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from recommendations_page import REQUESTS, Found, Row, key, page

from volillum_addon.bake.run import bake_file, baked_volume
from volillum_addon.blender import gallery, gallery_presets, properties, work
from volillum_addon.blender.analysis_text import prediction_json
from volillum_addon.blender.cycles import CyclesRenderer
from volillum_addon.blender.gallery_presets import Exhibit
from volillum_addon.compare.bounces import bounce_limit
from volillum_addon.compare.cache import key_of, load, store
from volillum_addon.compare.metrics import (
    Image,
    Mask,
    best_exposure,
    figure,
    relative_noise,
    silhouette,
)
from volillum_addon.compare.predict import Prediction, frontier, predict
from volillum_addon.compare.recommend import recommended
from volillum_addon.compare.reference import Stopping, Tally, gather
from volillum_addon.core.control import Control
from volillum_addon.core.errors import InputError
from volillum_addon.models.image import line_integral
from volillum_addon.models.registry import MODELS

UNSEEN = Path(__file__).resolve().parent / "unseen"
# Pixels along the longer side; samples of one seed of the reference, and its noise that is enough.
PIXELS, SAMPLES, NOISE = 64, 64, 0.005
# Settings that are foreseen to take longer are not measured, unless they are recommended.
LONGEST = 20.0


@dataclass(frozen=True, eq=False)
class Judge:
    """One scene with its reference: measures settings, each once."""

    name: str
    renderer: CyclesRenderer
    parts: Path
    tally: Tally
    mask: Mask
    aspect: float

    def row(self, each: Prediction, displayed: bool) -> Row:
        """The bake's time and error; of Blender's display, or of the line integral for those that
        are only compared with. What was baked is kept, its error is that of today's reference."""
        file = self.parts / "measured" / f"{self.name}_{key_of({'setting': key(each)})}.npz"
        held = load(file)
        if held is None or (displayed and not held["displayed"]):
            self._measure(each, displayed, file)
            held = load(file)
            assert held is not None, file
        image, full = Image.noiseless(held["pixels"]), self.tally.image()
        exposed = image.scaled(best_exposure(image, full, self.mask).factor)
        error = figure(exposed, full, self.mask)
        row = {
            "seconds": float(held["seconds"]),
            "error": error.relative_rmse,
            "noise": error.noise,
            "is_bound": error.is_bound,
        }
        print(f"  {key(each)[:90]}: foreseen {100 * each.error:.2f} % {each.seconds:.2f} s, is "
              f"{100 * row['error']:.2f} % {row['seconds']:.2f} s", flush=True)  # fmt: skip
        return row

    def _measure(self, each: Prediction, displayed: bool, file: Path) -> None:
        scene = self.renderer.scene
        baked = bake_file(scene, each.model, self.parts / "bakes", self.name, each.parameters)
        if displayed:
            pixels = np.asarray(self.renderer.display(baked.path, 1, 0, 2), np.float64)
        else:
            volume = baked_volume(scene, baked.path)
            size = self.renderer.width, self.renderer.height
            pixels, _ = line_integral(volume, scene.need_camera(), *size)
        baked.path.unlink()
        seconds = baked.seconds_bake + baked.seconds_hand_over
        store(file, pixels=pixels, seconds=seconds, displayed=displayed)


def judge(entry: Exhibit, parts: Path, seconds: float) -> Judge:
    """The scene, opened in Blender, with its reference of at most so many seconds."""
    name = entry.name
    bpy.ops.wm.open_mainfile(filepath=str(gallery.make_scene(entry, parts).absolute()))
    reading = work.read(bpy.context.scene)
    scene, aspect = reading.scene, reading.width / reading.height
    width, height = round(PIXELS * min(1, aspect)), round(PIXELS * min(1, 1 / aspect))
    renderer = CyclesRenderer(scene, width, height, bpy.context.scene)
    baked = bake_file(scene, "ambient_occlusion", parts / "bakes", name)
    _, transmittance = line_integral(
        baked_volume(scene, baked.path), scene.need_camera(), width, height
    )
    mask, bounces = silhouette(transmittance), bounce_limit(scene.medium)
    tally = gather(
        parts / f"reference_{name}.npz",
        lambda seed: renderer.reference(bounces, SAMPLES, seed),
        Stopping(NOISE, seconds, SAMPLES), mask, Control(),
    )  # fmt: skip
    return Judge(name, renderer, parts, tally, mask, aspect)


def foreseen(judge: Judge) -> dict[str, Any]:
    """What is foreseen for a scene, as JSON values."""
    file = judge.parts / f"foreseen_{judge.name}.json"
    if file.exists():
        found: dict[str, Any] = json.loads(file.read_text())
        return found
    predictions = predict(judge.renderer.scene, judge.aspect)
    result = {
        "voxels": list(predictions.analysis.shape),
        "seconds": predictions.seconds,
        "settings": [prediction_json(each) for each in predictions.entries],
    }
    file.write_text(json.dumps(result, indent=1) + "\n")
    return result


def measured(entry: Exhibit, unseen: bool, parts: Path, seconds: float) -> Found:
    """Everything about one scene."""
    judged = judge(entry, parts, seconds)
    plan = foreseen(judged)
    entries = tuple(map(prediction, plan["settings"]))
    answers = [recommended(entries, request) for request in REQUESTS]
    rows = {}
    for each in entries:
        displayed = each in answers
        simple = each.model in MODELS or each in frontier(entries)
        if displayed or (simple and each.seconds < LONGEST):
            rows[key(each)] = judged.row(each, displayed)
    return Found(
        entry.name,
        unseen,
        entry.summary,
        plan["voxels"],
        plan["seconds"],
        relative_noise(judged.tally.image(), judged.mask),
        entries,
        rows,
    )


def prediction(found: dict[str, Any]) -> Prediction:
    """What `prediction_json` wrote."""
    return Prediction(
        found["model"],
        found["parameters"],
        found["seconds"],
        found["peak_bytes"],
        found["error"],
        found["noise"],
        found["error_without_exposure"],
    )


def main() -> None:
    parser = argparse.ArgumentParser(description="How good the recommendations are.")
    parser.add_argument("--scenes", default="", help="default: the gallery and the unseen ones")
    parser.add_argument("--seconds", type=float, default=90.0, help="of each reference")
    parser.add_argument("--parts", type=Path, default=Path("build/recommendations"))
    parser.add_argument("-o", "--output", type=Path, help="write the page there")
    options = parser.parse_args()
    known = [(name, gallery_presets.FOLDER) for name in gallery_presets.names()]
    known += [(name, UNSEEN) for name in gallery_presets.names(UNSEEN)]
    chosen = options.scenes.split(",") if options.scenes else [name for name, _ in known]
    options.parts.mkdir(parents=True, exist_ok=True)
    properties.register()
    scenes, left = [], []
    for name, folder in known:
        if name not in chosen:
            left.append(name)
            continue
        print(name, flush=True)
        try:
            entry = gallery_presets.exhibit(name, folder)
            scenes.append(measured(entry, folder == UNSEEN, options.parts, options.seconds))
        except InputError as error:
            print(f"{name} NOT MEASURED: {error}", file=sys.stderr)
            left.append(name)
    text = page(scenes, left)
    if options.output:
        options.output.write_text(text, encoding="utf-8")
    else:
        print(text)


if __name__ == "__main__":
    main()
