"""What `volillum hardcases` does. Needs no bpy."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path

from ..bake.store import prepare
from ..core.errors import InputError
from ..models.registry import get, models
from . import hard_page
from .hard_cases import Cell, run
from .hard_scenes import catalogue

JSON, PICTURE, PAGE = "hard_cases.json", "hard_cases.svg", "hard_cases.md"


def hardcases(ids: Sequence[str], directory: Path) -> str:
    """Examine the models (all, when none is named) in all cases and write table, page and picture
    into `directory`; the table as text.

    Raises InputError, after all is written, when a model breaks a law.
    """
    chosen = [get(each) for each in ids] if ids else list(models())
    cases = catalogue()
    prepare(directory)
    total = len(cases) * len(chosen)
    done = 0

    def told(cell: Cell) -> None:
        nonlocal done
        done += 1
        if sys.stderr.isatty():
            print(f"\r{done} of {total}: {cell.case:<28}", end="", file=sys.stderr, flush=True)

    cells = run(cases, chosen, told)
    if sys.stderr.isatty():
        print(file=sys.stderr)
    write(directory / PICTURE, hard_page.as_picture(cases, chosen, cells))
    write(directory / PAGE, hard_page.as_markdown(cases, chosen, cells, PICTURE))
    write(directory / JSON, json.dumps(hard_page.as_json(cases, chosen, cells), indent=1) + "\n")
    text = hard_page.as_text(cases, chosen, cells)
    broken = [cell for cell in cells if cell.status == "broken"]
    if broken:
        print(text)
        raise InputError(
            f"{len(broken)} cells break a law, first {broken[0].case} of {broken[0].model}: "
            f"{broken[0].reason}; expected none (see {directory / PAGE})"
        )
    return f"{text}\n\n{directory / PAGE}"


def write(path: Path, text: str) -> None:
    """Whole or not at all."""
    temporary = path.with_name(path.name + ".part")
    temporary.write_text(text, encoding="utf-8")
    temporary.replace(path)
