"""What the comparison needs of a renderer; `blender/` implements it with Cycles."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ..core.lights import Light
from ..core.scene import Scene
from ..models.operator import Operator

Pixels = NDArray[np.float32]


@dataclass(frozen=True)
class Way:
    """One way of path tracing: how it marches (`biased`: in steps, else by null collisions), and
    whether the picture is denoised."""

    biased: bool
    denoised: bool

    @property
    def id(self) -> str:
        """A name for files and data."""
        march = "biased" if self.biased else "unbiased"
        return f"cycles_{march}" + ("_denoised" if self.denoised else "")

    @property
    def label(self) -> str:
        """A name for people."""
        march = "biased" if self.biased else "unbiased"
        return f"Cycles, {march}" + (", denoised" if self.denoised else "")


def counted(samples: int) -> str:
    """Samples in words."""
    return "1 sample" if samples == 1 else f"{samples} samples"


WAYS = tuple(Way(biased, denoised) for biased in (True, False) for denoised in (False, True))


class Renderer(Protocol):
    """Images [height, width, 3] of one scene: linear radiance, no background, top row first.

    A pixel is the mean over its square (box filter), independent of its neighbours (no denoising,
    no adaptive sampling); images of different seeds are independent.
    """

    @property
    def width(self) -> int:
        """Pixels across."""

    @property
    def height(self) -> int:
        """Pixels down."""

    @property
    def scene(self) -> Scene:
        """What is rendered, as the models see it; it has a camera."""

    def reference(self, bounces: int, samples: int, seed: int) -> Pixels:
        """Scattering up to `bounces` volume bounces (0: single scattering), no background."""

    def display(self, baked: Path, samples: int, seed: int, subpixels: int) -> Pixels:
        """The baked illumination through the display material, `samples` in each of a pixel's
        subpixels x subpixels parts."""

    def ways(self) -> tuple[Way, ...]:
        """The ways of path tracing that `baseline` knows."""

    def baseline(self, way: Way, bounces: int, samples: int, seed: int) -> tuple[Pixels, float]:
        """The picture as a user would otherwise render it, with the renderer's own defaults of the
        march, and its seconds from a medium on disk. A denoised one's pixels are not independent.
        """

    def witness(
        self, operator: Operator, samples: int, seed: int, lights: tuple[Light, ...]
    ) -> Pixels | None:
        """An image whose expectation solves the operator's equation for these of the scene's
        lights, where the renderer's own physics can do so; None elsewhere."""

    def identity(self) -> dict[str, object]:
        """All that the images depend on, as JSON values: versions, settings, medium, lights,
        camera. Equal identities mean equal images."""

    def versions(self) -> dict[str, str]:
        """Names and versions of the software behind the images."""
