"""What a scenario is: steps that are taken beside Blender's own work.

Steps are generators: each yields seconds to wait, or a condition to wait for, and Blender goes on
running in between.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Generator
from typing import Any

import bpy

Wait = float | Callable[[], bool]
Steps = Generator[Wait, None, Any]


def drive(steps: Steps, end: Callable[[BaseException | None], None], patience: float) -> None:
    """Take the steps one after another; `end` is told how it went."""
    waiting: list[tuple[Callable[[], bool], float]] = []

    def tick() -> float | None:
        try:
            if waiting:
                condition, limit = waiting[0]
                if not condition():
                    if time.monotonic() > limit:
                        steps.throw(TimeoutError(f"waited for {patience:g} s"))
                    return 0.05
                waiting.clear()
            wait = next(steps)
        except StopIteration:
            end(None)
            return None
        except Exception as error:  # noqa: BLE001 - whatever it is, it is reported
            end(error)
            return None
        if callable(wait):
            waiting.append((wait, time.monotonic() + patience))
            return 0.05
        return wait

    bpy.app.timers.register(tick, first_interval=1.0, persistent=True)
