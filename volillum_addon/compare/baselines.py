"""What the user would otherwise do: the renderer's own full scattering with few samples.

Each is drawn several times with other seeds, as one such picture is random: its time is their
median, its error what one of them is to be expected to have.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..core.control import Control
from .cache import load, store
from .flip import Eye
from .machine import machine
from .measure import Bench, flip
from .metrics import Exposure, Image, Mask, best_exposure, drawn_figure
from .reference import Reference
from .renderer import WAYS, Way
from .results import BaselineMeasured, Timing

SAMPLES = (1, 4, 16, 64, 256, 1024)
# Draws of each; slow ones are drawn less: no third one begins after ENOUGH_SECONDS.
DRAWS, FEWEST_DRAWS, ENOUGH_SECONDS = 3, 2, 5.0


def rungs(most: int) -> tuple[tuple[Way, tuple[int, ...]], ...]:
    """Every way of path tracing with its numbers of samples up to `most`, few to many."""
    return tuple((way, tuple(count for count in SAMPLES if count <= most)) for way in WAYS)


def measure(
    bench: Bench,
    way: Way,
    samples: int,
    full: Reference,
    mask: Mask,
    eye: Eye,
    control: Control,
) -> BaselineMeasured:
    """Times and errors of this way, with as many bounces as full scattering has."""
    pixels, seconds = _draws(bench, way, full.bounces, samples, control)
    draws = pixels.astype(np.float64)
    exposure, exposed = _exposed(draws, full.image, mask)
    return BaselineMeasured(
        seconds,
        pixels[0],
        drawn_figure(draws, full.image, mask),
        exposure,
        drawn_figure(exposed, full.image, mask),
        flip(bench, eye, draws),
    )


def _draws(
    bench: Bench, way: Way, bounces: int, samples: int, control: Control
) -> tuple[NDArray[np.float32], Timing]:
    path = bench.part(
        "baseline", way=way.id, bounces=bounces, samples=samples, machine=machine(), draws=DRAWS
    )
    held = load(path)
    if held is None:
        pixels: list[NDArray[np.float32]] = []
        seconds: list[float] = []
        while len(pixels) < (FEWEST_DRAWS if sum(seconds) > ENOUGH_SECONDS else DRAWS):
            control.check()
            image, taken = bench.renderer.baseline(way, bounces, samples, 1 + len(pixels))
            pixels.append(image)
            seconds.append(taken)
        store(path, pixels=np.array(pixels, np.float32), seconds=np.array(seconds))
        held = load(path)
        assert held is not None
    return (
        np.asarray(held["pixels"], np.float32),
        Timing(tuple(float(value) for value in held["seconds"])),
    )


def _exposed(
    draws: NDArray[np.float64], truth: Image, mask: Mask
) -> tuple[Exposure, NDArray[np.float64]]:
    """The mean of the draws' best exposures with its noise, and each draw under its own."""
    found = [best_exposure(Image.noiseless(each), truth, mask) for each in draws]
    factors = np.array([each.factor for each in found])
    spread = float(factors.std(ddof=1)) / len(factors) ** 0.5
    exposure = Exposure(float(factors.mean()), float(np.hypot(found[0].noise, spread)))
    return exposure, draws * factors[:, None, None, None]
