"""Bakes of a scene on two coarse grids: what predictions are made from.

A level is the scene on a grid of so many voxels with its full scattering, by photon mapping with
several seeds on its own and on half the spacing, continued to none (Richardson); runs are bakes of
models for a part of the lights, with the seconds of each stage and the image. Images of parts add,
so a composition costs no bake of its own.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ..core.coarse import coarsened, refined
from ..core.control import Control
from ..core.scene import Scene
from ..models.composition import Composition
from ..models.illuminate import VOID_MARGIN, illuminate
from ..models.image import line_integral
from ..models.model import Model, Value, Values
from ..models.progressive import MODEL as FULL_SCATTERING
from ..models.volume import STANDARD_ERROR, IlluminationVolume
from .metrics import Image, Mask, silhouette
from .stopwatch import Lap, Stopwatch

# Voxels of the two grids: one has about twice the spacing of the other.
VOXELS = (6_000, 48_000)
# Pixels along the longer side of the images.
PIXELS = 48
# Full scattering: independent runs, and the passes of each on the two grids.
SEEDS, PASSES = 4, (4, 8)
FIRST_SEED = 1_000_000
# Short bakes are repeated, and the fastest counts: a machine does other things too.
SHORT_SECONDS, REPEATS = 0.2, 3
# What is random is baked with several seeds: what chance makes of it is told by its spread.
DRAWS = 2


@dataclass(frozen=True, eq=False)
class Run:
    """One setting: the mean image [h, w, 3] of so many `draws` and the variance of one (0 of a
    deterministic model, which is drawn once), time by stage, and bytes of its channels."""

    image: NDArray[np.float64]
    variance: NDArray[np.float64]
    draws: int
    laps: Mapping[str, Lap]
    channel_bytes: int

    @property
    def effort(self) -> float:
        """Seconds of all processors together: hardly disturbed by what else the machine does."""
        return sum(lap.processor for lap in self.laps.values()) / (os.process_cpu_count() or 1)


@dataclass(eq=False)
class Level:
    """The scene on one coarse grid."""

    scene: Scene
    width: int
    height: int
    full: Image
    mask: Mask
    runs: dict[tuple[object, ...], Run] = field(default_factory=dict)

    @property
    def voxels(self) -> int:
        """Voxels that a bake of this scene works on."""
        return baked_voxels(self.scene)

    def run(self, model: Model, parameters: Values, control: Control) -> tuple[Run, ...]:
        """The bakes whose sum is the model's illumination; each is made once. Raises InputError
        where the model cannot serve the scene."""
        model.check(self.scene)
        if isinstance(model, Composition):
            parts = [(part.model, part.scene(self.scene), part.values(parameters))
                     for part in model.parts]  # fmt: skip
        else:
            parts = [(model, self.scene, dict(parameters))]
        return tuple(
            self._baked(each, own, values, control) for each, own, values in parts
            if own is not None
        )  # fmt: skip

    def _baked(self, model: Model, scene: Scene, values: Values, control: Control) -> Run:
        lights = model.represented(scene)
        glows = scene.medium.emission is not None
        key = (model.id, tuple(map(id, lights)), glows, tuple(sorted(values.items())))
        if key not in self.runs:
            self.runs[key] = self._bake(model, replace(scene, lights=lights), values, control)
        return self.runs[key]

    def _bake(self, model: Model, scene: Scene, values: Values, control: Control) -> Run:
        volume, laps = _timed(model, scene, values, control)
        images = [self._image(volume)]
        chance = STANDARD_ERROR in volume.channels
        repeats = 1
        while (chance and repeats < DRAWS) or (
            sum(lap.clock for lap in laps.values()) < SHORT_SECONDS and repeats < REPEATS
        ):
            seed = {"noise_seed": repeats} if chance else {}
            volume, again = _timed(model, scene, {**values, **seed}, control)
            laps = {name: min(lap, again[name], key=lambda each: each.clock)
                    for name, lap in laps.items()}  # fmt: skip
            repeats += 1
            if chance:
                images.append(self._image(volume))
        size = sum(grid.values.nbytes for grid in volume.channels.values())
        mean = np.mean(images, axis=0)
        variance = np.var(images, axis=0, ddof=1) if chance else np.zeros_like(mean)
        return Run(mean, variance, len(images), laps, size)

    def _image(self, volume: IlluminationVolume) -> NDArray[np.float64]:
        return line_integral(volume, self.scene.need_camera(), self.width, self.height)[0]


def _timed(
    model: Model, scene: Scene, values: Values, control: Control
) -> tuple[IlluminationVolume, dict[str, Lap]]:
    watch = Stopwatch(control)
    volume = illuminate(scene, model.id, values, watch)
    return volume, watch.stop()


def baked_voxels(scene: Scene) -> int:
    """Voxels of the box that a bake works on."""
    return math.prod(scene.trimmed(VOID_MARGIN).medium.sigma_t.shape)


def levels(scene: Scene, aspect: float, control: Control) -> tuple[Level, ...]:
    """The scene's levels, coarse to fine; one alone where the scene is no finer than that.

    `aspect` is the image's width over its height.
    """
    width = max(4, round(PIXELS * min(1.0, aspect)))
    height = max(4, round(PIXELS * min(1.0, 1 / aspect)))
    scenes = [coarsened(scene, voxels) for voxels in VOXELS]
    if scenes[0].medium.sigma_t.shape == scenes[1].medium.sigma_t.shape:
        scenes = scenes[1:]
    found = []
    for index, coarse in enumerate(scenes):
        with control.stage(index / len(scenes), (index + 1) / len(scenes), "full scattering"):
            passes = PASSES[index - len(scenes)]
            found.append(_level(coarse, passes, width, height, control))
    return tuple(found)


def _level(scene: Scene, passes: int, width: int, height: int, control: Control) -> Level:
    """Photons are averaged over voxels, an error of first order in the spacing where light ends
    within a voxel. Half the spacing halves it, and the two together tell what is left."""
    with control.stage(0, 0.3, "full scattering"):
        coarse, _ = _photons(scene, passes, FIRST_SEED, width, height, control)
    with control.stage(0.3, 1, "full scattering"):
        seed = FIRST_SEED + SEEDS
        fine, transmittance = _photons(refined(scene), passes, seed, width, height, control)
    full = Image(2 * fine.value - coarse.value, 4 * fine.variance + coarse.variance, SEEDS - 1)
    return Level(scene, width, height, full, silhouette(transmittance))


def _photons(
    scene: Scene, passes: int, first: int, width: int, height: int, control: Control
) -> tuple[Image, NDArray[np.float64]]:
    """Full scattering on the scene's own grid, and the transmittance of the pixels."""
    images = []
    transmittance: NDArray[np.float64] = np.ones((height, width, 3))
    for seed in range(SEEDS):
        with control.stage(seed / SEEDS, (seed + 1) / SEEDS, "full scattering"):
            given: dict[str, Value] = {"noise_seed": first + seed, "passes": passes}
            volume = illuminate(scene, FULL_SCATTERING, given, control)
            image, transmittance = line_integral(volume, scene.need_camera(), width, height)
            images.append(image)
    mean, variance = np.mean(images, axis=0), np.var(images, axis=0, ddof=1) / SEEDS
    return Image(mean, variance, SEEDS - 1), transmittance
