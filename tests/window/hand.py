"""A user's hand in a real Blender: the mouse and the keys of its display."""

from __future__ import annotations

import subprocess

import bpy
from steps import Steps

# How long Blender may take to notice where the mouse is.
NOTICE_SECONDS, NOTICE_LOOPS, MOTION_SECONDS = 0.02, 3, 0.03
# A drag is this many motions, each this long.
DRAG_MOTIONS, DRAG_SECONDS = 12, 0.15
# By its code: with a function key's name xdotool 3.2016 presses Alt too, since the keymap gives
# these keys a level for Ctrl+Alt.
F12 = "96"
# Where another program's window stands: on the properties, beside the 3D view.
FILES, GRIP = (1160, 700), 20
# A line of the outliner, and where the names in it begin.
ROW, INDENT = 20, 100


def window() -> bpy.types.Window:
    """The one window."""
    return bpy.context.window_manager.windows[0]


def area(kind: str) -> bpy.types.Area:
    """The area of this kind."""
    return next(each for each in window().screen.areas if each.type == kind)


def view() -> bpy.types.Area:
    """The 3D view."""
    return area("VIEW_3D")


def region(kind: str) -> bpy.types.Region:
    """A part of the 3D view."""
    return next(each for each in view().regions if each.type == kind)


def display(*command: object) -> bytes:
    """Run a program of the display's; what it prints."""
    words = [str(part) for part in command]
    return subprocess.run(words, check=True, timeout=20, stdout=subprocess.PIPE).stdout


def move(x: int, y: int) -> None:
    """Blender counts from the lower left corner, the display from the upper left one.

    In two motions, as the first one into a button only leaves the button before.
    """
    display("xdotool", "mousemove", x - 1, window().height - 1 - y, "sleep", MOTION_SECONDS,
            "mousemove", x, window().height - 1 - y)  # fmt: skip


def key(name: str) -> None:
    """Press and release a key, `ctrl+z` for one."""
    display("xdotool", "key", name)


def write(text: str) -> None:
    """Type it."""
    display("xdotool", "type", text)


def point(x: int, y: int) -> Steps:
    """The mouse there, and Blender knows: its loop has gone round a few times, however slowly."""
    move(x, y)
    for _ in range(NOTICE_LOOPS):
        yield NOTICE_SECONDS


def click(x: int, y: int) -> Steps:
    """The left button, once Blender knows where the mouse is."""
    yield from point(x, y)
    display("xdotool", "click", 1)
    yield 0.2


def wheel(x: int, y: int, notches: int) -> Steps:
    """The wheel, toward the user."""
    yield from point(x, y)
    display("xdotool", "click", "--repeat", notches, "--delay", 60, 5)
    yield 0.5


def middle() -> tuple[int, int]:
    """A place in the 3D view, away from its sidebar."""
    whole = region("WINDOW")
    return whole.x + whole.width // 4, whole.y + whole.height // 2


def into_view() -> Steps:
    """The mouse into the 3D view."""
    move(*middle())
    yield 0.2


def drag(letter: str, begin: tuple[int, int], end: tuple[int, int]) -> Steps:
    """What is selected follows the mouse after the key `letter` (g moves it, r turns it), until a
    click; from and to places counted from the view's middle, in small motions."""
    whole = region("WINDOW")
    middle = whole.x + whole.width // 2, whole.y + whole.height // 2
    ways = zip(middle, begin, end, strict=True)
    (x, across), (y, up) = ((at + first, last - first) for at, first, last in ways)
    yield from point(x, y)
    key(letter)
    yield 0.2
    for share in range(1, DRAG_MOTIONS + 1):
        move(x + across * share // DRAG_MOTIONS, y + up * share // DRAG_MOTIONS)
        yield DRAG_SECONDS
    yield from click(x + across, y + up)


def drag_file(path: str, x: int, y: int) -> Steps:
    """Drag the file here from another program's window, and drop it.

    A hand of its own does it, as Blender does nothing else while something is dragged over it.
    """
    program = ("/usr/bin/python3", "/volillum/tests/file_manager.py", path, *map(str, FILES))
    files = subprocess.Popen(program)
    try:
        display("xdotool", "search", "--sync", "--onlyvisible", "--name", "^Files$")
        left, top = FILES[0] + GRIP, FILES[1] + GRIP
        across, down = x - left, window().height - 1 - y - top
        words = ["xdotool", "mousemove", left, top, "sleep", DRAG_SECONDS, "mousedown", 1]
        for share in range(1, DRAG_MOTIONS + 1):
            place = left + across * share // DRAG_MOTIONS, top + down * share // DRAG_MOTIONS
            words += ["sleep", DRAG_SECONDS, "mousemove", *place]
        words += ["sleep", DRAG_SECONDS, "mouseup", 1]
        dragging = subprocess.Popen(list(map(str, words)))
        yield lambda: dragging.poll() is not None
        yield 0.5
    finally:
        files.kill()
        files.wait()


def select(name: str) -> Steps:
    """Click on the object's line in the outliner."""
    lines = area("OUTLINER").regions[-1]
    for y in range(lines.y + lines.height - ROW, lines.y, -ROW):
        yield from click(lines.x + INDENT, y)
        active = bpy.context.view_layer.objects.active
        if active is not None and active.name == name and active.select_get():
            return
    raise AssertionError(f"the outliner has no line for {name}")
