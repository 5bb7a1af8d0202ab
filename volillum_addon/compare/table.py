"""Figures in words: never below their noise, and a table for the terminal."""

from __future__ import annotations

import math

from .metrics import Figure
from .results import Comparison


def percent(figure: Figure) -> str:
    """An error as "12.3 ± 0.2", or "< 0.3" when nothing was seen above the noise, in percent."""
    if figure.is_bound:
        return f"< {_significant(100 * figure.relative_rmse, 2)}"
    return with_noise(100 * figure.relative_rmse, 100 * figure.noise)


def bias_percent(figure: Figure) -> str:
    """A bias as "+1.2 ± 0.1", in percent."""
    return with_noise(100 * figure.bias, 100 * figure.bias_noise, signed=True)


def with_noise(value: float, noise: float, signed: bool = False) -> str:
    """A value to the first digit of its standard error, or the second where that begins with 1."""
    sign = "+" if signed else ""
    if noise <= 0:
        return f"{value:{sign}.3g}"
    power = math.floor(math.log10(noise))
    digits = max(0, -power + (noise < 2 * 10.0**power))
    return f"{value:{sign}.{digits}f} ± {noise:.{digits}f}".replace("-", "−")


def seconds(value: float) -> str:
    """A time as "0.123 s", "12.3 s", "3 min 20 s"."""
    if value >= 120:
        return f"{round(value) // 60} min {round(value) % 60} s"
    return f"{_significant(value, 3)} s"


def _significant(value: float, digits: int) -> str:
    if value == 0:
        return "0"
    places = max(0, digits - 1 - math.floor(math.log10(abs(value))))
    return f"{value:.{places}f}"


COLUMNS = (
    "model", "bake", "+ write", "+ display", "memory",
    "total error %", "bias %", "model %", "numerical %", "field %", "display %", "exposed %",
)  # fmt: skip


def rows(comparison: Comparison) -> list[tuple[str, ...]]:
    """The table's cells, one row a model that serves the scene."""
    result: list[tuple[str, ...]] = []
    for model, found in comparison.measured:
        taken, errors = found.seconds, found.errors
        result.append(
            (
                model.label,
                seconds(taken.bake.median),
                seconds(taken.hand_over.median),
                seconds(taken.display.median),
                f"{found.peak_bytes / 2**20:.0f} MiB",
                percent(errors["total"]),
                bias_percent(errors["total"]),
                percent(errors["model"]),
                percent(errors["numerical"]),
                percent(errors["numerical_field"]),
                percent(errors["display"]),
                percent(found.total_after_exposure),
            )
        )
    return result


def text(comparison: Comparison) -> str:
    """The closing table of a run."""
    lines = [COLUMNS, *rows(comparison)]
    widths = [max(len(row[column]) for row in lines) for column in range(len(COLUMNS))]
    formatted = [
        "  ".join(
            cell.ljust(width) if column == 0 else cell.rjust(width)
            for column, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in lines
    ]
    formatted.insert(1, "  ".join("-" * width for width in widths))
    full, single = comparison.full, comparison.single
    formatted.append("")
    formatted += [
        f"full scattering: {full.bounces} bounces, {full.seeds} x {full.samples} samples, "
        f"{seconds(full.seconds)}, noise {100 * full.noise:.2g} %; "
        f"single scattering: {single.seeds} x {single.samples} samples, "
        f"{seconds(single.seconds)}, noise {100 * single.noise:.2g} %",
        "errors: relative RMS inside the silhouette ± standard error; '<': nothing was seen above "
        "the noise; exposed: the total error after the best exposure",
    ]
    formatted += [f"{model.label}: {model.reason}" for model in comparison.models if model.reason]
    return "\n".join(formatted)
