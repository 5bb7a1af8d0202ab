"""Enabling and disabling the extension, twice, leaves nothing behind."""

import bpy

import volillum_addon
from volillum_addon.blender import classes, command, parameters, properties, transfer

GROUPS = (*parameters.GROUPS.values(), properties.Baked, properties.Result, properties.Settings)
CLASSES = (*GROUPS, transfer.Transfer, *classes.CLASSES)


def entries() -> int:
    """What the File > Import menu has, and where Blender looks for presets."""
    menu = bpy.types.TOPBAR_MT_file_import
    return len(menu._dyn_ui_initialize()) + len(bpy.utils.preset_paths("transfer_functions"))


# Of Blender's own.
BEFORE = entries()


def known() -> tuple[set[str], bool, list[bool], int, int]:
    """What this Blender offers under the extension's names."""
    return (
        set(dir(bpy.ops.volillum)),
        "volillum" in bpy.types.Scene.bl_rna.properties,
        [each.is_registered for each in CLASSES],
        len(command._handles),
        entries() - BEFORE,
    )


def test_registering_twice_leaves_nothing_behind() -> None:
    before = known()
    assert before == (set(), False, [False] * len(CLASSES), 0, 0)
    for _ in range(2):
        volillum_addon.register()
        names = {
            each.bl_idname.split(".")[1]
            for each in classes.CLASSES
            if issubclass(each, bpy.types.Operator)
        }
        assert known() == (names, True, [True] * len(CLASSES), 1, 2)
        assert {"bake", "show", "compare"} <= names
        volillum_addon.unregister()
        assert known() == before
