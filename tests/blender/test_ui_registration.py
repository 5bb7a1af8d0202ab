"""Enabling and disabling the extension, twice, leaves nothing behind."""

import bpy

import volillum_addon
from volillum_addon.blender import command, operators, panels, parameters, properties

GROUPS = (*parameters.GROUPS.values(), properties.Baked, properties.Result, properties.Settings)
CLASSES = (*GROUPS, *operators.CLASSES, *panels.CLASSES)


def known() -> tuple[set[str], bool, list[bool], int]:
    """What this Blender offers under the extension's names."""
    return (
        set(dir(bpy.ops.volillum)),
        "volillum" in bpy.types.Scene.bl_rna.properties,
        [each.is_registered for each in CLASSES],
        len(command._handles),
    )


def test_registering_twice_leaves_nothing_behind() -> None:
    before = known()
    assert before == (set(), False, [False] * len(CLASSES), 0)
    for _ in range(2):
        volillum_addon.register()
        names = {each.bl_idname.split(".")[1] for each in operators.CLASSES}
        assert known() == (names, True, [True] * len(CLASSES), 1)
        assert {"bake", "show", "compare"} <= names
        volillum_addon.unregister()
        assert known() == before
