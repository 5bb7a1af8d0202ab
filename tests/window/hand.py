"""A user's hand in a real Blender: the mouse and the keys of its display, and eyes.

Steps are generators: each yields seconds to wait, or a condition to wait for, and Blender goes on
running in between (`session.py`).
"""

from __future__ import annotations

import subprocess
import time
from collections.abc import Callable, Generator
from typing import Any

import bpy

Wait = float | Callable[[], bool]
Steps = Generator[Wait, None, Any]

PICTURES = "/volillum"
CATEGORY = "Volillum"
# A button is 20 pixels high, a row of a list 23; a list's title stands before its first item.
STEP = 12
ROW = 23
FIRST_ITEM = 52
# From a panel's lowest button to the title of the next one.
TITLE = 28
# How long Blender may take to notice where the mouse is.
NOTICE_SECONDS, NOTICE_LOOPS, MOTION_SECONDS = 0.02, 3, 0.03

# Where things were found last: they are mostly still there.
_places: dict[str, tuple[int, int]] = {}


def window() -> bpy.types.Window:
    """The one window."""
    return bpy.context.window_manager.windows[0]


def view() -> bpy.types.Area:
    """The 3D view."""
    return next(area for area in window().screen.areas if area.type == "VIEW_3D")


def region(kind: str) -> bpy.types.Region:
    """A part of the 3D view."""
    return next(each for each in view().regions if each.type == kind)


def _display(*command: object) -> None:
    subprocess.run([str(part) for part in command], check=True, timeout=20)


def move(x: int, y: int) -> None:
    """Blender counts from the lower left corner, the display from the upper left one.

    In two motions, as the first one into a button only leaves the button before.
    """
    _display("xdotool", "mousemove", x - 1, window().height - 1 - y, "sleep", MOTION_SECONDS,
             "mousemove", x, window().height - 1 - y)  # fmt: skip


def key(name: str) -> None:
    """Press and release a key, `ctrl+z` for one."""
    _display("xdotool", "key", name)


def point(x: int, y: int) -> Steps:
    """The mouse there, and Blender knows: its loop has gone round a few times, however slowly."""
    move(x, y)
    for _ in range(NOTICE_LOOPS):
        yield NOTICE_SECONDS


def click(x: int, y: int) -> Steps:
    """The left button, once Blender knows where the mouse is."""
    yield from point(x, y)
    _display("xdotool", "click", 1)
    yield 0.2


def picture(name: str) -> None:
    """What the display shows now."""
    bpy.ops.wm.redraw_timer(type="DRAW_WIN_SWAP", iterations=1)
    _display("import", "-window", "root", f"{PICTURES}/{name}.png")


def into_view() -> Steps:
    """The mouse into the middle of the 3D view, away from its sidebar."""
    whole = region("WINDOW")
    move(whole.x + whole.width // 4, whole.y + whole.height // 2)
    yield 0.2


def open_sidebar() -> Steps:
    """The sidebar with the key N, and our tab in it with the mouse."""
    yield from into_view()
    if region("UI").width <= 1:
        key("n")
        yield lambda: region("UI").width > 1
    sidebar = region("UI")
    y = sidebar.y + sidebar.height - 30
    while region("UI").active_panel_category != CATEGORY:
        assert y > sidebar.y, "the sidebar has no tab of ours"
        yield from click(sidebar.x + sidebar.width - 8, y)
        y -= 25
    yield 0.3


def under_mouse() -> str:
    """The operator call or the property behind the button under the mouse; empty for none."""
    manager = bpy.context.window_manager
    manager.clipboard = ""
    with bpy.context.temp_override(window=window(), area=view(), region=region("UI")):
        if bpy.ops.ui.copy_python_command_button.poll():
            bpy.ops.ui.copy_python_command_button()
        elif bpy.ops.ui.copy_data_path_button.poll():
            bpy.ops.ui.copy_data_path_button(full_path=True)
    return str(manager.clipboard)


def find(wanted: str) -> Steps:
    """Run the mouse down the sidebar until what is under it contains `wanted`; its place."""
    sidebar = region("UI")
    rows = range(sidebar.y + sidebar.height - 4, sidebar.y, -STEP)
    known = _places.get(wanted, (sidebar.x + sidebar.width // 2, rows[0]))
    # Wide buttons, the left one of two, and a small one at the end of a row.
    columns = (
        sidebar.x + 2 * sidebar.width // 3,
        sidebar.x + sidebar.width // 4,
        sidebar.x + sidebar.width - 50,
    )
    # From where it was last to both sides.
    nearest = sorted(rows, key=lambda y: abs(y - known[1]))
    for x, y in [known, *((x, y) for y in nearest for x in columns)]:
        yield from point(x, y)
        if wanted in under_mouse():
            _places[wanted] = (x, y)
            return _places[wanted]
    raise AssertionError(f"the sidebar has no button for {wanted}")


def press(wanted: str) -> Steps:
    """Find the button and click on it."""
    x, y = yield from find(wanted)
    yield from click(x, y)


def choose(wanted: str, index: int) -> Steps:
    """Open a list that drops down and click on its item `index`."""
    x, y = yield from find(wanted)
    # Up to its edge, from which the items' places are counted.
    while wanted in under_mouse():
        y += 2
        yield from point(x, y)
    yield from click(x, y - ROW // 2)
    yield 0.5
    yield from click(x, y - ROW // 2 - FIRST_ITEM - ROW * index)
    yield 0.5


def open_next_panel(last: str) -> Steps:
    """Click on the title below `last`, the lowest button of a panel."""
    x, y = yield from find(last)
    while last in under_mouse():
        y -= 2
        yield from point(x, y)
    yield from click(x, y - TITLE)
    yield 0.5


def scroll(notches: int) -> Steps:
    """Down the sidebar, with the wheel."""
    sidebar = region("UI")
    yield from point(sidebar.x + sidebar.width // 2, sidebar.y + sidebar.height // 2)
    _display("xdotool", "click", "--repeat", notches, "--delay", 60, 5)
    yield 0.5


def type_into(wanted: str, text: str) -> Steps:
    """Double-click into a number or text, and write."""
    x, y = yield from find(wanted)
    yield from point(x, y)
    _display("xdotool", "click", "--repeat", 2, "--delay", 60, 1)
    yield 0.2
    key("ctrl+a")
    _display("xdotool", "type", text)
    yield 0.1
    key("Return")
    yield 0.3


def drive(steps: Steps, end: Callable[[BaseException | None], None], patience: float) -> None:
    """Take the steps one after another beside Blender's own work; `end` is told how it went."""
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
