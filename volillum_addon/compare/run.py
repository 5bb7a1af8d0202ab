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
from . import images, measure, page, report
from .bounces import Truncation, bounce_limit, truncation
from .cache import key_of, load, store
from .errors import ErrorImages
from .machine import machine, versions
from .measure import Bake, Bench, Options
from .metrics import Image, Mask, silhouette
from .progress import Agenda
from .reference import Reference, render
from .renderer import Renderer
from .results import Comparison, Measured, ModelResult

# Expected seconds of the parts, before any of them is known: a guess that only weighs them.
BAKE, DISPLAY, INTEGRAL, FIELD, CHECK = 3.0, 3.0, 1.0, 5.0, 25.0
EXACT_PER_DIRECTION = 4e-7  # and per pixel, point and replicate


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
    report.json, report.html, contact_sheet.png and one OpenEXR a model.

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
    agenda = Agenda(control, _expected(bench, len(chosen)), budgets)
    bakes, reasons = _bakes(bench, chosen, values, agenda)
    if not bakes:
        raise InputError("; ".join(reasons.values()) or "no model was asked for; expected one")
    integrals = {}
    for index, baked in bakes.items():
        with agenda.part(f"integral {index}", f"{chosen[index][0].label}: integrating"):
            integrals[index] = measure.integral(bench, baked, control)
    mask = silhouette(next(iter(integrals.values()))[1])
    single, full, late = _references(bench, mask, agenda)
    results = []
    for index, (model, entry) in enumerate(chosen):
        measured = None
        if index in bakes:
            measured = _measured(
                bench, index, model, values[index], bakes[index], integrals[index][0], full, mask,
                agenda,
            )  # fmt: skip
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
        machine(),
        versions() | renderer.versions(),
    )
    with agenda.part("report", "writing the report"):
        write(comparison, bench.directory)
    return comparison


def write(comparison: Comparison, directory: Path) -> None:
    """Write the report's files, each whole or not at all; the page and report.json come last."""
    for model, found in comparison.measured:
        images.write_exr(found.images, directory / model.file)
    images.write_contact_sheet(comparison, directory / "contact_sheet.png")
    page.write(comparison, directory / "report.html")
    report.write(comparison, directory / "report.json")


def _expected(bench: Bench, models: int) -> dict[str, float]:
    options, renderer = bench.options, bench.renderer
    pixels = renderer.width * renderer.height
    # Eight replicates of the exact image.
    judged = 8 * pixels * options.points * options.directions * EXACT_PER_DIRECTION
    expected = {"single": options.seconds / 4, "full": options.seconds, "check": CHECK}
    for index in range(models):
        expected |= {
            f"bake {index}": BAKE * options.repeats,
            f"integral {index}": INTEGRAL,
            f"display {index}": DISPLAY,
            f"exact {index}": judged,
            f"field {index}": FIELD,
            f"witness {index}": options.seconds / 4,
        }
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
            for part in ("integral", "display", "exact", "field", "witness"):
                agenda.drop(f"{part} {index}")
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


def _measured(
    bench: Bench,
    index: int,
    model: Model,
    values: dict[str, Value],
    baked: Bake,
    integrated: Image,
    full: Reference,
    mask: Mask,
    agenda: Agenda,
) -> Measured:
    control = agenda.control
    with agenda.part(f"display {index}", f"{model.label}: displaying"):
        displayed, seconds = measure.display(bench, baked)
    with agenda.part(f"exact {index}", f"{model.label}: exact image"):
        exact = measure.exact(bench, model, values, control)
    with agenda.part(f"field {index}", f"{model.label}: exact field"):
        field_figure = measure.field(bench, baked, control)
    with agenda.part(f"witness {index}", f"{model.label}: Cycles as a witness") as told:
        witness = measure.witness(bench, model, values, mask, control, told)
    pictures = ErrorImages(displayed, integrated, exact, full.image)
    exposure, exposed = pictures.exposed(mask)
    return Measured(
        baked.seconds(seconds),
        baked.peak_bytes,
        pictures,
        pictures.figures(mask) | {"numerical_field": field_figure},
        exposure,
        exposed,
        witness,
    )
