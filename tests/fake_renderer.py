"""A renderer without Blender: the core's own images plus seeded noise."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from volillum_addon.bake.run import baked_volume
from volillum_addon.compare.renderer import WAYS, Way
from volillum_addon.core.lights import Light
from volillum_addon.core.scene import Scene
from volillum_addon.models.exact import exact_image
from volillum_addon.models.image import line_integral
from volillum_addon.models.operator import Operator
from volillum_addon.models.volume import Factor, IlluminationVolume, RadianceTerm

Pixels = NDArray[np.float32]
# Relative noise of one sample.
NOISE = 0.4


class FakeRenderer:
    """Full scattering is twice the single scattering of a constant in-scattered radiance: each
    doubling of the bounces halves what is missing."""

    def __init__(self, scene: Scene, width: int, height: int) -> None:
        self.scene, self.width, self.height = scene, width, height
        self.calls: Counter[str] = Counter()
        ones = scene.medium.sigma_t.with_values(np.ones(scene.medium.sigma_t.shape, np.float32))
        volume = IlluminationVolume(
            "constant", {}, scene.medium, {"one": ones},
            (RadianceTerm((Factor("one"),), (0.1, 0.11, 0.12)),),
        )  # fmt: skip
        self.single, _ = line_integral(volume, scene.need_camera(), width, height)

    def truth(self, bounces: int) -> NDArray[np.float64]:
        """What `reference` is the expectation of."""
        return self.single * (2 - 1 / (1 + bounces))

    def reference(self, bounces: int, samples: int, seed: int) -> Pixels:
        """The truth with noise that depends on the seed alone."""
        self.calls["reference"] += 1
        return self._noisy(self.truth(bounces), samples, seed)

    def ways(self) -> tuple[Way, ...]:
        """No denoiser is there."""
        return tuple(way for way in WAYS if not way.denoised)

    def baseline(self, way: Way, bounces: int, samples: int, seed: int) -> tuple[Pixels, float]:
        """The truth with its noise, unbiased twice as much; a second and 0.01 s a sample."""
        self.calls["baseline"] += 1
        more = 1 if way.biased else 0.25
        image = self._noisy(self.truth(bounces), samples * more, 10_000 * samples + seed)
        return image, 1 + 0.01 * samples

    def display(self, baked: Path, samples: int, seed: int, subpixels: int) -> Pixels:
        """The line integral, one part in a thousand too bright."""
        assert (samples, seed, subpixels) == (1, 0, 2)
        self.calls["display"] += 1
        volume = baked_volume(self.scene, baked)
        image, _ = line_integral(volume, self.scene.need_camera(), self.width, self.height)
        return (image * 1.001).astype(np.float32)

    def witness(
        self, operator: Operator, samples: int, seed: int, lights: tuple[Light, ...]
    ) -> Pixels | None:
        """Knows cones about lights, by the exact evaluator with other seeds."""
        if operator.axis != "light":
            return None
        self.calls["witness"] += 1
        found = exact_image(
            replace(self.scene, lights=lights), "multidirectional_occlusion",
            self.width, self.height, {"theta": operator.theta},
            points=4, directions=8, seed=1000 + seed,
        )  # fmt: skip
        return self._noisy(found.value, samples, seed)

    def identity(self) -> dict[str, object]:
        """The scene's grids and size; lights and camera do not change in the tests that cache."""
        return {"fake": 1, "sigma_t": self.scene.medium.sigma_t.values,
                "size": [self.width, self.height]}  # fmt: skip

    def versions(self) -> dict[str, str]:
        """One made-up program."""
        return {"fake renderer": "1.0"}

    def _noisy(self, image: NDArray[np.float64], samples: float, seed: int) -> Pixels:
        noise = np.random.default_rng(seed).standard_normal((self.height, self.width, 1))
        return (image * (1 + NOISE / np.sqrt(samples) * noise)).astype(np.float32)
