"""The table of hard cases: as text, Markdown, JSON and a picture."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from html import escape
from itertools import pairwise
from typing import Any

from ..models.model import Model
from .hard_cases import JUDGED, PATIENCE, THREADS, Cell
from .hard_scenes import HardCase

SCHEMA = 1
# The picture: pixels of a cell, of the cases' names, the models', and what these reach beyond.
WIDTH, HEIGHT, LEFT, TOP, RIGHT = 92, 20, 190, 118, 48
# Errors from the first to the last are shown from pale to full.
FAINT, STRONG = 1e-6, 1e-1

Table = dict[str, dict[str, Cell]]


def table(cells: Sequence[Cell]) -> Table:
    """Cells by case and model."""
    found: Table = {}
    for cell in cells:
        found.setdefault(cell.case, {})[cell.model] = cell
    return found


def word(cell: Cell) -> str:
    """A cell in a few characters: its error, or what became of it."""
    if cell.status == "refused":
        return "refused"
    if cell.status == "broken":
        return "BROKEN"
    if cell.error is None:
        return "kept"
    percent = 100 * cell.error
    if percent < 1e-5:
        return "0"
    return f"{percent:.0f} %" if percent >= 1 else f"{percent:.1g} %"


def counts(cells: Sequence[Cell]) -> str:
    """How many there are of each, in words."""
    number = {
        status: sum(cell.status == status for cell in cells)
        for status in ("kept", "refused", "broken")
    }
    return (
        f"{len(cells)} cells: {number['kept']} keep all laws, {number['refused']} are refused, "
        f"{number['broken']} break one"
    )


def as_text(cases: Sequence[HardCase], models: Sequence[Model], cells: Sequence[Cell]) -> str:
    """For the terminal, with what is refused and what is broken below."""
    found = table(cells)
    names = [model.id for model in models]
    left = max(len(case.id) for case in cases)
    wide = [max(len(name), 8) for name in names]
    lines = ["  ".join([" " * left, *(n.rjust(w) for n, w in zip(names, wide, strict=True))])]
    for case in cases:
        words = (word(found[case.id][n]).rjust(w) for n, w in zip(names, wide, strict=True))
        lines.append("  ".join([case.id.ljust(left), *words]))
    lines.append("")
    lines += [f"{c.case}, {c.model}: {c.status}: {c.reason}" for c in cells if c.reason]
    lines += ["", counts(cells)]
    return "\n".join(lines)


def as_markdown(
    cases: Sequence[HardCase], models: Sequence[Model], cells: Sequence[Cell], picture: str
) -> str:
    """The page of the documentation; `picture` is the picture's path beside it."""
    found = table(cells)
    lines = [
        "# Hard cases",
        "",
        "`volillum hardcases -o DIR` writes this page. Every model in every scene of",
        "`presets/hard_cases`, each with what makes it hard and what must hold; the laws and how",
        "each bound is derived are in `volillum_addon/compare/hard_laws.py`:",
        "",
        "* finite, and not negative,",
        "* no brighter than the model's own equation allows; where nothing is absorbed and the",
        "  equation conserves light, as bright as what arrives,",
        f"* the same bits with 1 and with {THREADS} threads,",
        "* no jump when light and eye turn by 1e-6 over the optical depth,",
        f"* the error against the exact solution at {JUDGED} voxels is within its estimate: twice",
        "  the difference to a bake of the same field on half the voxel size with the finest",
        "  settings, what chance adds, and, where the model computes means over voxels, what the",
        "  exact solution varies by within them.",
        "",
        "A cell is that error, relative to the light that would arrive unoccluded (of photon",
        "mapping, with 128,000 photons, noise and how far means are from values at centres), or",
        "`refused` with the reason below, or `BROKEN`.",
        f"A bake that takes more than {PATIENCE:g} processor seconds is broken, too.",
        "",
        f"**{counts(cells)}.**",
        "",
        f"![The table as a picture]({picture})",
        "",
        "| case | what is hard | what must hold | " + " | ".join(m.label for m in models) + " |",
        "| --- | --- | --- |" + " ---: |" * len(models),
    ]
    for case in cases:
        words = " | ".join(word(found[case.id][model.id]) for model in models)
        lines.append(f"| `{case.id}` | {case.hard} | {case.holds} | {words} |")
    for status, title in (("refused", "Refused"), ("broken", "Broken")):
        some = [cell for cell in cells if cell.status == status]
        lines += ["", f"## {title}", ""]
        lines += [f"* `{c.case}`, {c.model}: {c.reason}" for c in some] or ["Nothing."]
    remarks = [cell for cell in cells if cell.remark]
    if remarks:
        lines += ["", "## Not judged", ""]
        lines += [f"* `{c.case}`, {c.model}: {c.remark}" for c in remarks]
    return "\n".join(lines) + "\n"


