"""Progress and the estimate of what remains, under a clock of our own."""

import pytest

from volillum_addon.compare.progress import Agenda
from volillum_addon.core.control import Cancelled, Control


class Clock:
    """Seconds that pass when told to."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


def test_the_estimate_follows_the_pace() -> None:
    clock, control = Clock(), Control()
    agenda = Agenda(control, {"a": 10, "b": 20, "c": 30}, clock=clock)
    assert agenda.remaining() == 60
    with agenda.part("a", "first"):
        assert control.message == "first (about 60.0 s left)"
        clock.now += 20
    assert control.fraction == pytest.approx(10 / 60)
    # Twice as slow as expected.
    assert agenda.remaining() == 100
    with agenda.part("b", "second") as told:
        told(0.0, "seed 1")
        assert control.message == "second, seed 1 (about 100 s left)"
        clock.now += 10
        told(0.5, "seed 2")
        assert control.fraction == pytest.approx((10 + 10) / 60)
        # Half of it in 10 s: another 10, and c at the pace so far.
        assert control.message == "second, seed 2 (about 70.0 s left)"
        clock.now += 10
    assert agenda.remaining() == pytest.approx(30 * (40 / 30))


def test_budgets_are_kept_whatever_the_pace() -> None:
    clock, control = Clock(), Control()
    agenda = Agenda(control, {"a": 10, "b": 20, "c": 30}, ["b"], clock)
    with agenda.part("a", "slow"):
        clock.now += 30
    assert agenda.remaining() == 20 + 90
    with agenda.part("b", "limited"):
        clock.now += 5
    assert agenda.remaining() == 90


def test_parts_that_were_found_leave_the_pace_alone() -> None:
    clock, control = Clock(), Control()
    agenda = Agenda(control, {"a": 100, "b": 20}, clock=clock)
    with agenda.part("a", "found"):
        clock.now += 0.01
    assert agenda.remaining() == 20
    agenda.drop("b")
    assert agenda.remaining() == 0


def test_a_cancel_stops_the_next_part() -> None:
    control = Control()
    agenda = Agenda(control, {"a": 1, "b": 1})
    with agenda.part("a", "first"):
        control.cancel()
    with pytest.raises(Cancelled), agenda.part("b", "second"):
        pytest.fail("a cancelled control began a part")
