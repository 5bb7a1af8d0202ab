"""The gallery's pictures: a standard scene, its recommended bake, and Cycles beside it."""

from __future__ import annotations

import json
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from matplotlib.image import imsave
from numpy.typing import NDArray

from ..bake.run import bake_file, baked_volume
from ..bake.store import replacing
from ..compare.bounces import bounce_limit
from ..compare.images import WHITE, WHITE_QUANTILE
from ..compare.metrics import Image, best_exposure, figure, relative_noise, silhouette
from ..compare.predict import predict
from ..compare.recommend import Request, cautious, recommended
from ..compare.reference import Stopping, gather
from ..core.colour import LUMINANCE
from ..core.control import Control
from ..core.errors import InputError, bad
from ..models.image import line_integral
from ..models.model import Values
from ..models.registry import get
from ..readers import medium_file
from ..readers.frames import VolumeFiles
from . import work
from .analysis_text import plain
from .cycles import CyclesRenderer
from .extent import Extent
from .gallery_presets import Exhibit
from .scene_builder import save_scene_of

# Behind the volume: a dark grey from below to above, in linear light before the exposure.
BELOW, ABOVE = 0.010, 0.035
# No picture is shown whose volume covers less of it, or is darker or flatter than this.
LEAST_COVER, LEAST_MEAN, LEAST_SPREAD = 0.04, 0.02, 0.02


@dataclass(frozen=True)
class Wishes:
    """How good a gallery's pictures are to be: the largest error of the bake, or the model to bake
    whatever its error; seconds for the reference, samples of one of its seeds, the pictures' size
    beside the preset's."""

    error: float = 0.05
    model: str | None = None
    seconds: float = 60.0
    samples: int = 16
    scale: float = 1.0


def make_scene(entry: Exhibit, directory: Path) -> Path:
    """The entry's medium as a VDB file, and the scene around it; replaces what is open."""
    medium = entry.load().trimmed(0)
    volume, file = directory / f"{entry.name}.vdb", directory / f"{entry.name}.blend"
    medium_file.store(medium, volume, {"gallery": entry.name})
    save_scene_of(VolumeFiles(volume), Extent.of(medium.sigma_t), entry.preset, file)
    return file


def show(entry: Exhibit, wishes: Wishes, directory: Path, control: Control) -> dict[str, Any]:
    """Make the scene, foresee, bake what is recommended, render it and Cycles; writes
    `<name>.baked.png`, `<name>.cycles.png` and `<name>.json`, whose content it returns.

    Renders: main thread only. Raises InputError, also where a picture comes out that nobody would
    show, and Cancelled.
    """
    with control.stage(0, 0.05, f"{entry.name}: scene"):
        bpy.ops.wm.open_mainfile(filepath=str(make_scene(entry, directory).absolute()))
    reading = work.read(bpy.context.scene)
    scene = reading.scene
    width, height = (round(n * wishes.scale) for n in (reading.width, reading.height))
    model, why = wishes.model, "asked for"
    parameters: Values = {}
    if model is None:
        with control.stage(0.05, 0.4, f"{entry.name}: foreseeing"):
            found = predict(scene, width / height, control)
        met = recommended(found.entries, Request(error=wishes.error))
        chosen = met or min(found.entries, key=cautious)
        model, parameters = chosen.model, chosen.parameters
        why = f"recommended for {100 * wishes.error:g} %" if met else "the closest there is"
    with control.stage(0.4, 0.6, f"{entry.name}: baking {model}"):
        baked = bake_file(scene, model, directory / "bakes", entry.name, parameters, control)
    renderer = CyclesRenderer(scene, width, height, bpy.context.scene)
    begin = time.perf_counter()
    displayed = np.asarray(renderer.display(baked.path, 1, 0, 2), np.float64)
    display_seconds = time.perf_counter() - begin
    _, transmittance = line_integral(
        baked_volume(scene, baked.path), scene.need_camera(), width, height
    )
    mask = silhouette(transmittance)
    bounces = bounce_limit(scene.medium)
    with control.stage(0.6, 1, f"{entry.name}: Cycles"):
        tally = gather(
            directory / "parts" / f"{entry.name}_{width}_{bounces}_{wishes.samples}.npz",
            lambda seed: renderer.reference(bounces, wishes.samples, seed),
            Stopping(0.01, wishes.seconds, wishes.samples),
            mask,
            control,
        )
    full = tally.image()
    image = Image.noiseless(displayed)
    exposure = best_exposure(image, full, mask)
    total = figure(image, full, mask)
    after = figure(image.scaled(exposure.factor), full, mask)
    white = float(np.quantile((full.value @ LUMINANCE)[mask], WHITE_QUANTILE)) / WHITE
    for kind, pixels in (("baked", displayed), ("cycles", full.value)):
        picture = shown(pixels / white, transmittance)
        check_picture(f"{entry.name}.{kind}", pixels / white, mask)
        with replacing(directory / f"{entry.name}.{kind}.png") as temporary:
            imsave(temporary, picture, format="png")
    result = {
        "name": entry.name,
        "summary": entry.summary,
        "volume": entry.volume,
        "voxels": list(scene.medium.trimmed(0).sigma_t.shape),
        "size": [width, height],
        "model": model,
        "label": get(model).label,
        "parameters": plain(parameters),
        "why": why,
        "seconds": {"bake": baked.seconds_bake, "hand_over": baked.seconds_hand_over,
                    "display": display_seconds, "cycles": tally.seconds},
        "cycles": {"bounces": bounces, "samples": wishes.samples * tally.seeds,
                   "noise": relative_noise(full, mask)},
        "total": {"relative_rmse": total.relative_rmse, "noise": total.noise},
        "exposure": exposure.factor,
        "after_exposure": {"relative_rmse": after.relative_rmse, "noise": after.noise,
                           "is_bound": after.is_bound},
    }  # fmt: skip
    text = json.dumps(result, indent=2)
    (directory / f"{entry.name}.json").write_text(text + "\n", encoding="utf-8")
    return result


def shown(radiance: NDArray[np.float64], transmittance: NDArray[np.float64]) -> NDArray[np.uint8]:
    """SRGB pixels [h, w, 3] over a plain background; radiance 1 is white."""
    rows = np.linspace(ABOVE, BELOW, len(radiance))[:, None, None]
    linear = np.clip(radiance + transmittance * rows, 0, 1)
    curved = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    return (255 * curved + 0.5).astype(np.uint8)


def check_picture(name: str, radiance: NDArray[np.float64], mask: NDArray[np.bool_]) -> None:
    """Raise an InputError for a picture that is black, even, or hardly holds the volume."""
    cover = float(mask.mean())
    inside = np.clip((radiance @ LUMINANCE)[mask], 0, 1)
    for what, value, least in (
        ("the share of the picture that the volume covers", cover, LEAST_COVER),
        ("the volume's mean brightness", float(inside.mean()), LEAST_MEAN),
        ("the spread of the volume's brightness", float(inside.std()), LEAST_SPREAD),
    ):
        if not value >= least:
            raise bad(f"{name}: {what}", f"{value:.2g}", f"at least {least:g}")


def missing(error: InputError) -> str:
    """How an absent volume is said, loudly."""
    return f"NOT SHOWN: {error}"
