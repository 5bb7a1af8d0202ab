"""The process of a cold bake: one request on standard input, events as JSON lines on output."""

from __future__ import annotations

import json
import os
import sys
import threading
import time
from pathlib import Path

from ..core.control import Control
from ..core.errors import InputError
from . import memory
from .openvdb_module import openvdb
from .run import plan_bake
from .scene_file import read_scene

PROGRESS_SECONDS = 0.1


def main() -> int:
    """Answer the request: {"fraction": ...} while it works, {"done": ...} or {"error": ...}."""
    request = json.loads(sys.stdin.readline())
    openvdb()
    control, finished = Control(), threading.Event()
    _say({"fraction": 0.0})
    threading.Thread(target=_end_with_parent, daemon=True).start()
    ticker = threading.Thread(target=_tick, args=(control, finished))
    ticker.start()
    try:
        begin = time.perf_counter()
        scene = read_scene(request["scene"])
        load = time.perf_counter() - begin
        baseline = memory.resident_bytes()
        target = Path(request["target"])
        plan = plan_bake(
            scene,
            request["model"],
            target.parent,
            request["name"],
            request["parameters"],
            request["half"],
        )
        if plan.hash != request["hash"]:
            raise RuntimeError(f"the inputs' hash is {plan.hash}; expected {request['hash']}")
        baked = plan.solve_into(target, control)
    except InputError as error:
        _finish(ticker, finished)
        _say({"error": str(error)})
        return 0
    finally:
        _finish(ticker, finished)
    peak = memory.peak_bytes()
    _say(
        {
            "done": {
                "load": load,
                "bake": baked.seconds_bake,
                "hand_over": baked.seconds_hand_over,
                "peak_bytes": peak,
                "bake_bytes": max(0, peak - baseline),
            }
        }
    )
    return 0


def _tick(control: Control, finished: threading.Event) -> None:
    while not finished.wait(PROGRESS_SECONDS):
        _say({"fraction": control.fraction})


def _finish(ticker: threading.Thread, finished: threading.Event) -> None:
    finished.set()
    ticker.join()


def _end_with_parent() -> None:
    """Leave at once when the parent closes the request's pipe or dies: nobody waits any more."""
    while os.read(sys.stdin.fileno(), 1):
        pass
    os._exit(1)


def _say(event: dict[str, object]) -> None:
    print(json.dumps(event), flush=True)


if __name__ == "__main__":
    sys.exit(main())
