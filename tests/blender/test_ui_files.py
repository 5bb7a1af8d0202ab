"""A user's data-blocks and files come and go: moved, appended, linked, renamed, duplicated, several
scenes. What was baked is found, what is shown stays right, and nothing else is touched."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import bpy
import pytest
from plumes import write_plume

from volillum_addon.blender import places, scene_presets, showing, stage, staleness, work
from volillum_addon.blender.scene_builder import save_scene
from volillum_addon.core.errors import InputError
from volillum_addon.readers.frames import VolumeFiles

NEW = "The lights have changed: Baked, beside Scattering, relights"


@pytest.fixture(autouse=True)
def project(extension: None, tmp_path: Path) -> Iterator[Path]:
    """A folder with a .blend, its volume beside it and its bakes in `volillum`; one is shown."""
    folder = tmp_path / "project"
    folder.mkdir()
    path = folder / "plume.blend"
    save_scene(VolumeFiles(write_plume(folder / "plume.vdb")), scene_presets.load("default"), path)
    bpy.ops.wm.open_mainfile(filepath=str(path))
    settings = bpy.context.scene.volillum
    settings.model = "multidirectional_occlusion"
    settings.multidirectional_occlusion.directions = 8
    bpy.ops.volillum.bake()
    bpy.ops.volillum.show()
    bpy.ops.wm.save_mainfile()
    yield folder
    bpy.ops.wm.read_factory_settings(use_empty=True)


def source(scene: bpy.types.Scene) -> bpy.types.Object:
    volume = work.chosen_volume(scene)
    assert volume is not None
    return volume


def assert_right(scene: bpy.types.Scene) -> None:
    """The bake is found and fresh, and the volume stands aside for what shows it."""
    scene.view_layers[0].update()
    assert staleness.changes(scene, source(scene)) == ()
    assert staleness.shown_differs(scene, source(scene)) == ""
    shown = scene.volillum.baked.shown
    path = places.block_file(shown.data)
    assert path.is_file()
    assert path.resolve() == places.baked_file(scene).resolve()
    assert shown.data.grids.load()
    assert source(scene).hide_render
    assert not shown.hide_render


def test_a_moved_folder(project: Path, tmp_path: Path) -> None:
    moved = tmp_path / "elsewhere" / "deep"
    moved.parent.mkdir()
    shutil.move(project, moved)
    bpy.ops.wm.open_mainfile(filepath=str(moved / "plume.blend"))
    scene = bpy.context.scene
    assert_right(scene)
    bpy.ops.volillum.bake()
    assert scene.volillum.baked.found
    assert_right(scene)
    bpy.ops.volillum.show()
    assert_right(scene)


def test_saved_in_another_folder(project: Path, tmp_path: Path) -> None:
    (tmp_path / "other").mkdir()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "other" / "copy.blend"))
    assert_right(bpy.context.scene)
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "other" / "copy.blend"))
    assert_right(bpy.context.scene)
    bpy.ops.volillum.show(baked=False)
    bpy.ops.volillum.show()
    assert_right(bpy.context.scene)


def test_saved_for_the_first_time(tmp_path: Path) -> None:
    """What was baked before a file has a name has absolute paths, which stay right."""
    volume = source(bpy.context.scene).data.filepath
    path = Path(bpy.path.abspath(volume))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    placed = bpy.data.objects.new("plume", bpy.data.volumes.new("plume"))
    placed.data.filepath = str(path)
    scene.collection.objects.link(placed)
    sun = bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN"))
    scene.collection.objects.link(sun)
    scene.volillum.directory = str(tmp_path / "out")
    scene.volillum.model = "multidirectional_occlusion"
    scene.volillum.multidirectional_occlusion.directions = 8
    bpy.ops.volillum.bake()
    bpy.ops.volillum.show()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "first.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "first.blend"))
    assert_right(bpy.context.scene)


def brought(file: Path, kind: str, names: list[str], link: bool) -> list[bpy.types.ID]:
    with bpy.data.libraries.load(str(file), link=link, relative=True) as (_, to):
        setattr(to, kind, names)
    found: list[bpy.types.ID] = getattr(to, kind)
    return found


def new_file(path: Path) -> bpy.types.Scene:
    path.parent.mkdir(exist_ok=True)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    return bpy.context.scene


def test_an_appended_scene(project: Path, tmp_path: Path) -> None:
    name = bpy.context.scene.name
    new_file(tmp_path / "target" / "target.blend")
    (scene,) = brought(project / "plume.blend", "scenes", [name], link=False)
    assert isinstance(scene, bpy.types.Scene)
    assert_right(scene)
    with bpy.context.temp_override(scene=scene):
        bpy.ops.volillum.show(baked=False)
        assert not source(scene).hide_render
        bpy.ops.volillum.show()
    assert_right(scene)


@pytest.mark.parametrize("link", [False, True], ids=["appended", "linked"])
def test_a_shown_bake_needs_nothing_of_its_scene(project: Path, tmp_path: Path, link: bool) -> None:
    name = bpy.context.scene.volillum.baked.shown.name
    scene = new_file(tmp_path / "target" / "target.blend")
    (shown,) = brought(project / "plume.blend", "objects", [name], link)
    assert isinstance(shown, bpy.types.Object)
    scene.collection.objects.link(shown)
    data = shown.data
    assert places.block_file(data).parent.resolve() == (project / "volillum").resolve()
    assert data.grids.load()
    assert data.materials[0].node_tree.nodes


def test_a_linked_volume_is_baked_and_stands_aside_after_reopening(
    project: Path, tmp_path: Path
) -> None:
    name = source(bpy.context.scene).name
    bpy.ops.volillum.show(baked=False)
    bpy.ops.wm.save_mainfile()
    target = tmp_path / "target" / "target.blend"
    scene = new_file(target)
    (volume,) = brought(project / "plume.blend", "objects", [name], link=True)
    scene.collection.objects.link(volume)
    scene.collection.objects.link(bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN")))
    scene.volillum.volume = volume
    scene.volillum.model = "multidirectional_occlusion"
    scene.volillum.multidirectional_occlusion.directions = 8
    bpy.ops.volillum.bake()
    bpy.ops.volillum.show()
    assert_right(scene)
    bpy.ops.wm.save_mainfile()
    bpy.ops.wm.open_mainfile(filepath=str(target))
    assert_right(bpy.context.scene)
    bpy.ops.volillum.scatter()
    assert not source(bpy.context.scene).hide_render
    bpy.ops.volillum.scatter()
    assert_right(bpy.context.scene)
    bpy.ops.volillum.show(baked=False)
    assert not source(bpy.context.scene).hide_render


def test_renamed(project: Path) -> None:
    scene = bpy.context.scene
    shown = scene.volillum.baked.shown
    for block in (scene, source(scene), source(scene).data, shown, shown.data,
                  shown.data.materials[0]):  # fmt: skip
        block.name = f"renamed {block.name}"
    assert_right(scene)
    bpy.ops.volillum.bake()
    assert scene.volillum.baked.found
    bpy.ops.volillum.side_by_side()
    scene.volillum.exhibit.name = "my own"
    bpy.ops.volillum.show()
    assert scene.volillum.exhibit is None
    assert "my own" not in bpy.data.collections
    assert_right(scene)


def test_a_scene_renamed_while_work_runs_gets_its_result() -> None:
    from volillum_addon.blender.asked import Asked

    scene = bpy.context.scene
    asked = Asked.of(scene)
    scene.name = "another"
    bpy.data.scenes.new(asked.name)
    assert asked.scene == scene
    bpy.data.scenes.remove(scene)
    with pytest.raises(InputError, match="is gone"):
        _ = asked.scene


def test_a_duplicate_of_what_is_shown_is_the_users_own() -> None:
    scene = bpy.context.scene
    shown = scene.volillum.baked.shown
    copy = shown.copy()
    scene.collection.objects.link(copy)
    name = copy.name
    scene.volillum.spherical_harmonics.directions = 8
    scene.volillum.model = "spherical_harmonics"
    bpy.ops.volillum.bake()
    bpy.ops.volillum.show()
    assert_right(scene)
    bpy.ops.volillum.show(baked=False)
    assert name in scene.objects
    assert copy.data.grids.load()
    assert copy.data.materials[0] is not None


def test_a_duplicated_volume_is_baked_by_itself() -> None:
    """Each with its own material: the chosen one is baked, the other is left as it is."""
    scene = bpy.context.scene
    first = source(scene)
    bpy.ops.volillum.show(baked=False)
    second = first.copy()
    second.data = first.data.copy()
    second.data.materials[0] = first.data.materials[0].copy()
    scene.collection.objects.link(second)
    second.location.x += 10
    scene.volillum.volume = second
    scene.view_layers[0].update()
    assert staleness.changes(scene, second) == ("the volume's place has changed",)
    bpy.ops.volillum.bake()
    bpy.ops.volillum.show()
    assert_right(scene)
    assert not first.hide_render
    assert bpy.data.objects[second.name].hide_render


def test_what_the_user_deletes_is_shown_again() -> None:
    scene = bpy.context.scene
    shown = scene.volillum.baked.shown
    scene.collection.objects.unlink(shown)  # as the key X does
    assert "Baked, beside Scattering" in staleness.shown_differs(scene, source(scene))
    bpy.ops.volillum.show()
    assert scene.volillum.baked.shown.name in scene.objects
    assert_right(scene)
    scene.collection.objects.unlink(scene.volillum.baked.shown)
    bpy.ops.volillum.show(baked=False)
    assert not source(scene).hide_render


def test_a_scene_and_its_full_copy_go_their_own_ways() -> None:
    first = bpy.context.scene
    bpy.ops.scene.new(type="FULL_COPY")
    second = bpy.data.scenes[-1] if bpy.context.scene == first else bpy.context.scene
    assert second != first
    assert_right(second)
    assert second.volillum.baked.shown != first.volillum.baked.shown
    with bpy.context.temp_override(scene=second):
        bpy.ops.volillum.show(baked=False)
    assert not source(second).hide_render
    assert_right(first)


def test_two_scenes_that_share_a_volume(project: Path) -> None:
    """Visibility is the object's, in all its scenes: at the end it is as it was."""
    first = bpy.context.scene
    volume = source(first)
    second = bpy.data.scenes.new("second")
    for each in (volume, *(each for each in first.objects if each.type == "LIGHT")):
        second.collection.objects.link(each)
    assert source(second) == volume  # though the first scene hides it
    second.volillum.model = "multidirectional_occlusion"
    second.volillum.multidirectional_occlusion.directions = 12
    with bpy.context.temp_override(scene=second):
        bpy.ops.volillum.bake()
        bpy.ops.volillum.show()
    assert_right(second)
    assert_right(first)
    assert first.volillum.baked.path != second.volillum.baked.path
    showing.hide(second)
    assert not volume.hide_render
    showing.hide(first)
    assert not volume.hide_render
    assert stage.stepped_aside() == set()


