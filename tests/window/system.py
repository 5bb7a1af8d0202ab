"""A Debian system in a folder, with a Blender that opens real windows and our extension in it."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from expected_skips import skip
from project_files import ROOT

import volillum_native

HERE = Path(__file__).parent
VARIABLE = "VOLILLUM_WINDOW_BLENDER"
# Debian's is a rolling release; another version's interface is not what the extension is for yet.
VERSION = "Blender 5.2"
# A Blender that hangs is stopped after this.
PATIENCE_SECONDS = 900


@dataclass(frozen=True)
class System:
    """`folder` holds the system; `work` is /volillum inside it."""

    folder: Path
    work: Path

    def run(self, *command: str) -> subprocess.CompletedProcess[str]:
        """Run a command inside; a network does not exist there."""
        folders = " ".join(dict.fromkeys(map(str, elsewhere())))
        return subprocess.run(
            [HERE / "enter.sh", self.folder, self.work, folders, *command],
            capture_output=True,
            text=True,
            check=False,
            timeout=PATIENCE_SECONDS,
        )

    def blender(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        """Run Blender in the background."""
        return self.run("blender", "--background", *arguments)

    def window(self, *arguments: str, user: str) -> subprocess.CompletedProcess[str]:
        """Run Blender in a window that fills a display of its own, with the folder of a user who
        has been here before, or a new one."""
        return self.run(
            "env", f"BLENDER_USER_RESOURCES=/volillum/{user}",
            "/volillum/tests/display.sh", "blender", "--gpu-backend", "opengl",
            "--window-geometry", "0", "0", "1400", "900", *arguments,
        )  # fmt: skip


def elsewhere() -> tuple[Path, ...]:
    """What this Python is made of: inside the system it is a second Blender, as a module, whose
    Cycles renders volumes, which Debian's does not."""
    return (
        Path(sys.prefix),
        Path(sys.base_prefix),
        Path(volillum_native.__file__).parent,
    )


def find_system(work: Path) -> System:
    """The system, made if it is not there; skips where it cannot be, and says why."""
    folder = Path(os.environ.get(VARIABLE) or ROOT / "build" / "window" / "system")
    made = subprocess.run(
        [ROOT / "tools" / "make_window_blender.sh", folder],
        capture_output=True,
        text=True,
        check=False,
    )
    if made.returncode != 0:
        skip("real Blender", made.stderr.strip())
    shutil.copytree(HERE, work / "tests", ignore=shutil.ignore_patterns("__pycache__"))
    (work / "home").mkdir()
    system = System(folder, work)
    done = system.blender("--version")
    assert done.returncode == 0, done.stdout + done.stderr
    version = next(line for line in done.stdout.splitlines() if line.startswith("Blender "))
    if not version.startswith(VERSION):
        skip("real Blender", f"{folder} has {version}; expected {VERSION}")
    return system
