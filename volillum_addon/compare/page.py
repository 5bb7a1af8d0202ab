"""report.html: one self-contained page, readable in light and dark, with nothing to load."""

from __future__ import annotations

from collections.abc import Iterator
from html import escape
from pathlib import Path
from string import Template

import numpy as np
from numpy.typing import NDArray

from ..bake.store import replacing
from ..models.registry import get
from .images import Tone, colour_bar, data_uri
from .metrics import Figure
from .plot import plot
from .reference import Reference
from .results import Comparison, Measured, ModelResult
from .table import bias_percent, percent, seconds, with_noise

TEMPLATE = Path(__file__).with_name("page.html")
# Wider pictures are shrunk by the browser, smaller ones keep their pixels visible.
SMOOTH_WIDTH = 300


def page(comparison: Comparison) -> str:
    """The whole page."""
    tone = Tone.of(comparison)
    columns = [header for header, _, _ in _cells(*comparison.measured[0])]
    return Template(TEMPLATE.read_text(encoding="utf-8")).substitute(
        title=escape(comparison.name),
        version=escape(comparison.versions.get("volillum", "")),
        lead=escape(_lead(comparison)),
        caption=escape(_caption(comparison)),
        head="".join(
            f'<th scope="col" aria-sort="none"><button type="button">{escape(name)}</button></th>'
            for name in ["Model", *columns]
        ),
        rows="\n".join(_row(i, *entry) for i, entry in enumerate(comparison.measured)),
        failures="".join(
            f'<p class="warn">{escape(model.label)}: {escape(model.reason)}</p>'
            for model in comparison.models
            if model.reason
        ),
        plot=plot(comparison),
        tone="All pictures have one exposure, with the sRGB curve and no other. Errors are "
        "differences of luminance, in percent of the mean of full scattering, all on this scale.",
        limit=f"{100 * tone.limit:g}",
        colour_bar=data_uri(colour_bar()),
        rendering="pixelated" if comparison.mask.shape[1] < SMOOTH_WIDTH else "auto",
        pictures="\n".join(
            _model(tone, index, *entry) for index, entry in enumerate(comparison.measured)
        ),
        reference_pictures=_picture(tone, comparison.full, "Full scattering")
        + _picture(tone, comparison.single, "Single scattering"),
        references=_references(comparison),
        conditions="".join(
            f"<dt>{escape(name)}</dt><dd>{escape(value)}</dd>"
            for name, value in _conditions(comparison)
        ),
    )


def write(comparison: Comparison, path: Path) -> None:
    """Write report.html, whole or not at all."""
    text = page(comparison)
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def _lead(comparison: Comparison) -> str:
    best, found = min(comparison.measured, key=lambda e: e[1].errors["total"].relative_rmse)
    full, distance = comparison.full, percent(found.errors["total"])
    return (
        f"{best.label} comes closest to full scattering: {distance} % away in "
        f"{seconds(found.seconds.total)}. Full scattering took {seconds(full.seconds)} to a noise "
        f"of {100 * full.noise:.2g} %."
    )


def _caption(comparison: Comparison) -> str:
    counts = sorted({len(found.seconds.bake.seconds) for _, found in comparison.measured})
    # Slow bakes are repeated less (bake/cold.py).
    count = f"{counts[0]} to {counts[-1]}" if len(counts) > 1 else f"{counts[0]}"
    return (
        f"Bake and write: medians of {count} cold processes with an empty cache. Errors: relative "
        "RMS inside the silhouette ± standard error; memory: peak of the process. "
        "A column's name sorts by it."
    )


def _cells(_model: ModelResult, found: Measured) -> Iterator[tuple[str, str, float]]:
    """Column, text, and the value that the column is sorted by."""
    taken, errors = found.seconds, found.errors
    for name, value in (
        ("Seconds", taken.total),
        ("Bake, s", taken.bake.median),
        ("Write, s", taken.hand_over.median),
        ("Display, s", taken.display.median),
    ):
        yield name, f"{value:.3f}" if value < 10 else f"{value:.1f}", value
    yield "Memory, MiB", f"{found.peak_bytes / 2**20:.0f}", found.peak_bytes
    for name, kind in (
        ("Total error, %", "total"),
        ("Model, %", "model"),
        ("Numerical, %", "numerical"),
        ("Field, %", "numerical_field"),
        ("Display, %", "display"),
    ):
        yield name, percent(errors[kind]), errors[kind].relative_rmse
        if kind == "total":
            yield "Bias, %", bias_percent(errors[kind]), errors[kind].bias
    after = found.total_after_exposure
    yield "After exposure, %", percent(after), after.relative_rmse
    exposure = found.exposure
    yield "Exposure", f"× {exposure.factor:.3g}", exposure.factor


def _row(index: int, model: ModelResult, found: Measured) -> str:
    cells = [
        f'<th scope="row" data-value="{escape(model.label)}"><span class="named">'
        f'<span class="dot series-{index % 7}" aria-hidden="true"></span>'
        f"<span>{escape(model.label)}</span></span></th>"
    ]
    for name, text, value in _cells(model, found):
        kind = ' class="headline"' if name in ("Seconds", "Total error, %") else ""
        cells.append(f'<td data-value="{value!r}"{kind}>{escape(text)}</td>')
    return "<tr>" + "".join(cells) + "</tr>"


