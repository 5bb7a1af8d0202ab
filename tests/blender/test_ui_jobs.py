"""Jobs beside Blender's own work: states, Esc, progress; by a timer of our own, no window."""

import threading
import time
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any

import pytest

from volillum_addon.blender import modal
from volillum_addon.blender.jobs import Clock, Job, Work, clock_text
from volillum_addon.core.control import Control
from volillum_addon.core.errors import InputError

TICK = SimpleNamespace(type="TIMER", value="NOTHING")
ESCAPE = SimpleNamespace(type="ESC", value="PRESS")
MOUSE = SimpleNamespace(type="MOUSEMOVE", value="NOTHING")


class Window:
    """The parts of Blender's context that the shell uses."""

    def __init__(self) -> None:
        self.status: list[str | None] = []
        self.timers = 0
        self.handlers = 0
        self.redrawn: set[str] = set()
        regions = [
            SimpleNamespace(type=kind, tag_redraw=lambda kind=kind: self.redrawn.add(kind))
            for kind in ("WINDOW", "UI")
        ]
        area = SimpleNamespace(type="VIEW_3D", regions=regions)
        self.window = SimpleNamespace(screen=SimpleNamespace(areas=[area]))
        self.workspace = SimpleNamespace(status_text_set=self.status.append)
        self.window_manager = self
        self.windows = [self.window]

    def event_timer_add(self, _seconds: float, window: object) -> object:
        assert window is self.window
        self.timers += 1
        return object()

    def event_timer_remove(self, _timer: object) -> None:
        self.timers -= 1

    def modal_handler_add(self, _operator: object) -> None:
        self.handlers += 1


class Operator(modal.WorkOperator):
    """An operator without Blender, whose computation is given."""

    bl_label = "Trial"

    def __init__(self, compute: Callable[[Control], Any]) -> None:
        self.compute = compute
        self.finished: list[Any] = []
        self.reports: list[tuple[set[str], str]] = []

    def prepare(self, _context: Any) -> Work[Any]:
        return Work(self.compute, self.finish)

    def finish(self, result: Any) -> str:
        # bpy may be touched here, so it has to be the main thread.
        assert threading.current_thread() is threading.main_thread()
        self.finished.append(result)
        return f"got {result}"

    def report(self, kinds: set[str], line: str) -> None:
        self.reports.append((kinds, line))


@pytest.fixture(autouse=True)
def nothing_runs() -> Iterator[None]:
    assert modal.current() is None
    yield
    assert modal.current() is None


def tick_until_over(operator: Operator, window: Window) -> set[str]:
    for _ in range(12_000):
        answer = operator.modal(window, TICK)
        if answer != {"PASS_THROUGH"}:
            return answer
        time.sleep(0.005)
    raise AssertionError("the job did not end within a minute")


def endless(control: Control) -> None:
    while True:
        control.check()
        time.sleep(0.002)


def test_a_job_ends_with_its_result_on_the_main_thread() -> None:
    threads = []

    def compute(control: Control) -> int:
        threads.append(threading.current_thread())
        with control.stage(0, 1, "counting"):
            return 42

    operator, window = Operator(compute), Window()
    assert operator.invoke(window, MOUSE) == {"RUNNING_MODAL"}
    assert (window.timers, window.handlers) == (1, 1)
    assert tick_until_over(operator, window) == {"FINISHED"}
    assert threads[0] is not threading.main_thread()
    assert operator.finished == [42]
    assert operator.reports == [({"INFO"}, "got 42")]
    assert window.timers == 0
    assert window.status[-1] is None


def test_escape_cancels_and_nothing_is_finished() -> None:
    operator, window = Operator(endless), Window()
    operator.invoke(window, MOUSE)
    assert operator.modal(window, MOUSE) == {"PASS_THROUGH"}
    assert operator.modal(window, TICK) == {"PASS_THROUGH"}
    assert window.status[-1].startswith("Trial:   0 %")
    assert window.redrawn == {"UI"}  # the view may be slow to draw
    assert operator.modal(window, ESCAPE) == {"RUNNING_MODAL"}
    assert tick_until_over(operator, window) == {"CANCELLED"}
    assert operator.finished == []
    assert operator.reports == [({"INFO"}, "Trial was cancelled")]
    assert window.timers == 0


def test_an_expected_failure_is_one_line() -> None:
    def refuse(_control: Control) -> None:
        raise InputError("albedo is 2; expected 0 to 1")

    operator, window = Operator(refuse), Window()
    operator.invoke(window, MOUSE)
    assert tick_until_over(operator, window) == {"CANCELLED"}
    assert operator.reports == [({"ERROR"}, "albedo is 2; expected 0 to 1")]


def test_a_fault_of_the_program_is_not_swallowed() -> None:
    def fault(_control: Control) -> None:
        raise ZeroDivisionError("a bug")

    operator, window = Operator(fault), Window()
    operator.invoke(window, MOUSE)
    with pytest.raises(ZeroDivisionError):
        tick_until_over(operator, window)
    assert window.timers == 0


def test_one_job_at_a_time() -> None:
    first, window = Operator(endless), Window()
    first.invoke(window, MOUSE)
    second = Operator(endless)
    assert second.invoke(window, MOUSE) == {"CANCELLED"}
    assert second.reports == [({"WARNING"}, "Trial is still running")]
    first.modal(window, ESCAPE)
    tick_until_over(first, window)


def test_blender_ending_the_operator_cancels_its_job() -> None:
    operator, window = Operator(endless), Window()
    operator.invoke(window, MOUSE)
    job = modal.current()
    operator.cancel(window)
    with pytest.raises(Exception, match="cancelled"):
        job.result()
    assert job.state == "cancelled"
    assert window.timers == 0


def test_disabling_the_extension_cancels_the_job() -> None:
    operator, window = Operator(endless), Window()
    operator.invoke(window, MOUSE)
    modal.stop()
    assert tick_until_over(operator, window) == {"CANCELLED"}


def test_without_a_window_invoke_does_all_at_once() -> None:
    operator, window = Operator(lambda _control: 7), Window()
    window.window = None
    assert operator.invoke(window, MOUSE) == {"FINISHED"}
    assert operator.finished == [7]


def test_states(start_job: Callable[[Work[Any]], Job[Any]]) -> None:
    release = threading.Event()
    job = start_job(Work(lambda _control: release.wait(5), str))
    assert job.state == "running"
    assert job.error is None
    release.set()
    assert job.result() is True
    assert job.state == "done"


def test_the_estimate_is_the_pace_so_far(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [100.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    clock = Clock()
    now[0] += 30
    assert clock.remaining(0.25) == pytest.approx(90)
    assert clock.remaining(0.0) is None
    control = Control()
    control.report(0.25)
    control.message = "sweeping"
    assert clock.line(control) == " 25 %  sweeping, 1:30 left"
    assert clock_text(3725) == "1:02:05"
