"""The operators from a script: bake, show, compare; what they refuse; what makes a bake stale."""

import math
from pathlib import Path

import bpy
import pytest

from volillum_addon.bake.vdb import read_metadata
from volillum_addon.blender import staleness, work
from volillum_addon.blender.properties import model_values
from volillum_addon.models.registry import MODELS

# The most directions a test needs; the models' accuracy is tested elsewhere.
FEW = 8


@pytest.fixture(autouse=True)
def quick(scene: bpy.types.Scene) -> None:
    for model in MODELS:
        group = getattr(scene.volillum, model)
        if "directions" in group.bl_rna.properties:
            group.directions = FEW
    scene.volillum.model = "multidirectional_occlusion"


def volume(scene: bpy.types.Scene) -> bpy.types.Object:
    return next(each for each in scene.objects if each.name.startswith("plume"))


def sun(scene: bpy.types.Scene) -> bpy.types.Object:
    return next(each for each in scene.objects if each.type == "LIGHT")


def refusal(operator: object, **arguments: object) -> str:
    """The one line with which an operator refuses."""
    with pytest.raises(RuntimeError) as caught:
        operator(**arguments)
    (line,) = str(caught.value).strip().splitlines()
    return line


def changes(scene: bpy.types.Scene) -> tuple[str, ...]:
    scene.view_layers[0].update()
    return staleness.changes(scene, work.chosen_volume(scene))


@pytest.mark.parametrize("model", MODELS)
def test_bake_writes_the_file_and_says_so(scene: bpy.types.Scene, model: str) -> None:
    scene.volillum.model = model
    assert bpy.ops.volillum.bake() == {"FINISHED"}
    baked = scene.volillum.baked
    metadata = read_metadata(baked.path)
    assert metadata["model"] == baked.model == model
    settings = model_values(scene.volillum, model)
    assert {name: str(value) for name, value in metadata["parameters"].items()} == {
        name: str(value) for name, value in settings.items()
    }
    assert settings.get("directions", FEW) == FEW
    assert not baked.found
    assert baked.seconds > 0
    assert changes(scene) == ()
    assert bpy.ops.volillum.bake() == {"FINISHED"}
    assert baked.found
    assert [path.name for path in Path(scene.volillum.directory).iterdir()] == [
        Path(baked.path).name
    ]


def test_what_was_left_out_is_kept(scene: bpy.types.Scene) -> None:
    bpy.ops.volillum.bake()
    assert "leaves out lights of the kinds: environment" in scene.volillum.baked.notes


def test_show_swaps_the_volume_for_its_bake_and_back(scene: bpy.types.Scene) -> None:
    source = volume(scene)
    bpy.ops.volillum.bake()
    for _ in range(2):  # again: the old one goes
        assert bpy.ops.volillum.show() == {"FINISHED"}
        shown = scene.volillum.baked.shown
        assert [each for each in scene.objects if each.type == "VOLUME" and each != source] == [
            shown
        ]
        assert Path(bpy.path.abspath(shown.data.filepath)) == Path(scene.volillum.baked.path)
        assert source.hide_render
        assert source.hide_viewport
    # The hidden volume is still the one to bake, and the shown one is no second volume.
    assert work.chosen_volume(scene) == source
    bpy.ops.volillum.bake()
    assert scene.volillum.baked.found
    assert changes(scene) == ()
    materials = len(bpy.data.materials)
    assert bpy.ops.volillum.show(baked=False) == {"FINISHED"}
    assert not source.hide_render
    assert scene.volillum.baked.shown is None
    assert len(bpy.data.materials) == materials - 1
    assert [each for each in scene.objects if each.type == "VOLUME"] == [source]


def test_show_as_one_grid(scene: bpy.types.Scene) -> None:
    scene.volillum.as_radiance = True
    bpy.ops.volillum.bake()
    for _ in range(2):  # under other lights it is another file
        bpy.ops.volillum.show()
        baked = scene.volillum.baked
        shown = Path(bpy.path.abspath(baked.shown.data.filepath))
        assert shown.match(f"{Path(baked.path).stem}.radiance.*.vdb")
        assert staleness.shown_differs(scene, work.chosen_volume(scene)) == ""
        sun(scene).data.energy *= 2
        said = staleness.shown_differs(scene, work.chosen_volume(scene))
        assert said == "The lights have changed: Baked, beside Scattering, relights"
    assert len(list(Path(scene.volillum.directory).glob("*.radiance.*.vdb"))) == 2


def test_show_before_bake_is_refused(scene: bpy.types.Scene) -> None:
    assert "expected Bake before Show" in refusal(bpy.ops.volillum.show)
    assert scene.volillum.baked.shown is None


def test_a_scene_without_a_volume_is_refused(scene: bpy.types.Scene) -> None:
    bpy.data.objects.remove(volume(scene))
    assert "expected one volume" in refusal(bpy.ops.volillum.bake)


