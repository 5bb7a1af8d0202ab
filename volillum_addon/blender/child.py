"""The command line in a Blender of its own, on a copy of the open file, for the interface.

Cycles renders only in a process's main thread. There it would freeze the interface for minutes and
Esc could not reach it; a second process leaves the open file alone by construction, can be stopped
at any moment, and is the same code path as the command line.
"""

from __future__ import annotations

import re
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
from collections import deque
from pathlib import Path
from types import TracebackType
from typing import IO

import bpy

from ..bake.cold import PACKAGE, child_environment
from ..core.control import Cancelled, Control
from ..core.errors import InputError

PROGRESS = re.compile(r"^ *(\d+) % +(.*)$")
PROGRESS_SECONDS = 0.25
# A child that was told to stop may finish a render's tile; then it is stopped by force.
PATIENCE_SECONDS = 10.0
# What Ctrl-C in the child's own terminal would send.
INTERRUPT = getattr(signal, "CTRL_BREAK_EVENT", signal.SIGINT)


class Copy:
    """A copy of the open file in a folder of its own, removed at the end of the `with`."""

    def __init__(self) -> None:
        self._folder = Path(tempfile.mkdtemp(prefix="volillum-"))
        self.file = self._folder / "scene.blend"

    def __enter__(self) -> Path:
        return self.file

    def __exit__(
        self,
        _kind: type[BaseException] | None,
        _error: BaseException | None,
        _trace: TracebackType | None,
    ) -> None:
        shutil.rmtree(self._folder, ignore_errors=True)


def save_copy() -> Copy:
    """Save the open file as it is now, changes and all; the file itself is not touched."""
    copy = Copy()
    try:
        bpy.ops.wm.save_as_mainfile(filepath=str(copy.file), copy=True, relative_remap=True)
    except RuntimeError as error:
        copy.__exit__(None, None, None)
        raise InputError(
            f"the open file cannot be copied to {copy.file} ({error}); expected room for it there"
        ) from error
    return copy


def command(arguments: list[str]) -> tuple[list[str], dict[str, str]]:
    """The process that runs the command line, and its environment.

    The package is imported under its plain name from its own folder: as an extension its parents
    exist only where the user's preferences enable it.
    """
    environment = child_environment()
    if bpy.app.module:
        return [sys.executable, "-P", "-m", PACKAGE.name, *arguments], environment
    start = [bpy.app.binary_path, "--background", "--factory-startup", "--python-use-system-env"]
    return [*start, "--python", str(Path(__file__).with_name("child_start.py")), "--",
            *arguments], environment  # fmt: skip


def run(arguments: list[str], control: Control) -> list[str]:
    """Run the command line to its end and return the lines that it printed, one at least.

    Raises Cancelled, InputError with the child's own words, or RuntimeError when it crashed.
    """
    process, environment = command([*arguments, "--progress-seconds", str(PROGRESS_SECONDS)])
    # Not a pipe: it would have to be emptied while the child runs.
    with tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace") as output:
        _run(process, environment, output, control)
        output.seek(0)
        return output.read().strip().splitlines()


def _run(
    process: list[str], environment: dict[str, str], output: IO[str], control: Control
) -> None:
    child = subprocess.Popen(
        process,
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=output,
        stderr=subprocess.PIPE,
        text=True,
        encoding="utf-8",
        errors="replace",
        # Without a group of its own, a Windows child could not be interrupted alone.
        creationflags=getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0),
    )
    complaints: deque[str] = deque(maxlen=20)
    reader = threading.Thread(target=_follow, args=(child, control, complaints), daemon=True)
    reader.start()
    try:
        status = _wait(child, control)
        reader.join(PATIENCE_SECONDS)
    finally:
        child.kill()
        child.wait()
        if child.stderr is not None:
            child.stderr.close()
    if status == 0:
        return
    control.check()
    if status == 130:
        raise Cancelled("cancelled")
    last = complaints[-1] if complaints else "it said nothing"
    if status == 1 and last.startswith("volillum: "):
        raise InputError(last.removeprefix("volillum: "))
    raise RuntimeError(f"the process beside Blender ended with status {status}: {last}")


def _wait(child: subprocess.Popen[str], control: Control) -> int:
    while True:
        try:
            return child.wait(PROGRESS_SECONDS)
        except subprocess.TimeoutExpired:
            if not control.native.cancelled:
                continue
        child.send_signal(INTERRUPT)
        try:
            return child.wait(PATIENCE_SECONDS)
        except subprocess.TimeoutExpired:
            child.kill()
            return child.wait()


def _follow(child: subprocess.Popen[str], control: Control, complaints: deque[str]) -> None:
    """Turn the child's progress lines into the control's, and keep what else it says."""
    assert child.stderr is not None
    for line in child.stderr:
        progress = PROGRESS.match(line)
        if progress is not None:
            control.report(int(progress[1]) / 100)
            control.message = progress[2].strip()
        elif line.strip():
            complaints.append(line.strip())
