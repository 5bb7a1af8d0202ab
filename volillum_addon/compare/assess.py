"""Every way to the picture beside full scattering: a model as it was asked for, its ladder of other
settings, and path tracing with few samples."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from ..core.coarse import coarsened
from ..core.scene import Scene
from ..models.model import Model, Value
from . import baselines, measure
from .errors import ErrorImages
from .flip import Eye
from .ladder import climb
from .measure import Bake, Bench
from .metrics import Image, Mask
from .progress import Agenda
from .reference import Reference
from .renderer import Way, counted
from .results import Baseline, BaselineMeasured, Measured, Rung

# The coarser grid of a ladder: half the resolution, an eighth of the voxels; and the fewest voxels
# along an axis that it is worth trying with.
COARSE, FEWEST_VOXELS = 0.5, 16


@dataclass(frozen=True, eq=False)
class Against:
    """What everything is measured against: full scattering inside the silhouette."""

    full: Reference
    mask: Mask
    eye: Eye


def model(
    bench: Bench,
    index: int,
    model: Model,
    values: Mapping[str, Value],
    baked: Bake,
    integrated: Image,
    against: Against,
    agenda: Agenda,
) -> Measured:
    """Times and errors of the model as it was asked for."""
    control = agenda.control
    with agenda.part(f"display {index}", f"{model.label}: displaying"):
        displayed, seconds = measure.display(bench, baked)
    with agenda.part(f"exact {index}", f"{model.label}: exact image"):
        exact = measure.exact(bench, model, values, control)
    with agenda.part(f"field {index}", f"{model.label}: exact field"):
        field = measure.field(bench, baked, control)
    with agenda.part(f"witness {index}", f"{model.label}: Cycles as a witness") as told:
        witness = measure.witness(bench, model, values, against.mask, control, told)
    with agenda.part(f"savings {index}", f"{model.label}: what the scene lacks"):
        saved = measure.savings(bench, baked, model, values, control)
    images = ErrorImages(displayed, integrated, exact, against.full.image)
    exposure, exposed = images.exposed(against.mask)
    return Measured(
        baked.seconds(seconds),
        baked.peak_bytes,
        images,
        images.figures(against.mask) | {"numerical_field": field},
        exposure,
        exposed,
        measure.flip(bench, against.eye, displayed.value[None]),
        witness,
        saved,
    )


@dataclass(frozen=True)
class Setting:
    """A model's parameters, and the share of the scene's resolution along every axis."""

    values: Mapping[str, Value]
    resolution: float = 1.0


def settings(model: Model, given: Mapping[str, Value], scene: Scene) -> tuple[Setting, ...]:
    """What is compared on a coarser grid where the scene has voxels for it, then the model's ladder
    over `given`, without the rung that is what is compared."""
    ladder = (model.values({**given, **rung}) for rung in model.ladder)
    rungs = tuple(Setting(values) for values in ladder if values != given)
    fine = min(scene.trimmed(0).medium.sigma_t.shape) >= FEWEST_VOXELS
    return (Setting(given, COARSE), *rungs) if fine else rungs


def ladder(
    bench: Bench,
    index: int,
    model: Model,
    given: Mapping[str, Value],
    against: Against,
    agenda: Agenda,
) -> tuple[Rung, ...]:
    """The model under the other settings of its ladder, as far as the budget reaches."""
    asked = list(enumerate(settings(model, given, bench.renderer.scene)))
    changed: list[dict[str, Value]] = [
        {name: value for name, value in setting.values.items() if value != given[name]}
        | ({"resolution": setting.resolution} if setting.resolution != 1 else {})
        for _, setting in asked
    ]

    def take(entry: tuple[int, Setting]) -> Measured:
        rung, setting = entry
        words = ", ".join(f"{name} {value}" for name, value in changed[rung].items())
        with agenda.part(f"ladder {index} {rung}", f"{model.label}: {words}"):
            return _rung(bench, model, setting, against, agenda)

    found = climb(asked, take, lambda done: done.seconds.whole.median, 1, bench.options.rung_budget)
    for rung, entry in enumerate(found):
        if isinstance(entry, str):
            agenda.drop(f"ladder {index} {rung}")
    return tuple(
        Rung(changes, reason=entry) if isinstance(entry, str) else Rung(changes, entry)
        for changes, entry in zip(changed, found, strict=True)
    )


def _rung(
    bench: Bench, model: Model, setting: Setting, against: Against, agenda: Agenda
) -> Measured:
    control, scene = agenda.control, bench.renderer.scene
    coarse = None
    if setting.resolution < 1:
        voxels = math.prod(scene.trimmed(0).medium.sigma_t.shape)
        coarse = coarsened(scene, round(voxels * setting.resolution**3))
    baked = measure.bake(bench, model, setting.values, control, coarse)
    displayed, seconds = measure.display(bench, baked)
    integrated, _ = measure.integral(bench, baked, control)
    exact = measure.exact(bench, model, setting.values, control)
    images = ErrorImages(displayed, integrated, exact, against.full.image)
    exposure, exposed = images.exposed(against.mask)
    figures = images.figures(against.mask)
    return Measured(baked.seconds(seconds), baked.peak_bytes, images, figures, exposure, exposed)


def path_tracing(bench: Bench, against: Against, agenda: Agenda) -> tuple[Baseline, ...]:
    """Every way of path tracing with ever more samples, as far as the budget reaches."""
    ways = baselines.rungs(bench.options.baselines)
    return tuple(
        entry for way, counts in ways for entry in _way(bench, way, counts, against, agenda)
    )


def _way(
    bench: Bench, way: Way, counts: tuple[int, ...], against: Against, agenda: Agenda
) -> tuple[Baseline, ...]:
    def take(samples: int) -> BaselineMeasured:
        with agenda.part(f"{way.id}:{samples}", f"{way.label}: {counted(samples)}"):
            return baselines.measure(
                bench, way, samples, against.full, against.mask, against.eye, agenda.control
            )

    found: list[BaselineMeasured | str] = ["this Cycles has no such way"] * len(counts)
    if way in bench.renderer.ways():
        found = climb(counts, take, lambda done: done.seconds.median, baselines.FEWEST_DRAWS,
                      bench.options.rung_budget)  # fmt: skip
    for samples, entry in zip(counts, found, strict=True):
        if isinstance(entry, str):
            agenda.drop(f"{way.id}:{samples}")
    return tuple(
        Baseline(way, samples, reason=entry)
        if isinstance(entry, str)
        else Baseline(way, samples, entry)
        for samples, entry in zip(counts, found, strict=True)
    )
