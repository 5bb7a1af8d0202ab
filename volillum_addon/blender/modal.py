"""The shell of operators that take long: at once from a script, beside the user's work from the
interface, with progress, Esc, and the last good result kept."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import bpy

from ..core.control import Cancelled, Control
from .failures import EXPECTED, one_line
from .jobs import Job, Work

# Ten looks a second keep the progress alive and cost nothing.
TICK_SECONDS = 0.1

_current: Job[Any] | None = None


def current() -> Job[Any] | None:
    """The job that runs now; there is one at most."""
    return _current


class Reporting:
    """What all operators have: a line for the user at the end, or what went wrong."""

    report: Callable[[set[str], str], None]  # what bpy.types.Operator brings

    def _say(self, line: str) -> set[str]:
        if line:
            self.report({"INFO"}, line)
        return {"FINISHED"}

    def _refuse(self, error: BaseException) -> set[str]:
        self.report({"ERROR"}, one_line(error))
        return {"CANCELLED"}


class InstantOperator(Reporting):
    """Mix into an operator that is done at once; `perform` is what the operator itself is."""

    def perform(self, context: bpy.types.Context) -> str:
        """Do it; the line to tell the user, which may be empty. Raises one of EXPECTED."""
        raise NotImplementedError

    def execute(self, context: bpy.types.Context) -> set[str]:
        """An error is reported, which raises RuntimeError in a script."""
        try:
            return self._say(self.perform(context))
        except EXPECTED as error:
            return self._refuse(error)


class WorkOperator(Reporting):
    """Mix into an operator; `prepare` and, where it differs from the interface,
    `prepare_beside` are what the operator itself is."""

    bl_label = ""
    _job: Job[Any] | None = None
    _work: Work[Any] | None = None
    _timer: bpy.types.Timer | None = None

    def prepare(self, context: bpy.types.Context) -> Work[Any]:
        """Check and read what the work needs. Raises one of EXPECTED."""
        raise NotImplementedError

    def prepare_beside(self, context: bpy.types.Context) -> Work[Any]:
        """The same for work that runs in another thread while the user goes on."""
        return self.prepare(context)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """All of it now. An error is reported, which raises RuntimeError in a script."""
        try:
            work = self.prepare(context)
            return self._say(work.finish(work.compute(Control())))
        except EXPECTED as error:
            return self._refuse(error)

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        """Start a job and watch it, where there is a window to watch it in."""
        global _current
        if context.window is None:
            return self.execute(context)
        if _current is not None:
            self.report({"WARNING"}, f"{_current.label} is still running")
            return {"CANCELLED"}
        try:
            self._work = self.prepare_beside(context)
        except EXPECTED as error:
            return self._refuse(error)
        self._job = _current = Job(self.bl_label, self._work)
        manager = context.window_manager
        self._timer = manager.event_timer_add(TICK_SECONDS, window=context.window)
        manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Esc cancels, a tick shows the progress or ends the job; all else is the user's."""
        job = self._job
        if job is None:
            return {"CANCELLED"}
        if event.type == "ESC" and event.value == "PRESS":
            job.cancel()
            return {"RUNNING_MODAL"}
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        if job.state == "running":
            _show(context, f"{job.label}: {job.progress}   (Esc cancels)")
            return {"PASS_THROUGH"}
        return self._end(context, job)

    def cancel(self, context: bpy.types.Context) -> None:
        """Blender ends the operator itself, on loading a file for one."""
        if self._job is not None:
            self._job.cancel()
        self._leave(context)

    def _end(self, context: bpy.types.Context, job: Job[Any]) -> set[str]:
        work = self._work
        self._leave(context)
        try:
            result = job.result()
            return self._say(work.finish(result) if work is not None else "")
        except Cancelled:
            self.report({"INFO"}, f"{job.label} was cancelled")
            return {"CANCELLED"}
        except EXPECTED as error:
            return self._refuse(error)

    def _leave(self, context: bpy.types.Context) -> None:
        global _current
        if self._timer is not None:
            context.window_manager.event_timer_remove(self._timer)
        self._timer = self._job = self._work = _current = None
        _show(context, None)


def stop() -> None:
    """Cancel what runs, without waiting: the extension is being disabled."""
    if _current is not None:
        _current.cancel()


def _show(context: bpy.types.Context, text: str | None) -> None:
    """The line at the bottom of the window, and the panel's progress bar; not the view itself,
    which may be slow to draw."""
    if context.workspace is not None:
        context.workspace.status_text_set(text)
    redraw_sidebars(context)


def redraw_sidebars(context: bpy.types.Context) -> None:
    """The sidebars of all 3D views, and nothing else of them."""
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            for region in area.regions:
                if (area.type, region.type) == ("VIEW_3D", "UI"):
                    region.tag_redraw()
