"""The command line as tests call it: many calls in one fresh Blender, and what came of each."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from project_files import ROOT

ENVIRONMENT = os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "tests"), *[
    path for path in sys.path if "scripts" not in Path(path).parts]])}  # fmt: skip


@dataclass(frozen=True)
class Result:
    status: int
    out: str
    err: str

    @property
    def line(self) -> str:
        """The one line of the complaint."""
        lines = self.err.splitlines()
        assert len(lines) == 1, self.err
        assert lines[0].startswith("volillum: ")
        return lines[0].removeprefix("volillum: ")


def start(folder: Path, *arguments: str) -> subprocess.Popen[str]:
    """The command line as a process of its own."""
    return subprocess.Popen(
        [sys.executable, "-m", "volillum_addon", *arguments],
        cwd=folder,
        env=ENVIRONMENT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def session(folder: Path, *calls: list[str]) -> list[Result]:
    """The calls, one after another, in a fresh process whose working directory is `folder`."""
    (folder / "calls.json").write_text(json.dumps(calls))
    done = subprocess.run(
        [sys.executable, ROOT / "tests" / "cli_session.py", "calls.json", "results.json"],
        cwd=folder,
        env=ENVIRONMENT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return [Result(*each) for each in json.loads((folder / "results.json").read_text())]
