"""Opening data: drop, cancelling, transfer functions, a raw file's dialog, the file browser."""

from pathlib import Path

import bpy
from eyes import difference, look, picture
from hand import drag_file, into_view, key, middle
from sidebar import choose_left_of, open_sidebar, press
from steps import Steps
from user import (
    OTHER,
    cancel,
    in_view,
    lit_view,
    package,
    running,
    scan,
    scene,
    settings,
    simple_view,
    volumes,
)

# The button right of the preset menu.
MENU = "volillum.save_transfer("


def empty_scene(directory: str) -> None:
    """Blender's first scene without its cube; what is opened goes to a folder of the scenario's."""
    bpy.data.batch_remove([each for each in bpy.data.objects if each.type == "MESH"])
    settings().directory = f"/volillum/{directory}"
    simple_view()


def drop(name: str) -> Steps:
    """Drop a file on the 3D view."""
    yield from drag_file(f"/volillum/{name}", *middle())


def preset_names() -> list[str]:
    """The extension's transfer functions."""
    folder = Path(package("resources").PRESETS) / "transfer_functions"
    return sorted(path.stem for path in folder.glob("*.json"))


def importing() -> Steps:
    """Drop a file on the view, watch it come, take a preset, apply it, undo; then a raw file's
    dialog, and the menu's file browser."""
    empty_scene("imported")
    yield from drop("ball.npy")
    yield lambda: running() is None and "ball" in volumes()
    yield from open_sidebar()
    yield 1.0
    picture("panel_transfer")
    before = bpy.data.objects["ball"].data.filepath
    yield from choose_preset("ct_skin", "import_presets")
    picture("panel_transfer_not_applied")
    yield from press("volillum.apply_transfer(")
    yield lambda: running() is None
    yield 0.5
    assert bpy.data.objects["ball"].data.filepath != before
    picture("panel_transfer_applied")
    yield from into_view()
    key("ctrl+z")
    yield lambda: bpy.data.objects["ball"].data.filepath == before
    with in_view():
        bpy.ops.volillum.import_volume("INVOKE_DEFAULT", filepath="/volillum/plain.raw")
    yield 1.0
    picture("import_raw")
    key("Escape")
    yield 0.5
    with in_view():
        bpy.ops.volillum.import_volume("INVOKE_DEFAULT")
    yield 1.5
    picture("import_browser")
    key("Escape")
    yield 0.5
    assert list(volumes()) == ["ball"]


def cancelling() -> Steps:
    """Esc while a file is read: nothing is left behind, and the next file comes."""
    empty_scene("cancelled")
    before = blocks()
    yield from open_sidebar()
    yield from drop("large.npy")
    yield from cancel("import_progress")
    yield 0.5
    picture("import_cancelled")
    assert volumes() == {}
    assert blocks() == before
    assert list(Path("/volillum/cancelled").rglob("*")) == []
    yield from drop("ball.npy")
    yield lambda: running() is None and "ball" in volumes()


def blocks() -> set[str]:
    """All data of the file."""
    return {repr(each) for each in bpy.data.user_map()}


def choosing() -> Steps:
    """A scan as it is opened, and with another preset from the panel's menu, as EEVEE draws it."""
    empty_scene("choosing")
    file = scan()
    name = file.split(".")[0]
    yield from drop(file)
    yield lambda: running() is None and name in volumes()
    yield from open_sidebar()
    with in_view():
        bpy.ops.view3d.view_selected()
    scene().eevee.volumetric_tile_size = "2"
    first = yield from lit_view()
    picture("preset_first", "view")
    before = bpy.data.objects[name].data.filepath
    yield from choose_preset("ct_skin", "preset_menu")
    yield from press("volillum.apply_transfer(")
    yield lambda: running() is None
    assert bpy.data.objects[name].data.filepath != before
    second = yield from look()
    picture("preset_skin", "view")
    assert difference(first, second) > OTHER


def choose_preset(name: str, seen: str) -> Steps:
    """From the panel's menu, with the mouse; `seen` is the picture of it."""
    yield from choose_left_of(MENU, preset_names().index(name), seen)
    shown = package("blender.transfer_operators").VOLILLUM_MT_transfer_presets.bl_label
    assert shown.lower() == name.replace("_", " "), shown
