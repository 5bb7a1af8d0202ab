"""Every way to the picture beside full scattering: a model as it was asked for, its ladder of other
settings, and path tracing with few samples."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

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
    )


def settings(model: Model, given: Mapping[str, Value]) -> tuple[dict[str, Value], ...]:
    """The model's ladder over `given`, without the rung that is what is compared."""
    ladder = (model.values({**given, **rung}) for rung in model.ladder)
    return tuple(values for values in ladder if values != given)


def ladder(
    bench: Bench,
    index: int,
    model: Model,
    given: Mapping[str, Value],
    against: Against,
    agenda: Agenda,
) -> tuple[Rung, ...]:
    """The model under the other settings of its ladder, as far as the budget reaches."""
    asked = list(enumerate(settings(model, given)))
    changed = [
        {name: value for name, value in values.items() if value != given[name]}
        for _, values in asked
    ]

    def take(entry: tuple[int, dict[str, Value]]) -> Measured:
        rung, values = entry
        words = ", ".join(f"{name} {value}" for name, value in changed[rung].items())
        with agenda.part(f"ladder {index} {rung}", f"{model.label}: {words}"):
            return _rung(bench, model, values, against, agenda)

    found = climb(asked, take, lambda done: done.seconds.whole.median, 1, bench.options.rung_budget)
    for rung, entry in enumerate(found):
        if isinstance(entry, str):
            agenda.drop(f"ladder {index} {rung}")
    return tuple(
        Rung(changes, reason=entry) if isinstance(entry, str) else Rung(changes, entry)
        for changes, entry in zip(changed, found, strict=True)
    )


def _rung(
    bench: Bench, model: Model, values: Mapping[str, Value], against: Against, agenda: Agenda
) -> Measured:
    control = agenda.control
    baked = measure.bake(bench, model, values, control)
    displayed, seconds = measure.display(bench, baked)
    integrated, _ = measure.integral(bench, baked, control)
    exact = measure.exact(bench, model, values, control)
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
