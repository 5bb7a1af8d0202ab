"""The comparison: every model's bake, display and errors, beside path-traced references.

Finished parts lie in the directory's `parts`, bakes in `bakes`, so that a second run takes seconds
and one that was cancelled goes on where it was.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from ..bake.store import StorageError
from ..core.control import Control
from ..core.errors import InputError
from ..models.illuminate import left_out
from ..models.model import Model, Value
from ..models.published import ALGORITHM, EQUATION, PUBLISHED
from ..models.registry import get
from . import assess, images, measure, page, paper, report
from .assess import Against
from .baselines import DRAWS, rungs
from .bounces import Truncation, bounce_limit, truncation
from .cache import key_of, load, store
from .flip import Eye
from .machine import machine, versions
from .measure import Bake, Bench, Options
from .metrics import Mask, silhouette
from .progress import Agenda
from .reference import Reference, render
from .renderer import Renderer
from .results import Comparison, Measured, ModelResult, Rung

# Expected seconds of the parts, before any of them is known: a guess that only weighs them.
BAKE, DISPLAY, INTEGRAL, FIELD, SAVINGS, CHECK = 3.0, 3.0, 1.0, 5.0, 1.0, 25.0
EXACT_PER_DIRECTION = 4e-7  # and per pixel, point and replicate
BASELINE, PER_SAMPLE = 1.0, 5e-6  # a picture, and per pixel and sample


@dataclass(frozen=True)
class Candidate:
    """A model with its settings; `variant` names them where a model takes part several times."""

    model: str
    parameters: Mapping[str, object] = field(default_factory=dict)
    variant: str = EQUATION


def published(entry: Candidate) -> tuple[Candidate, ...]:
    """The algorithm that the candidate's model was published with, where the model has it."""
    if not any(parameter.name == ALGORITHM.name for parameter in get(entry.model).parameters):
        return ()
    if entry.parameters.get(ALGORITHM.name, EQUATION) == PUBLISHED:
        return ()
    parameters = {**entry.parameters, ALGORITHM.name: PUBLISHED}
    return (Candidate(entry.model, parameters, PUBLISHED),)


def compare(
    renderer: Renderer,
    models: Iterable[str | Candidate],
    options: Options,
    directory: Path,
    control: Control | None = None,
) -> Comparison:
    """Measure the models in the renderer's scene and write the report's files into `directory`:
    report.json, report.html, paper.csv, plots, contact_sheet.png and one OpenEXR a model.

    A model that cannot serve the scene is reported with its reason. Raises InputError for bad
    input or when no model can serve it, StorageError, and Cancelled; finished parts stay.
    """
    control = control or Control()
    candidates = [Candidate(entry) if isinstance(entry, str) else entry for entry in models]
    if options.published:
        candidates = [each for entry in candidates for each in (entry, *published(entry))]
    chosen = [(get(entry.model), entry) for entry in candidates]
    values = [model.values(entry.parameters) for model, entry in chosen]
    bench = Bench(renderer, options, Path(directory), key_of(renderer.identity()))
    budgets = ["single", "full", *(f"witness {index}" for index in range(len(chosen)))]
    agenda = Agenda(control, _expected(bench, chosen, values), budgets)
    bakes, reasons = _bakes(bench, chosen, values, agenda)
    if not bakes:
        raise InputError("; ".join(reasons.values()) or "no model was asked for; expected one")
    integrals = {}
    for index, baked in bakes.items():
        with agenda.part(f"integral {index}", f"{chosen[index][0].label}: integrating"):
            integrals[index] = measure.integral(bench, baked, control)
    mask = silhouette(next(iter(integrals.values()))[1])
    single, full, late = _references(bench, mask, agenda)
    against = Against(full, mask, Eye(full.image, mask))
    traced = assess.path_tracing(bench, against, agenda)
    results = []
    for index, (model, entry) in enumerate(chosen):
        measured: Measured | None = None
        ladder: tuple[Rung, ...] = ()
        if index in bakes:
            measured = assess.model(
                bench, index, model, values[index], bakes[index], integrals[index][0], against,
                agenda,
            )  # fmt: skip
            if _climbs(options, entry):
                ladder = assess.ladder(bench, index, model, values[index], against, agenda)
        results.append(
            ModelResult(
                model.id,
                model.label if entry.variant == EQUATION else f"{model.label} ({entry.variant})",
                model.citation,
                entry.variant,
                values[index],
                left_out(renderer.scene, model.id),
                measured,
                reasons.get(index),
                ladder,
            )
        )
    comparison = Comparison(
        options.name,
        renderer.scene,
        mask,
        single,
        full,
        late,
        tuple(results),
        traced,
        machine(),
        versions() | renderer.versions(),
    )
    with agenda.part("report", "writing the report"):
        write(comparison, bench.directory)
    return comparison


