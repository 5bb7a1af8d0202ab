"""report.html: one self-contained page, readable in light and dark, with nothing to load."""

from __future__ import annotations

from collections.abc import Iterator
from html import escape
from pathlib import Path
from string import Template

from ..bake.store import replacing
from . import page_pictures, page_tables
from .figures import summary
from .images import Tone, colour_bar, data_uri
from .plot import STYLE
from .plots import all_plots
from .reference import Reference
from .results import Comparison
from .table import seconds, with_noise

TEMPLATE = Path(__file__).with_name("page.html")
# Wider pictures are shrunk by the browser, smaller ones keep their pixels visible.
SMOOTH_WIDTH = 300


def page(comparison: Comparison) -> str:
    """The whole page."""
    tone, found, plots = Tone.of(comparison), summary(comparison), all_plots(comparison)
    left_out = "".join(f"<li>{escape(each)}</li>" for each in page_tables.left_out(comparison))
    traced = page_pictures.baselines(tone, comparison)
    return Template(TEMPLATE.read_text(encoding="utf-8")).substitute(
        title=escape(comparison.name),
        version=escape(comparison.versions.get("volillum", "")),
        plot_style=STYLE.read_text(encoding="utf-8"),
        lead=escape(page_tables.lead(comparison, found)),
        reaches=page_tables.reaches(found),
        errors=page_tables.errors(comparison, found),
        costs=page_tables.costs(comparison, found),
        savings=page_tables.savings(comparison, found),
        moves=page_tables.moves(found),
        left_out=_folded("Settings that were left out", f"<ul>{left_out}</ul>" if left_out else ""),
        failures="".join(
            f'<p class="warn">{escape(model.label)}: {escape(model.reason)}</p>'
            for model in comparison.models
            if model.reason
        ),
        error_time=plots["error_time"],
        error_parts=plots["error_parts"],
        profile=plots["profile"],
        profile_line=page_pictures.profile_line(tone, comparison),
        tone="All pictures have one exposure, with the sRGB curve and no other. Errors are "
        "differences of luminance, in percent of the mean of full scattering, all on this scale.",
        limit=f"{100 * tone.limit:g}",
        colour_bar=data_uri(colour_bar()),
        rendering="pixelated" if comparison.mask.shape[1] < SMOOTH_WIDTH else "auto",
        pictures=page_pictures.models(tone, comparison),
        baselines=_folded(
            "Path tracing with few samples",
            f'<div class="pictures">{traced}</div>' if traced else "",
        ),
        reference_pictures=page_pictures.references(tone, comparison),
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


def _folded(title: str, content: str) -> str:
    return f"<details><summary>{escape(title)}</summary>{content}</details>" if content else ""


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
