"""The interface as a user has it: a real Blender, its window, a mouse and keys."""

from __future__ import annotations

import json
import shutil
import sys
from pathlib import Path

import pytest
from window.system import System

# The functions of scenarios/*.py.
SCENARIOS = (
    "baking.baking",
    "baking.undo_and_reload",
    "comparing.comparing",
    "installing.installing",
    "lighting.live",
    "opening.cancelling",
    "opening.choosing",
    "opening.importing",
    "rows.errors",
    "rows.side_by_side",
    "showing.rendering",
    "showing.switching",
)
# These begin without the extension.
NEW_USERS = {"installing.installing"}


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_by_hand(system: System, pictures: Path, scenario: str) -> None:
    done = system.window(
        *("--python", "/volillum/tests/session.py", "--", scenario, sys.executable),
        user="new_user" if scenario in NEW_USERS else "user",
    )
    for picture in system.work.glob("*.png"):
        shutil.move(picture, pictures / picture.name)
    result = system.work / f"{scenario}.json"
    assert result.is_file(), done.stdout + done.stderr
    assert json.loads(result.read_text())["error"] is None, done.stdout + done.stderr
