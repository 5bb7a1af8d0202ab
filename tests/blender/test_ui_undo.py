"""Undo, and a file that is saved and opened again: what is shown and what the panel says of it."""

from pathlib import Path

import bpy
import numpy as np
import pytest
from plumes import write_plume

from volillum_addon.blender import scene_presets, staleness, transfer, work
from volillum_addon.blender.scene_builder import save_scene
from volillum_addon.readers.frames import VolumeFiles

# A script's call leaves no step to undo unless it asks for one, as a button's does.
PRESSED = ("EXEC_DEFAULT", True)
RELIGHT = "The lights have changed: Baked, beside Scattering, relights"
OLDER = "An older bake is shown: Baked, beside Scattering, shows the new one"


@pytest.fixture(autouse=True)
def file(extension: None, tmp_path: Path) -> Path:
    """An open .blend, its settings made; undo replaces all data, so nothing of it is kept."""
    path = tmp_path / "plume.blend"
    save_scene(
        VolumeFiles(write_plume(tmp_path / "plume.vdb")), scene_presets.load("default"), path
    )
    bpy.ops.wm.open_mainfile(filepath=str(path))
    settings().multidirectional_occlusion.directions = settings().spherical_harmonics.directions = 8
    set_model("multidirectional_occlusion")
    return path


def settings() -> bpy.types.PropertyGroup:
    return bpy.context.scene.volillum


def set_model(model: str) -> None:
    settings().model = model
    bpy.ops.ed.undo_push(message="Model")


def seen() -> tuple[object, ...]:
    """All that a user sees of a bake: its file, the one shown, the volumes in the scene with
    whether they are visible, the materials, and what the panel says."""
    bpy.context.view_layer.update()
    scene = bpy.context.scene
    baked = settings().baked
    volume = work.chosen_volume(scene)
    assert volume is not None
    assert volume.name == "plume"
    return (
        baked.path,
        baked.model,
        baked.shown and (baked.shown.name, baked.shown.data.filepath),
        {each.name: not each.hide_render for each in scene.objects if each.type == "VOLUME"},
        sorted(material.name for material in bpy.data.materials),
        staleness.changes(scene, volume),
        staleness.shown_differs(scene, volume),
    )


def volumes_seen() -> list[bool]:
    """Of every volume in the scene whether it is visible, the shown bake's last."""
    return list(seen()[3].values())  # type: ignore[attr-defined]


def test_every_step_is_undone_and_redone_as_it_was() -> None:
    steps = [seen()]

    def press(operator: object, **arguments: object) -> None:
        assert operator(*PRESSED, **arguments) == {"FINISHED"}  # type: ignore[operator]
        steps.append(seen())

    press(bpy.ops.volillum.bake)
    press(bpy.ops.volillum.show)
    assert volumes_seen() == [False, True]
    press(bpy.ops.volillum.show)  # again: another object takes the first one's place
    assert volumes_seen() == [False, True]
    press(bpy.ops.volillum.show, baked=False)
    assert volumes_seen() == [True]
    set_model("spherical_harmonics")
    steps.append(seen())
    press(bpy.ops.volillum.bake)
    press(bpy.ops.volillum.show)
    next(each for each in bpy.context.scene.objects if each.type == "LIGHT").data.energy *= 0.5
    bpy.ops.ed.undo_push(message="Light")
    steps.append(seen())
    assert steps[-1][-1] == RELIGHT
    press(bpy.ops.volillum.show)
    assert steps[-1][-1] == ""

    for step in reversed(steps[:-1]):
        bpy.ops.ed.undo()
        assert seen() == step
    for step in steps[1:]:
        bpy.ops.ed.redo()
        assert seen() == step


def test_a_new_bake_beside_an_older_one_that_is_shown() -> None:
    bpy.ops.volillum.bake(*PRESSED)
    bpy.ops.volillum.show(*PRESSED)
    first = settings().baked.path
    set_model("spherical_harmonics")
    bpy.ops.volillum.bake(*PRESSED)
    before = seen()
    assert before[-1] == OLDER
    bpy.ops.volillum.show(*PRESSED)
    assert volumes_seen() == [False, True]
    bpy.ops.ed.undo()
    assert seen() == before
    assert settings().baked.shown.data.filepath == first != settings().baked.path


def test_show_means_the_bake_whatever_was_pressed_before() -> None:
    bpy.ops.volillum.bake(*PRESSED)
    bpy.ops.volillum.show(*PRESSED, baked=False)
    bpy.ops.volillum.show(*PRESSED)
    assert volumes_seen() == [False, True]


def test_saved_and_opened_again(file: Path) -> None:
    bpy.ops.volillum.bake(*PRESSED)
    bpy.ops.volillum.show(*PRESSED)
    before = seen()
    assert before[-2:] == ((), "")
    bpy.ops.wm.save_mainfile()
    bpy.ops.wm.open_mainfile(filepath=str(file))
    assert settings().baked.path == before[0]
    assert Path(bpy.path.abspath(settings().baked.path)).is_file()
    assert settings().directory == "//volillum"
    assert seen()[1] == "multidirectional_occlusion"
    assert seen()[3:] == before[3:]
    next(each for each in bpy.context.scene.objects if each.type == "LIGHT").data.energy *= 0.5
    assert seen()[-1] == RELIGHT
    bpy.ops.volillum.show(*PRESSED)
    assert seen()[-1] == ""
    bpy.ops.volillum.show(*PRESSED, baked=False)
    assert volumes_seen() == [True]


def test_an_import_and_its_transfer_function_are_undone_and_redone(tmp_path: Path) -> None:
    """Values of a gradient; undo replaces all data, so everything is asked for anew."""
    np.save(tmp_path / "ramp.npy", np.arange(6 * 7 * 8, dtype=np.uint8).reshape(6, 7, 8))
    settings().directory = str(tmp_path / "out")
    bpy.ops.ed.undo_push(message="Directory")

    def state() -> tuple[object, ...]:
        item = settings().volume
        if item is None:
            return (len(bpy.data.volumes),)
        material = item.active_material
        return item.name, item.data.filepath, transfer.read(material).as_json()["points"][-1]

    steps = [state()]
    assert bpy.ops.volillum.import_volume(*PRESSED, filepath=str(tmp_path / "ramp.npy")) == {
        "FINISHED"
    }
    steps.append(state())
    assert steps[-1][0] == "ramp"
    node = transfer.ramp_node(settings().volume.active_material)
    node.color_ramp.elements[-1].color = (0.25, 0.5, 0.75, 0.5)
    bpy.ops.ed.undo_push(message="Ramp")
    steps.append(state())
    assert bpy.ops.volillum.apply_transfer(*PRESSED) == {"FINISHED"}
    steps.append(state())
    assert len(set(map(str, steps))) == len(steps)
    for wanted in reversed(steps[:-1]):
        bpy.ops.ed.undo()
        assert state() == wanted
    for wanted in steps[1:]:
        bpy.ops.ed.redo()
        assert state() == wanted