def test_full_scattering_survives_saving(project: Path) -> None:
    scene = bpy.context.scene
    before = scene.cycles.volume_bounces
    bpy.ops.volillum.scatter()
    bounces = scene.cycles.volume_bounces
    assert bounces != before
    bpy.ops.wm.save_mainfile()
    bpy.ops.wm.open_mainfile(filepath=str(project / "plume.blend"))
    scene = bpy.context.scene
    assert scene.volillum.stage.way == "SCATTERING"
    assert scene.cycles.volume_bounces == bounces
    bpy.ops.volillum.scatter()
    assert_right(scene)
    assert scene.cycles.volume_bounces == before


def test_every_way_is_undone_and_redone(project: Path) -> None:
    pressed = ("EXEC_DEFAULT", True)
    bpy.context.scene.volillum.noise, bpy.context.scene.volillum.budget = 50, 1
    bpy.ops.ed.undo_push(message="Start")

    def seen() -> tuple[object, ...]:
        scene = bpy.context.scene
        settings = scene.volillum
        return (
            settings.stage.way,
            scene.cycles.volume_bounces,
            scene.cycles.volume_biased,
            settings.exhibit and sorted(each.name for each in settings.exhibit.objects),
            {each.name: each.hide_render for each in scene.objects if each.type == "VOLUME"},
        )

    steps = [seen()]
    for press in (bpy.ops.volillum.scatter, bpy.ops.volillum.show_error, bpy.ops.volillum.show):
        assert press(*pressed) == {"FINISHED"}
        steps.append(seen())
    assert [step[0] for step in steps] == ["BAKE", "SCATTERING", "ERROR", "BAKE"]
    for step in reversed(steps[:-1]):
        bpy.ops.ed.undo()
        assert seen() == step
    for step in steps[1:]:
        bpy.ops.ed.redo()
        assert seen() == step
