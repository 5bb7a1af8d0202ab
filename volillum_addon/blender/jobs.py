"""Long work beside Blender's own: a thread with a control, watched from the main thread.

bpy is not safe outside the main thread, so work comes in three parts: `prepare` reads the scene
(main thread), `compute` knows only the core (any thread), `finish` changes the scene (main thread).
"""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Literal

from ..core.control import Cancelled, Control

State = Literal["running", "done", "failed", "cancelled"]
# Below this share of the work an estimate of the rest is a guess.
EARLIEST_ESTIMATE = 0.02


@dataclass(frozen=True)
class Work[T]:
    """What is left to do after `prepare`; `finish` returns the line to tell the user.

    `estimates`: the work's own messages say how long it will still take.
    """

    compute: Callable[[Control], T]
    finish: Callable[[T], str]
    estimates: bool = False


class Job[T]:
    """A computation that runs in a thread of its own from its creation on."""

    def __init__(self, label: str, work: Work[T]) -> None:
        self.label = label
        self.control = Control()
        self._clock = Clock(work.estimates)
        executor = ThreadPoolExecutor(1, thread_name_prefix="volillum")
        self._future: Future[T] = executor.submit(work.compute, self.control)
        executor.shutdown(wait=False)

    @property
    def state(self) -> State:
        """Where the work is; anything but `running` is final."""
        if not self._future.done():
            return "running"
        error = self._future.exception()
        if error is None:
            return "done"
        return "cancelled" if isinstance(error, Cancelled) else "failed"

    @property
    def error(self) -> BaseException | None:
        """What went wrong, once the state is `failed`."""
        return self._future.exception() if self.state == "failed" else None

    def result(self) -> T:
        """What was computed; waits for it, and raises what the computation raised."""
        return self._future.result()

    def cancel(self) -> None:
        """Ask the work to stop; the state changes when it has."""
        self.control.cancel()

    @property
    def progress(self) -> str:
        """One line: how far, at what, how long still."""
        return self._clock.line(self.control)


class Clock:
    """How long work has run and how long it will; `estimated` when its messages say so already."""

    def __init__(self, estimated: bool = False) -> None:
        self._begin = time.monotonic()
        self._estimated = estimated

    def remaining(self, fraction: float) -> float | None:
        """Seconds to go at the pace so far, or None when that cannot be told yet."""
        if fraction < EARLIEST_ESTIMATE:
            return None
        return (time.monotonic() - self._begin) * (1 - fraction) / fraction

    def line(self, control: Control) -> str:
        """` 42 %  sweeping, 0:12 left`."""
        fraction = min(max(control.fraction, 0.0), 1.0)
        remaining = None if self._estimated else self.remaining(fraction)
        rest = "" if remaining is None else f", {clock_text(remaining)} left"
        return f"{int(100 * fraction):3d} %  {control.message}{rest}"


def clock_text(seconds: float) -> str:
    """Minutes and seconds, with hours where there are any."""
    whole = round(seconds)
    hours, minutes = divmod(whole // 60, 60)
    return f"{hours}:{minutes:02d}:{whole % 60:02d}" if hours else f"{minutes}:{whole % 60:02d}"
