"""What a bake takes from nothing: in a fresh process, without the file it would find.

The child (`cold_child`) gets this process's sys.path through its environment and imports the
package under its plain name, so that it also starts where the package's parents need Blender.
"""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from ..core.control import Control
from ..core.errors import InputError
from ..core.scene import Scene
from .run import Plan, plan_bake
from .scene_file import write_scene
from .store import replacing

PACKAGE = Path(__file__).resolve().parents[1]
CHILD = f"{PACKAGE.name}.bake.cold_child"
# How long a child that has been told to stop may take before it is left to the system.
STOP_SECONDS = 10.0

# A bake of this many seconds has its start-up and the noise of the machine averaged out.
ENOUGH_SECONDS = 5.0


@dataclass(frozen=True)
class Timing:
    """Seconds of one cold bake, and memory.

    `whole` from the start of the process until the file is safely under its name: `start_up`
    (Python and imports), `load` (the scene), `bake` (the model's own work), `hand_over` (grids
    built, compressed, written), checks and hashing. `peak_bytes` is the process's peak resident
    memory, `bake_bytes` what of it came on top of the loaded scene.
    """

    whole: float
    start_up: float
    load: float
    bake: float
    hand_over: float
    peak_bytes: int
    bake_bytes: int


def cold_bake(
    scene: Scene,
    model: str,
    directory: Path | str,
    name: str,
    parameters: Mapping[str, object] | None = None,
    repeats: int = 1,
    control: Control | None = None,
    half: bool = False,
) -> list[Timing]:
    """Bake up to `repeats` times, each in a process of its own; the last file stays. Slow bakes
    are repeated less: no new one begins after ENOUGH_SECONDS.

    The file is the one that `bake_file` then finds. Raises InputError like `bake_file`, Cancelled
    (the child is killed), RuntimeError when a child fails otherwise.
    """
    control = control or Control()
    plan = plan_bake(scene, model, directory, name, parameters, half)
    timings: list[Timing] = []
    with tempfile.TemporaryDirectory(prefix="volillum-") as folder:
        scene_file = Path(folder) / "scene.npz"
        write_scene(scene, scene_file)
        begin = time.perf_counter()
        for index in range(repeats):
            if timings and time.perf_counter() - begin > ENOUGH_SECONDS:
                break
            message = f"cold bake {index + 1} of {repeats}" if repeats > 1 else "cold bake"
            with control.stage(index / repeats, (index + 1) / repeats, message):
                timings.append(_one(plan, scene_file, name, control))
    return timings


def _one(plan: Plan, scene_file: Path, name: str, control: Control) -> Timing:
    begin = time.perf_counter()
    with replacing(plan.path) as temporary:
        request = {
            "scene": str(scene_file),
            "model": plan.model,
            "parameters": {key: str(value) for key, value in plan.values.items()},
            "name": name,
            "half": plan.half,
            "target": str(temporary),
            "hash": plan.hash,
        }
        started, answer = 0.0, None
        with _child(request) as lines:
            for line in lines:
                control.check()
                started = started or time.perf_counter() - begin
                event = json.loads(line)
                if "error" in event:
                    raise InputError(event["error"])
                if "done" in event:
                    answer = event["done"]
                elif "fraction" in event:
                    control.report(event["fraction"])
        if answer is None:
            raise RuntimeError("the cold bake's process ended without an answer")
    return Timing(whole=time.perf_counter() - begin, start_up=started, **answer)


def child_environment() -> dict[str, str]:
    """The environment of a Python process that imports what this one can, and this package under
    its plain name.

    Without the script folders that a running Blender has put on its path: the `bpy` in them is
    only a part of the module, and would hide the whole one.
    """
    paths = [str(PACKAGE.parent), *(path for path in sys.path if path and not _is_blenders(path))]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(paths)}


def _is_blenders(path: str) -> bool:
    return any(
        (folder / "scripts").is_dir() and (folder / "datafiles").is_dir()
        for folder in Path(path).parents
    )


@contextlib.contextmanager
def _child(request: Mapping[str, object]) -> Iterator[IO[str]]:
    """Run the child and yield the lines that it prints. It stops when its input is closed."""
    with tempfile.TemporaryFile("w+") as complaints:
        child = subprocess.Popen(
            [sys.executable, "-P", "-m", CHILD],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=complaints,
            env=child_environment(),
            text=True,
            encoding="utf-8",
        )
        assert child.stdin is not None
        assert child.stdout is not None
        try:
            with contextlib.suppress(BrokenPipeError):
                child.stdin.write(json.dumps(request) + "\n")
                child.stdin.flush()
            yield child.stdout
            status = child.wait(STOP_SECONDS)
            if status != 0:
                complaints.seek(0)
                raise RuntimeError(
                    f"the cold bake's process ended with status {status}; expected 0: "
                    + _last_line(complaints)
                )
        finally:
            child.kill()
            child.wait(STOP_SECONDS)
            with contextlib.suppress(BrokenPipeError):
                child.stdin.close()
            child.stdout.close()


def _last_line(file: Any) -> str:
    lines = [line.strip() for line in file if line.strip() and not line.startswith("nanobind")]
    return lines[-1] if lines else "it said nothing"
