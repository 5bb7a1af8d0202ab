"""What the stages of a bake take, for predictions of the same work on more voxels."""

from __future__ import annotations

import re
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import override

from ..core.control import Control

NUMBERS = re.compile(r"\d+")


@dataclass(frozen=True)
class Lap:
    """Seconds by the clock, and of the processor in all threads: the latter hardly depend on what
    else the machine does."""

    clock: float = 0.0
    processor: float = 0.0

    def __add__(self, other: Lap) -> Lap:
        return Lap(self.clock + other.clock, self.processor + other.processor)


class Stopwatch(Control):
    """Follows work under another control and notes each innermost stage's time by its message
    without numbers ("pass 4" and "pass 8" add up); what no stage covers is ""."""

    def __init__(self, outer: Control) -> None:
        super().__init__()
        self.laps: dict[str, Lap] = {}
        self._stages = [""]
        self._since = _now()
        self._outer = outer
        self.native = outer.native  # cancelled together

    @override
    @contextmanager
    def stage(self, begin: float, end: float, message: str) -> Iterator[None]:
        """Run a part of the work."""
        self._turn()
        self._stages.append(NUMBERS.sub("", message))
        try:
            self._outer.check()
            yield
        finally:
            self._turn()
            self._stages.pop()

    def stop(self) -> dict[str, Lap]:
        """The times so far."""
        self._turn()
        return dict(self.laps)

    def _turn(self) -> None:
        now = _now()
        lap = Lap(now.clock - self._since.clock, now.processor - self._since.processor)
        name = self._stages[-1]
        self.laps[name] = self.laps.get(name, Lap()) + lap
        self._since = now


def _now() -> Lap:
    return Lap(time.perf_counter(), time.process_time())
