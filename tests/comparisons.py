"""A comparison with made-up images, for tests of what is written from it."""

from dataclasses import replace

import numpy as np

from volillum_addon.compare.bounces import Truncation
from volillum_addon.compare.errors import ErrorImages
from volillum_addon.compare.flip import Flip
from volillum_addon.compare.metrics import (
    Agreement,
    Exposure,
    Image,
    Mask,
    drawn_figure,
    sampled_figure,
)
from volillum_addon.compare.reference import Reference
from volillum_addon.compare.renderer import WAYS
from volillum_addon.compare.results import (
    Baseline,
    BaselineMeasured,
    Comparison,
    Measured,
    ModelResult,
    Rung,
    Saving,
    Seconds,
    Timing,
)
from volillum_addon.core.camera import Camera
from volillum_addon.core.grid import Grid
from volillum_addon.core.lights import DistantLight, EnvironmentLight
from volillum_addon.core.medium import Medium
from volillum_addon.core.scene import Scene
from volillum_addon.models.model import Model, Value
from volillum_addon.models.registry import MODELS


def synthetic_scene() -> Scene:
    """A soft ball under a sun and a sky."""
    i, j, k = np.indices((20, 22, 24)) - np.array([9.5, 10.5, 11.5])[:, None, None, None]
    density = np.exp(-(i**2 + j**2 + k**2) / 40).astype(np.float32)
    affine = np.diag([0.1, 0.1, 0.1, 1.0])
    affine[:3, 3] = (-0.95, -1.05, -1.15)
    medium = Medium.from_density(Grid(density, affine, "density"), 4.0, (0.9, 0.85, 0.8))
    return Scene(
        medium,
        (DistantLight((0.4, -0.5, 0.8), (3.0, 2.8, 2.5), 0.4), EnvironmentLight((0.3, 0.4, 0.6))),
        Camera((0.0, -6.0, 1.0), (0.0, 0.0, 0.0)),
    )


def synthetic_ladder(model: Model, found: Measured) -> tuple[Rung, ...]:
    """Half and twice as slow as the model, and a rung that was left out."""

    def timed(factor: float) -> Measured:
        bake = Timing((found.seconds.bake.median * factor,))
        return replace(found, seconds=replace(found.seconds, bake=bake), flip=None, witness=None)

    steps: list[dict[str, Value]] = [{"rung": number} for number in range(3)]
    return (
        Rung(steps[0], timed(0.5)),
        Rung(steps[1], timed(2.0)),
        Rung(steps[2], reason="would take about 200 s; the budget is 15 s"),
    )


def synthetic_baselines(
    random: np.random.Generator, full: Image, mask: Mask
) -> tuple[Baseline, ...]:
    """Path tracing with the noise of 1 to 16 samples; there is no denoiser."""
    result = []
    for way in WAYS:
        for samples in (1, 4, 16):
            if way.denoised:
                result.append(Baseline(way, samples, reason="this Cycles has no such way"))
                continue
            noise = (0.4 if way.biased else 0.8) / samples**0.5
            shape = (3, *mask.shape, 1)
            draws = full.value * (1 + noise * random.standard_normal(shape))
            total = drawn_figure(draws, full, mask)
            found = BaselineMeasured(
                Timing((0.2 + 0.1 * samples,) * 3), draws[0].astype(np.float32), total,
                Exposure(0.98, 0.001), total, Flip(noise / 4, 0.001, is_bound=False),
            )  # fmt: skip
            result.append(Baseline(way, samples, found))
    return tuple(result)


def synthetic_comparison(
    width: int = 64, height: int = 48, reason: str = "needs a distant light; the scene has none"
) -> Comparison:
    """Every registered model with an error of its own, and the last one without measurements."""
    random = np.random.default_rng(5)
    y, x = np.mgrid[0:height, 0:width]
    ball = np.clip(1 - ((x - width / 2) ** 2 + (y - height / 2) ** 2) / (0.42 * height) ** 2, 0, 1)
    mask = ball > 0
    full = ball[..., None] ** 0.5 * np.array([1.0, 0.85, 0.7]) * (0.6 + 0.6 * x / width)[..., None]
    noise = 0.01 * full
    reference = Image(full + noise * random.standard_normal((height, width, 1)), noise**2, 15)
    models = []
    known = list(MODELS.values())
    for index, model in enumerate(known):
        exact = full * (0.8 + 0.15 * index) * (1 + 0.2 * (y / height - 0.5))[..., None]
        spread = 0.004 * exact
        images = ErrorImages(
            displayed=Image.noiseless(exact * 1.004),
            integrated=Image.noiseless(exact * 1.003),
            exact=Image(exact + spread * random.standard_normal((height, width, 1)), spread**2, 7),
            full=reference,
        )
        points = random.uniform(0.5, 1.0, (500, 3))
        errors = images.figures(mask) | {
            "numerical_field": sampled_figure(
                Image.noiseless(points * 1.01), Image(points, np.full((500, 3), 1e-6), 7)
            )
        }
        exposure, after = images.exposed(mask)
        time = 0.05 * 3**index
        measured = Measured(
            Seconds(
                whole=Timing((0.4 + time,) * 3),
                bake=Timing((time, time * 1.1, time * 0.9)),
                hand_over=Timing((0.1,) * 3),
                display=Timing((0.08, 0.09, 0.1)),
            ),
            peak_bytes=200 << 20,
            images=images,
            errors=errors,
            exposure=exposure,
            total_after_exposure=after,
            flip=Flip(0.05 + 0.02 * index, 0.001, is_bound=False),
            witness=Agreement(1.02, 0.1, -0.4, 48) if index else None,
            savings=(Saving("a <glow>", 1.5, 2.0), Saving("matter in 75 % of the grid", 4.0, 4.0))[
                : index % 3
            ],
        )
        models.append(
            ModelResult(
                model.id,
                model.label,
                model.citation,
                "equation",
                model.values({}),
                ('leaves out <the sky> & "haze"',),
                measured,
                ladder=synthetic_ladder(model, measured),
            )
        )
    last = known[-1]
    models.append(
        ModelResult(
            last.id, last.label + " (blue)", last.citation, "blue", last.values({}), reason=reason
        )
    )
    return Comparison(
        name="ball <b> & co",
        scene=synthetic_scene(),
        mask=mask,
        single=Reference(reference, 0, 64, 16, 12.0, 0.01),
        full=Reference(reference, 64, 64, 16, 40.0, 0.01),
        truncation=Truncation(32, 0.0004, 0.0002),
        models=tuple(models),
        baselines=synthetic_baselines(random, reference, mask),
        machine={
            "system": "Linux x86_64",
            "processor": "a processor",
            "threads": 2,
            "instruction_set": "avx2",
        },
        versions={"volillum": "0.1.0", "blender": "5.2.3"},
    )
