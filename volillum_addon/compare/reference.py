"""Reference images: independent seeds, one after another, until their mean is good enough."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..core.control import Control
from .cache import key_of, load, store
from .metrics import Image, Mask, relative_noise
from .renderer import Pixels, Renderer

# A standard error from fewer independent images says little.
FEWEST_SEEDS = 4

Report = Callable[[float, str], None]


def silent(share: float, message: str) -> None:
    """Report to nobody."""


@dataclass(frozen=True)
class Stopping:
    """When a reference is good enough: relative RMS standard error inside the silhouette, or
    seconds of rendering, whichever comes first; never fewer than FEWEST_SEEDS seeds."""

    noise: float = 0.01
    seconds: float = 120.0
    samples: int = 64


@dataclass(frozen=True, eq=False)
class Reference:
    """The mean of independent images and how it came about; `samples` are those of one seed."""

    image: Image
    bounces: int
    samples: int
    seeds: int
    seconds: float
    noise: float


@dataclass(frozen=True, eq=False)
class Tally:
    """Running mean and sum of squared deviations of images (Welford), and the seconds spent."""

    mean: NDArray[np.float64]
    squares: NDArray[np.float64]
    seeds: int = 0
    seconds: float = 0.0

    def add(self, pixels: NDArray[np.float64], seconds: float) -> Tally:
        """With one image more."""
        seeds = self.seeds + 1
        step = pixels - self.mean
        mean = self.mean + step / seeds
        squares = self.squares + step * (pixels - mean)
        return Tally(mean, squares, seeds, self.seconds + seconds)

    def image(self) -> Image:
        """The mean with the variance of the mean; of one seed alone the variance is not known."""
        if self.seeds < 2:
            raise ValueError(f"{self.seeds} seed has no standard error; expected at least 2")
        variance = self.squares / (self.seeds - 1) / self.seeds
        return Image(self.mean, variance, self.seeds - 1)


def render(
    renderer: Renderer,
    bounces: int,
    stopping: Stopping,
    mask: Mask,
    directory: Path,
    control: Control,
    report: Report = silent,
) -> Reference:
    """The reference of `bounces` bounces, its seeds kept in `directory`."""
    key = {"renderer": renderer.identity(), "bounces": bounces, "samples": stopping.samples}
    tally = gather(
        directory / f"reference_{key_of(key)}.npz",
        lambda seed: renderer.reference(bounces, stopping.samples, seed),
        stopping,
        mask,
        control,
        report,
    )
    image = tally.image()
    return Reference(
        image, bounces, stopping.samples, tally.seeds, tally.seconds, relative_noise(image, mask)
    )


def gather(
    path: Path,
    draw: Callable[[int], Pixels],
    stopping: Stopping,
    mask: Mask,
    control: Control,
    report: Report = silent,
) -> Tally:
    """Draw images of the seeds 1, 2, ... until `stopping` is met, storing the tally in `path`.

    What `path` holds already counts, so that a run that was cancelled goes on where it was and a
    stricter one adds to it. `report` is told the share that is done, and the seed.
    """
    tally = _restore(path, mask.shape)
    done = 0.0
    while (share := _share(tally, stopping, mask)) < 1:
        control.check()
        done = max(done, share)
        report(done, f"seed {tally.seeds + 1}")
        begin = time.perf_counter()
        pixels = np.asarray(draw(tally.seeds + 1), dtype=np.float64)
        tally = tally.add(pixels, time.perf_counter() - begin)
        store(path, mean=tally.mean, squares=tally.squares, seeds=tally.seeds,
              seconds=tally.seconds)  # fmt: skip
    return tally


def _share(tally: Tally, stopping: Stopping, mask: Mask) -> float:
    """How much of the work is done; 1 when the tally is good enough."""
    if tally.seeds < FEWEST_SEEDS:
        # Not 1 before the first standard error, which then says how much is left.
        return tally.seeds / FEWEST_SEEDS * 0.2
    # The variance of the mean falls as 1 / seeds.
    noise = relative_noise(tally.image(), mask)
    return min(1.0, max((stopping.noise / noise) ** 2 if noise > 0 else 1.0,
                        tally.seconds / stopping.seconds))  # fmt: skip


def _restore(path: Path, shape: tuple[int, ...]) -> Tally:
    empty = np.zeros((*shape, 3))
    held = load(path)
    if held is None:
        return Tally(empty, empty)
    return Tally(held["mean"], held["squares"], int(held["seeds"]), float(held["seconds"]))