def test_two_volumes_need_a_choice(scene: bpy.types.Scene) -> None:
    first = volume(scene)
    scene.collection.objects.link(first.copy())
    assert "expected one volume" in refusal(bpy.ops.volillum.bake)
    scene.volillum.volume = first
    assert bpy.ops.volillum.bake() == {"FINISHED"}


def test_a_missing_grid_is_refused(scene: bpy.types.Scene) -> None:
    volume(scene).data.materials.clear()
    scene.volillum.density_grid = "heat"
    line = refusal(bpy.ops.volillum.bake)
    assert "'heat'" in line
    assert "density" in line


def test_a_missing_file_is_refused(scene: bpy.types.Scene) -> None:
    volume(scene).data.filepath = str(Path(scene.volillum.directory) / "nowhere.vdb")
    assert "nowhere.vdb" in refusal(bpy.ops.volillum.bake)
    assert not Path(scene.volillum.directory).exists()


def test_no_light_is_refused(scene: bpy.types.Scene) -> None:
    bpy.data.objects.remove(sun(scene))
    scene.world = None
    assert "expected a light" in refusal(bpy.ops.volillum.bake)
    assert not Path(scene.volillum.directory).exists()


def test_no_camera_is_refused_where_one_is_needed(scene: bpy.types.Scene) -> None:
    scene.camera = None
    assert bpy.ops.volillum.bake() == {"FINISHED"}
    scene.volillum.model = "directional_occlusion"
    assert "camera" in refusal(bpy.ops.volillum.bake)
    assert "camera" in refusal(bpy.ops.volillum.compare)


def test_a_directory_that_cannot_be_written_is_refused(
    scene: bpy.types.Scene, tmp_path: Path
) -> None:
    (tmp_path / "file").write_text("not a directory")
    scene.volillum.directory = str(tmp_path / "file" / "out")
    assert str(tmp_path / "file") in refusal(bpy.ops.volillum.bake)
    scene.volillum.directory = ""
    assert "expected a directory" in refusal(bpy.ops.volillum.bake)
    scene.volillum.directory = "//volillum"
    assert "not saved" in refusal(bpy.ops.volillum.bake)


def test_cancel_is_only_offered_while_something_runs(scene: bpy.types.Scene) -> None:
    assert scene.volillum
    assert not bpy.ops.volillum.cancel.poll()


def test_a_turned_sun_makes_only_what_depends_on_it_stale(scene: bpy.types.Scene) -> None:
    bpy.ops.volillum.bake()
    sun(scene).data.energy *= 2  # relighting is free
    assert changes(scene) == ()
    sun(scene).rotation_euler[0] += 0.1
    assert changes(scene) == ("the light direction has changed",)
    scene.volillum.model = "spherical_harmonics"
    bpy.ops.volillum.bake()
    sun(scene).rotation_euler[0] += 0.1
    assert changes(scene) == ()


def test_a_moved_camera_makes_only_what_depends_on_it_stale(scene: bpy.types.Scene) -> None:
    bpy.ops.volillum.bake()
    scene.camera.location[2] += 1
    assert changes(scene) == ()
    scene.volillum.model = "directional_occlusion"
    bpy.ops.volillum.bake()
    scene.camera.data.lens *= 1.1  # the eye stays where it is
    assert changes(scene) == ()
    scene.camera.location[2] += 1
    assert changes(scene) == ("the camera has changed",)


def test_parameters_that_changed_are_named(scene: bpy.types.Scene) -> None:
    bpy.ops.volillum.bake()
    scene.volillum.multidirectional_occlusion.theta = math.radians(45)
    (change,) = changes(scene)
    assert change.startswith("theta was ")
    assert change.endswith("is 0.785398")


def test_a_changed_volume_is_named(scene: bpy.types.Scene) -> None:
    bpy.ops.volillum.bake()
    placed = volume(scene)
    placed.location[0] += 1
    assert changes(scene) == ("the volume's place has changed",)
    placed.location[0] -= 1
    assert changes(scene) == ()
    shader = next(n for n in placed.data.materials[0].node_tree.nodes if "Density" in n.inputs)
    shader.inputs["Density"].default_value *= 2
    assert changes(scene) == ("the volume's material has changed",)
    shader.inputs["Density"].default_value /= 2
    path = Path(placed.data.filepath)
    path.write_bytes(path.read_bytes() + b"\0")
    assert changes(scene) == ("the volume's file or grid has changed",)


def test_a_deleted_bake_is_noticed(scene: bpy.types.Scene) -> None:
    bpy.ops.volillum.bake()
    Path(scene.volillum.baked.path).unlink()
    staleness._metadata.cache_clear()
    assert changes(scene) == ("the baked file is gone",)