def as_json(
    cases: Sequence[HardCase], models: Sequence[Model], cells: Sequence[Cell]
) -> dict[str, Any]:
    """For programs."""
    return {
        "schema": SCHEMA,
        "models": [model.id for model in models],
        "cases": [
            {"id": case.id, "group": case.group, "hard": case.hard, "holds": case.holds}
            for case in cases
        ],
        "cells": [
            {
                "case": cell.case,
                "model": cell.model,
                "status": cell.status,
                "reason": cell.reason,
                "error": cell.error,
                "bound": cell.bound,
                "remark": cell.remark,
                "seconds": round(cell.seconds, 3),
                "laws": [
                    {"law": each.law, "holds": each.holds, "detail": each.detail}
                    for each in cell.findings
                ],
            }
            for cell in cells
        ],
    }


def as_picture(cases: Sequence[HardCase], models: Sequence[Model], cells: Sequence[Cell]) -> str:
    """An SVG file: a cell's shade is its error, hatched ones are refused, red ones broken."""
    found = table(cells)
    groups = [case.group for case in cases]
    breaks = sum(a != b for a, b in pairwise(groups))
    width = LEFT + WIDTH * len(models) + RIGHT
    height = TOP + HEIGHT * len(cases) + 8 * breaks + 16
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" '
            f'viewBox="0 0 {width} {height}" font-family="sans-serif" font-size="11">',
            '<defs><pattern id="hatch" width="6" height="6" patternUnits="userSpaceOnUse" '
            'patternTransform="rotate(45)"><rect width="6" height="6" fill="#eee"/>'
            '<rect width="2" height="6" fill="#bbb"/></pattern></defs>',
            f'<rect width="{width}" height="{height}" fill="#fff"/>',
            *_heads(models),
            *_rows(cases, models, found),
            "</svg>",
            "",
        ]
    )


def _heads(models: Sequence[Model]) -> Iterator[str]:
    yield (
        '<text x="12" y="24" font-size="14" font-weight="bold">Hard cases</text>'
        '<text x="12" y="42" fill="#555">numerical error,</text>'
        '<text x="12" y="56" fill="#555">relative to unoccluded light</text>'
    )
    for index, model in enumerate(models):
        x = LEFT + WIDTH * (index + 0.5)
        yield (
            f'<text transform="translate({x:.0f} {TOP - 8}) rotate(-30)">'
            f"{escape(model.label)}</text>"
        )


def _rows(cases: Sequence[HardCase], models: Sequence[Model], found: Table) -> Iterator[str]:
    y, group = TOP, cases[0].group if cases else ""
    for case in cases:
        y += 8 if case.group != group else 0
        group = case.group
        yield f'<text x="{LEFT - 8}" y="{y + 14}" text-anchor="end">{escape(case.id)}</text>'
        for index, model in enumerate(models):
            cell = found[case.id][model.id]
            fill, ink = _colours(cell)
            x = LEFT + WIDTH * index
            title = escape(f"{case.id}, {model.label}: {cell.reason or word(cell)}")
            yield (
                f'<g><title>{title}</title><rect x="{x + 1}" y="{y + 1}" width="{WIDTH - 2}" '
                f'height="{HEIGHT - 2}" fill="{fill}"/><text x="{x + WIDTH / 2:.0f}" y="{y + 14}" '
                f'text-anchor="middle" fill="{ink}">{word(cell)}</text></g>'
            )
        y += HEIGHT


def _colours(cell: Cell) -> tuple[str, str]:
    """A cell's colour and that of its words."""
    if cell.status == "refused":
        return "url(#hatch)", "#333"
    if cell.status == "broken":
        return "#c62828", "#fff"
    if cell.error is None:
        return "#f4f4f4", "#333"
    place = math.log(max(cell.error, FAINT) / FAINT) / math.log(STRONG / FAINT)
    share = min(place, 1.0)
    red, green, blue = (round(a + share * (b - a)) for a, b in ((232, 33), (242, 102), (250, 172)))
    return f"rgb({red},{green},{blue})", "#fff" if share > 0.6 else "#222"