def write(comparison: Comparison, directory: Path) -> None:
    """Write the report's files, each whole or not at all; the page and report.json come last."""
    paper.write(comparison, directory)
    for model, found in comparison.measured:
        images.write_exr(found.images, directory / model.file)
    images.write_contact_sheet(comparison, directory / "contact_sheet.png")
    page.write(comparison, directory / "report.html")
    report.write(comparison, directory / "report.json")


def _climbs(options: Options, entry: Candidate) -> bool:
    return options.ladder and entry.variant == EQUATION


def _expected(
    bench: Bench, chosen: list[tuple[Model, Candidate]], values: list[dict[str, Value]]
) -> dict[str, float]:
    options, renderer = bench.options, bench.renderer
    pixels = renderer.width * renderer.height
    # Eight replicates of the exact image.
    judged = 8 * pixels * options.points * options.directions * EXACT_PER_DIRECTION
    expected = {"single": options.seconds / 4, "full": options.seconds, "check": CHECK}
    for way, counts in rungs(options.baselines):
        expected |= {
            f"{way.id}:{samples}": DRAWS * (BASELINE + samples * pixels * PER_SAMPLE)
            for samples in counts
        }
    for index, (model, entry) in enumerate(chosen):
        expected |= {
            f"bake {index}": BAKE * options.repeats,
            f"integral {index}": INTEGRAL,
            f"display {index}": DISPLAY,
            f"exact {index}": judged,
            f"field {index}": FIELD,
            f"savings {index}": SAVINGS,
            f"witness {index}": options.seconds / 4,
        }
        if _climbs(options, entry):
            count = len(assess.settings(model, values[index], renderer.scene))
            rung = BAKE * options.repeats + DISPLAY + INTEGRAL
            expected |= {f"ladder {index} {number}": rung for number in range(count)}
    return expected | {"report": 3.0}


def _bakes(
    bench: Bench,
    chosen: list[tuple[Model, Candidate]],
    values: list[dict[str, Value]],
    agenda: Agenda,
) -> tuple[dict[int, Bake], dict[int, str]]:
    """The bakes of the models that can serve the scene, and why the others cannot."""
    bakes, reasons = {}, {}
    for index, (model, _) in enumerate(chosen):
        with agenda.part(f"bake {index}", f"{model.label}: baking"):
            try:
                bakes[index] = measure.bake(bench, model, values[index], agenda.control)
            except StorageError:
                raise
            except InputError as error:
                reasons[index] = str(error)
        if index in reasons:
            agenda.drop_all(index)
    return bakes, reasons


def _references(
    bench: Bench, mask: Mask, agenda: Agenda
) -> tuple[Reference, Reference, Truncation]:
    renderer, control = bench.renderer, agenda.control
    bounces = bench.options.bounces or bounce_limit(renderer.scene.medium)
    parts = bench.directory / "parts"
    with agenda.part("single", "single scattering") as told:
        single = render(renderer, 0, bench.stopping(0.25), mask, parts, control, told)
    with agenda.part("full", "full scattering") as told:
        full = render(renderer, bounces, bench.stopping(), mask, parts, control, told)
    with agenda.part("check", "checking the number of bounces"):
        path = bench.part("bounces", bounces=bounces)
        held = load(path)
        if held is None:
            late = truncation(renderer, bounces, mask, control)
            store(path, gain=late.gain, noise=late.noise)
        else:
            late = Truncation(bounces // 2, float(held["gain"]), float(held["noise"]))
    return single, full, late
