"""Figures in words: never below their noise, and a table for the terminal."""

from __future__ import annotations

import math

from .figures import TARGETS, Reach, Summary, summary
from .flip import Flip
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


def flip_text(flip: Flip | None) -> str:
    """A FLIP difference as "0.123 ± 0.002", or "< 0.01"; "" where it was not looked at."""
    if flip is None:
        return ""
    if flip.is_bound:
        return f"< {_significant(flip.value, 2)}"
    return with_noise(flip.value, flip.noise)


def reach_text(found: Reach) -> str:
    """Seconds until an error, with a mark where they are not measured as they are, or why not."""
    if found.seconds is None:
        return found.how
    mark = {"measured": "", "interpolated": "≈ ", "averaged": "≤ "}[found.how]
    return mark + seconds(found.seconds)


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
    "total error %", "bias %", "exposed %", "FLIP",
    "model %", "numerical %", "field %", "display %",
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
                percent(found.total_after_exposure),
                flip_text(found.flip),
                percent(errors["model"]),
                percent(errors["numerical"]),
                percent(errors["numerical_field"]),
                percent(errors["display"]),
            )
        )
    return result


def reach_rows(found: Summary) -> list[tuple[str, ...]]:
    """Label and the seconds to each target, one row a series."""
    return [
        (one.label, *(reach_text(each) for each in reaches))
        for one, reaches in zip(found.series, found.reaches, strict=True)
    ]


def text(comparison: Comparison) -> str:
    """The closing tables of a run."""
    full, single = comparison.full, comparison.single
    targets = tuple(f"{100 * target:g} %" for target in TARGETS)
    lines = _columns(COLUMNS, rows(comparison))
    lines.append("")
    lines += _columns(("seconds to a total error of", *targets), reach_rows(summary(comparison)))
    lines.append("")
    lines += [
        f"full scattering: {full.bounces} bounces, {full.seeds} x {full.samples} samples, "
        f"{seconds(full.seconds)}, noise {100 * full.noise:.2g} %; "
        f"single scattering: {single.seeds} x {single.samples} samples, "
        f"{seconds(single.seconds)}, noise {100 * single.noise:.2g} %",
        "errors: relative RMS inside the silhouette ± standard error; '<': nothing was seen above "
        "the noise; exposed: after the best exposure; FLIP: HDR-FLIP, 0 to 1",
        "seconds: ≈ between two numbers of samples, ≤ by averaging pictures; model error: beyond "
        "what the model's equation can",
    ]
    lines += [f"{model.label}: {model.reason}" for model in comparison.models if model.reason]
    return "\n".join(lines)


def _columns(head: tuple[str, ...], cells: list[tuple[str, ...]]) -> list[str]:
    table = [head, *cells]
    widths = [max(len(row[column]) for row in table) for column in range(len(head))]
    formatted = [
        "  ".join(
            cell.ljust(width) if column == 0 else cell.rjust(width)
            for column, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in table
    ]
    formatted.insert(1, "  ".join("-" * width for width in widths))
    return formatted
