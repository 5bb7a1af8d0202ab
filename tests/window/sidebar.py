"""The sidebar, as a hand finds its way in it."""

from __future__ import annotations

import json
from pathlib import Path

import bpy
from eyes import picture
from hand import click, into_view, key, point, region, view, wheel, window, write
from steps import Steps

CATEGORY = "Volillum"
# A button is 20 pixels high, a row of a list 23; a list's title stands before its first item.
STEP = 12
ROW = 23
FIRST_ITEM = 52
# A menu's first entry below its button, which is so far left of the next one.
FIRST_ENTRY, MENU_LEFT = 25, 100
# From a panel's lowest button to the title of the next one.
TITLE = 28
# Where every button was seen last, kept for the next scenarios: it is mostly still near there.
KEPT = Path("/volillum/places.json")
_places: dict[str, tuple[int, int]] = json.loads(KEPT.read_text()) if KEPT.is_file() else {}


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
    """Run the mouse over the sidebar until what is under it contains `wanted`; its place."""
    sidebar = region("UI")
    rows = range(sidebar.y + sidebar.height - 4, sidebar.y, -STEP)
    seen = [text for text in _places if wanted in text]
    # What was never seen is often close to what was used last.
    near = next(reversed(_places.values()), (sidebar.x + sidebar.width // 2, rows[0]))
    known = _places.pop(seen[0]) if seen else near
    # Wide buttons, the left and the middle one of three, and a small one at the end of a row.
    columns = (
        sidebar.x + 2 * sidebar.width // 3,
        sidebar.x + sidebar.width // 4,
        sidebar.x + 9 * sidebar.width // 20,
        sidebar.x + sidebar.width - 50,
    )
    # From where it was last to both sides.
    nearest = sorted(rows, key=lambda y: abs(y - known[1]))
    for x, y in [known, *((x, y) for y in nearest for x in columns)]:
        yield from point(x, y)
        found = under_mouse()
        if found:
            _places.setdefault(found, (x, y))
        if wanted in found:
            _places[found] = _places.pop(found)  # the last one
            return x, y
    raise AssertionError(f"the sidebar has no button for {wanted}")


def keep_places() -> None:
    """For the next scenario."""
    KEPT.write_text(json.dumps(_places))


def press(wanted: str) -> Steps:
    """Find the button and click on it."""
    x, y = yield from find(wanted)
    yield from click(x, y)


def choose(wanted: str, index: int) -> Steps:
    """Open a list that drops down and click on its item `index`."""
    x, y = yield from top_of(wanted)
    yield from click(x, y - ROW // 2)
    yield 0.5
    yield from click(x, y - ROW // 2 - FIRST_ITEM - ROW * index)
    yield 0.5


def choose_left_of(wanted: str, index: int, seen: str) -> Steps:
    """The same for a menu, which has no title, in the row of the button; its picture is kept."""
    x, y = yield from top_of(wanted)
    x -= MENU_LEFT
    yield from click(x, y - ROW // 2)
    yield 0.5
    picture(seen, "view")
    yield from click(x, y - ROW // 2 - FIRST_ENTRY - ROW * index)
    yield 0.5


def top_of(wanted: str) -> Steps:
    """The upper edge of a button, from which places below it are counted."""
    x, y = yield from find(wanted)
    while wanted in under_mouse():
        y += 2
        yield from point(x, y)
    return x, y


def open_next_panel(last: str) -> Steps:
    """Click on the title below `last`, the lowest button of a panel."""
    yield from scroll(6)  # the title may lie below the window's end
    x, y = yield from find(last)
    while last in under_mouse():
        y -= 2
        yield from point(x, y)
    yield from click(x, y - TITLE)
    yield 0.5


def scroll(notches: int) -> Steps:
    """Down the sidebar, with the wheel."""
    sidebar = region("UI")
    yield from wheel(sidebar.x + sidebar.width // 2, sidebar.y + sidebar.height // 2, notches)


def type_into(wanted: str, text: str) -> Steps:
    """Enter with the mouse over a number or text, and write."""
    yield from find(wanted)
    key("Return")
    yield 0.2
    key("ctrl+a")
    write(text)
    yield 0.1
    key("Return")
    yield 0.3
