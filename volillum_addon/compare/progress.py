"""Where a comparison is, and how long it will still take."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager

from ..core.control import Control
from .table import seconds

# Below this share a part's own pace says less than what was expected of it.
FIRST_SHARE = 0.1


class Agenda:
    """The parts of a work with the seconds that each may take, done in any order.

    Shares of the progress follow the expectations, the estimate of what remains the pace so far,
    but for the parts in `budgets`, whose seconds are a limit that they keep.
    """

    def __init__(
        self,
        control: Control,
        expected: Mapping[str, float],
        budgets: Collection[str] = (),
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:
        self.control = control
        self._expected = dict(expected)
        self._clock = clock
        self._budgets = frozenset(budgets)
        self._done = 0.0
        self._worked, self._worked_expected = 0.0, 0.0
        self._left = dict(expected)

    @contextmanager
    def part(self, name: str, message: str) -> Iterator[Callable[[float, str], None]]:
        """Do a part; the body may call what it is given with (share done, detail)."""
        expected = self._left.pop(name)
        total = sum(self._expected.values())
        begin, end = self._done / total, (self._done + expected) / total
        started = self._clock()
        pace = 1.0 if name in self._budgets else self._pace()

        def report(share: float, detail: str = "") -> None:
            self.control.report(share)
            left = expected * (1 - share) * pace
            if share >= FIRST_SHARE:
                left = (self._clock() - started) * (1 - share) / share
            self.control.message = self._worded(f"{message}, {detail}" if detail else message, left)

        with self.control.stage(begin, end, self._worded(message, expected * pace)):
            yield report
        self._done += expected
        taken = self._clock() - started
        # What was found on disk says nothing about the pace of the rest.
        if taken > FIRST_SHARE * expected and name not in self._budgets:
            self._worked += taken
            self._worked_expected += expected

    def drop(self, name: str) -> None:
        """A part that will not be done."""
        self._done += self._left.pop(name)

    def drop_all(self, index: int) -> None:
        """All parts `<what> <index> ...` that have not begun."""
        for name in [name for name in self._left if name.split()[1:2] == [str(index)]]:
            self.drop(name)

    def remaining(self) -> float:
        """Seconds of the parts that have not begun."""
        pace = self._pace()
        return sum(
            expected if name in self._budgets else expected * pace
            for name, expected in self._left.items()
        )

    def _pace(self) -> float:
        return self._worked / self._worked_expected if self._worked_expected else 1.0

    def _worded(self, message: str, left: float) -> str:
        return f"{message} (about {seconds(max(1.0, round(left + self.remaining())))} left)"
