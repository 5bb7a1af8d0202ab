"""The pictures of the page: every model's, its signed errors, references, the profile's line."""

from __future__ import annotations

from html import escape

import numpy as np
from numpy.typing import NDArray

from ..models.registry import get
from .images import Tone, data_uri
from .metrics import Figure
from .plot import COLOURS
from .profile import profile
from .reference import Reference
from .renderer import counted
from .results import Comparison, Measured, ModelResult
from .table import bias_percent, flip_text, percent, seconds


def models(tone: Tone, comparison: Comparison) -> str:
    """One article a model."""
    return "\n".join(_model(tone, index, *entry) for index, entry in enumerate(comparison.measured))


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
        f'<h3><span class="dot series-{index % COLOURS}" aria-hidden="true"></span>'
        f"{escape(model.label)}</h3>"
        f"<span><strong>{escape(percent(errors['total']))} %</strong> in "
        f"<strong>{escape(seconds(found.seconds.total))}</strong></span>"
        f'<span class="quiet">bias {escape(bias_percent(errors["total"]))} %; after exposure '
        f"{escape(percent(found.total_after_exposure))} %; FLIP {escape(flip_text(found.flip))}"
        "</span></header>"
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


def references(tone: Tone, comparison: Comparison) -> str:
    """Both references."""
    return _picture(tone, comparison.full, "Full scattering") + _picture(
        tone, comparison.single, "Single scattering"
    )


def baselines(tone: Tone, comparison: Comparison) -> str:
    """Path tracing with few samples: one picture of each."""
    return "".join(
        _figure(
            tone.picture(entry.measured.picture.astype(np.float64)),
            f"{entry.way.label}, {counted(entry.samples)}: {percent(entry.measured.total)} % in "
            f"{seconds(entry.measured.seconds.median)}, FLIP {flip_text(entry.measured.flip)}",
            f"{entry.way.label} with {counted(entry.samples)}",
        )
        for entry in comparison.baselines
        if entry.measured is not None
    )


def profile_line(tone: Tone, comparison: Comparison) -> str:
    """Full scattering with the line of the profile on it."""
    found = profile(comparison)
    height, width = comparison.mask.shape
    # Pixel centres lie at halves.
    (x1, y1), (x2, y2) = ((x + 0.5, y + 0.5) for x, y in (found.begin, found.end))
    picture = data_uri(tone.picture(comparison.full.image.value))
    line = f"M{x1:.1f} {y1:.1f}L{x2:.1f} {y2:.1f}"
    thick = f"{max(width, height) / 250:.2f}"
    return (
        f'<figure class="line"><svg viewBox="0 0 {width} {height}" role="img" '
        'aria-label="Full scattering with the line of the profile">'
        f'<image href="{picture}" width="{width}" height="{height}"/>'
        f'<path d="{line}" fill="none" stroke="#000" stroke-width="{thick}"/>'
        f'<path d="{line}" fill="none" stroke="#fff" stroke-width="{thick}" '
        'stroke-dasharray="3 3"/></svg><figcaption>The line, through the steepest place of full '
        "scattering well inside the silhouette</figcaption></figure>"
    )


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