def _model(tone: Tone, index: int, model: ModelResult, found: Measured) -> str:
    images, errors = found.images, found.errors
    pictures = [
        _figure(tone.picture(images.displayed.value), f"{model.label}: the baked grids in Blender",
                f"{model.label}, displayed"),
        _figure(tone.picture(images.full.value), "Full scattering", "full scattering"),
        _error(tone, images.total, "Total error", errors["total"], model.label),
    ]  # fmt: skip
    parts = [
        _error(tone, images.model, "Model error", errors["model"], model.label),
        _error(tone, images.numerical, "Numerical error", errors["numerical"], model.label),
        _error(tone, images.display, "Display error", errors["display"], model.label),
    ]
    parameters = ", ".join(f"{name} {_plain(value)}" for name, value in model.parameters.items())
    left_out = "".join(f"<li>{escape(note)}</li>" for note in model.left_out)
    needs = "".join(
        f"<dt>{escape(need.feature)}</dt><dd>{escape(f'{need.treatment}: {need.reason}')}</dd>"
        for need in get(model.id).needs
    )
    return (
        '<article class="model"><header>'
        f'<h3><span class="dot series-{index % 7}" aria-hidden="true"></span>'
        f"{escape(model.label)}</h3>"
        f"<span><strong>{escape(percent(errors['total']))} %</strong> in "
        f"<strong>{escape(seconds(found.seconds.total))}</strong></span>"
        f'<span class="quiet">bias {escape(bias_percent(errors["total"]))} %; after exposure '
        f"{escape(percent(found.total_after_exposure))} %</span></header>"
        f'<div class="pictures">{"".join(pictures)}</div>'
        "<details><summary>The three parts of the error</summary>"
        f'<div class="pictures parts">{"".join(parts)}</div></details>'
        + (f"<p>What it leaves out of this scene:</p><ul>{left_out}</ul>" if left_out else "")
        + f"<details><summary>How it treats a scene</summary><dl>{needs}</dl></details>"
        f'<p class="quiet">{escape(parameters)}.<br>{escape(model.citation)}.</p>'
        + _witness(found)
        + "</article>"
    )


def _witness(found: Measured) -> str:
    witness = found.witness
    if witness is None:
        return ""
    verdict = "agrees" if witness.agrees else "does not agree"
    kind = "quiet" if witness.agrees else "warn"
    return (
        f'<p class="{kind}">Cycles solves this equation too: its image {verdict} with the exact '
        f"image within their noise (mean z² of {witness.blocks} blocks "
        f"{witness.mean_z_squared:.2f} ± {witness.spread:.2f}, bias {witness.bias_z:+.1f} standard "
        "errors).</p>"
    )


def _references(comparison: Comparison) -> str:
    full, single, late = comparison.full, comparison.single, comparison.truncation
    gain = with_noise(100 * late.gain, 100 * late.noise, signed=True)
    return (
        f"<p>{escape(_described('Full scattering', full))} "
        f"From {late.half} to {full.bounces} bounces its mean changes by {gain} %.</p>"
        f"<p>{escape(_described('Single scattering', single))}</p>"
    )


def _described(name: str, reference: Reference) -> str:
    return (
        f"{name}: {reference.bounces} volume bounces, {reference.seeds} independent seeds of "
        f"{reference.samples} samples, {seconds(reference.seconds)}, noise "
        f"{100 * reference.noise:.2g} % (relative RMS inside the silhouette)."
    )


def _conditions(comparison: Comparison) -> Iterator[tuple[str, str]]:
    grid = comparison.scene.medium.sigma_t
    height, width = comparison.mask.shape
    albedo = comparison.scene.medium.constant_albedo
    yield "Volume", " × ".join(map(str, grid.shape)) + " voxels"
    if albedo is not None:
        yield "Albedo", ", ".join(f"{value:.3g}" for value in albedo)
    yield "Lights", ", ".join(light.kind for light in comparison.scene.lights) or "none"
    yield "Pictures", f"{width} × {height} pixels, {int(comparison.mask.sum())} in the silhouette"
    for name, value in comparison.machine.items():
        yield name.replace("_", " ").capitalize(), str(value)
    for name, version in comparison.versions.items():
        yield name, version


def _picture(tone: Tone, reference: Reference, name: str) -> str:
    text = f"{name}: {reference.bounces} bounces, noise {100 * reference.noise:.2g} %"
    return _figure(tone.picture(reference.image.value), text, name)


def _error(tone: Tone, error: NDArray[np.float64], name: str, figure: Figure, label: str) -> str:
    size = f"{percent(figure)} %"
    alternative = f"signed {name.lower()} of {label}: {size}, bias {bias_percent(figure)} %"
    return _figure(tone.error_picture(error), f"{name}: {size}", alternative)


def _figure(pixels: NDArray[np.uint8], caption: str, alternative: str) -> str:
    height, width = pixels.shape[:2]
    return (
        f'<figure><img src="{data_uri(pixels)}" width="{width}" height="{height}" '
        f'alt="{escape(alternative)}"><figcaption>{escape(caption)}</figcaption></figure>'
    )


def _plain(value: object) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
