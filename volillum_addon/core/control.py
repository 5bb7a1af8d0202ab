"""Progress and cancelling of long work, watched from another thread."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from .native import native

Cancelled = native.Cancelled


class Control:
    """Passed down to the kernels; `fraction` and `message` may be read from any thread."""

    def __init__(self) -> None:
        self.native = native.Control()
        self.message = ""
        self._begin, self._end = 0.0, 1.0
        self._reported = 0.0

    def cancel(self) -> None:
        """Ask the work to stop; it raises Cancelled at its next poll."""
        self.native.cancel()

    def check(self) -> None:
        """Raise Cancelled if a stop was asked for."""
        if self.native.cancelled:
            raise Cancelled("cancelled")

    @property
    def fraction(self) -> float:
        """How much of the whole work is done, 0 to 1."""
        inside = max(float(self.native.progress), self._reported)
        return self._begin + (self._end - self._begin) * inside

    def report(self, fraction: float) -> None:
        """Tell how much of the stage is done, for work that no kernel of this process does."""
        self._reported = fraction

    @contextmanager
    def stage(self, begin: float, end: float, message: str) -> Iterator[None]:
        """Run a part of the work that covers [begin, end] of the enclosing stage."""
        outer = (self._begin, self._end)
        span = outer[1] - outer[0]
        self._begin, self._end = outer[0] + span * begin, outer[0] + span * end
        self._restart(0.0)
        self.message = message
        self.check()
        try:
            yield
        finally:
            self._begin, self._end = outer
            self._restart(end)

    def _restart(self, reported: float) -> None:
        self._reported = reported
        self.native.restart_progress()
