"""The transfer function in Blender: the ramp is the function, presets come and go as files, Apply
makes the medium, the panel shows the histogram."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace

import bpy
import numpy as np
import pytest
from recording_layout import RecordingLayout

from volillum_addon.blender import histogram, transfer, transfer_operators, transfer_panel
from volillum_addon.blender.scene_reader import read_scene
from volillum_addon.core.errors import InputError
from volillum_addon.core.transfer_function import TransferFunction
from volillum_addon.readers import transfer_presets
from volillum_addon.readers.imported import About, read_imported
from volillum_addon.readers.medium_file import medium_of

SHAPE = (12, 10, 8)


@pytest.fixture
def scene(extension: None, tmp_path: Path) -> Iterator[bpy.types.Scene]:
    """A scene with an imported volume of small numbers without a unit."""
    values = np.random.default_rng(2).gamma(2.0, 20.0, SHAPE).astype(np.uint8)
    np.save(tmp_path / "brain.npy", values)
    (tmp_path / "brain.json").write_text('{"kind": "mr"}')
    made = bpy.data.scenes.new("transfer")
    made.world = bpy.data.worlds.new("transfer")
    made.volillum.directory = str(tmp_path / "out")
    with bpy.context.temp_override(scene=made, view_layer=made.view_layers[0]):
        bpy.ops.volillum.import_volume(filepath=str(tmp_path / "brain.npy"))
        yield made
    bpy.data.worlds.remove(made.world)
    bpy.data.scenes.remove(made)


def material(scene: bpy.types.Scene) -> bpy.types.Material:
    found = transfer.material_of(scene)
    assert found is not None
    return found


def draw(scene: bpy.types.Scene) -> RecordingLayout:
    layout = RecordingLayout()
    transfer_panel.VOLILLUM_PT_transfer.draw(
        SimpleNamespace(layout=layout), SimpleNamespace(scene=scene)
    )
    return layout


@pytest.mark.parametrize("name", transfer_presets.names())
def test_a_ramp_is_its_function(scene: bpy.types.Scene, name: str) -> None:
    wanted = transfer_presets.load(name, transfer.about(material(scene)))
    transfer.write(material(scene), wanted)
    found = transfer.read(material(scene))
    span = np.ptp(np.asarray(wanted.values))
    # A ramp's places and colours are float32.
    np.testing.assert_allclose(found.values, wanted.values, atol=1e-6 * span)
    np.testing.assert_allclose(found.density, wanted.density, atol=1e-6)
    np.testing.assert_allclose(found.albedo, wanted.albedo, atol=1e-6)
    assert found.per_voxel == pytest.approx(wanted.per_voxel)
    assert found.physical == wanted.physical


def test_the_ramp_is_evaluated_as_blender_draws_it(scene: bpy.types.Scene) -> None:
    ramp = transfer.ramp_node(material(scene)).color_ramp
    function = transfer.read(material(scene))
    low, high = material(scene).volillum.low, material(scene).volillum.high
    for place in np.linspace(0, 1, 21):
        value = np.float32([low + (high - low) * place])
        colour = ramp.evaluate(float(place))
        # Float32 places between stops that may be a hundredth apart.
        assert function.densities(value)[0] == pytest.approx(colour[3], abs=1e-4)
        np.testing.assert_allclose(function.albedos(value)[0], colour[:3], atol=1e-4)


def test_stops_at_one_place_are_a_step(scene: bpy.types.Scene) -> None:
    ramp = transfer.ramp_node(material(scene)).color_ramp
    while len(ramp.elements) > 1:
        ramp.elements.remove(ramp.elements[-1])
    for alpha in (0.0, 1.0):
        ramp.elements.new(0.5).color = (1, 1, 1, alpha)
    function = transfer.read(material(scene))
    assert np.all(np.diff(np.asarray(function.values)) > 0)


def test_apply_makes_the_medium_and_says_what_is_stale(scene: bpy.types.Scene) -> None:
    volume, before = scene.volillum.volume, scene.volillum.volume.data.filepath
    assert "Not applied yet" not in " ".join(draw(scene).labels())
    ramp = transfer.ramp_node(material(scene)).color_ramp
    ramp.elements[-1].color = (0.2, 0.4, 0.6, 0.5)
    material(scene).volillum.per_voxel = 2.5
    assert "Not applied yet" in " ".join(draw(scene).labels())
    assert bpy.ops.volillum.apply_transfer() == {"FINISHED"}
    assert volume.data.filepath != before
    assert "Not applied yet" not in " ".join(draw(scene).labels())
    grid, about = read_imported(transfer.source_of(material(scene)))
    wanted = medium_of(grid, about, transfer.read(material(scene))).trimmed(0)
    found = read_scene(scene, volume).scene.medium.trimmed(0)
    # The object is fitted into the scene; what remains is the optical depth of a voxel.
    depth = found.sigma_t.values.max() * found.sigma_t.voxel_size[0]
    assert depth == pytest.approx(wanted.sigma_t.values.max() * 1.0, rel=1e-5)
    share = found.sigma_s.values.sum(axis=(0, 1, 2)) / wanted.sigma_s.values.sum(axis=(0, 1, 2))
    np.testing.assert_allclose(share, share[0], rtol=1e-4)


def test_a_function_that_leaves_nothing_is_refused(scene: bpy.types.Scene) -> None:
    before = scene.volillum.volume.data.filepath
    for stop in transfer.ramp_node(material(scene)).color_ramp.elements:
        stop.color[3] = 0
    with pytest.raises(RuntimeError, match=r"makes all of brain\.npy clear"):
        bpy.ops.volillum.apply_transfer()
    assert scene.volillum.volume.data.filepath == before
    material(scene).volillum.high = material(scene).volillum.low
    with pytest.raises(RuntimeError, match="expected To above From"):
        bpy.ops.volillum.apply_transfer()
    draw(scene)


def test_a_missing_file_of_values_is_named(scene: bpy.types.Scene) -> None:
    material(scene).volillum.source = "/nowhere/brain.vdb"
    with pytest.raises(RuntimeError, match=r"brain\.vdb; expected the imported file"):
        bpy.ops.volillum.apply_transfer()
    assert "nowhere" in " ".join(draw(scene).labels())


def test_values_that_moved_with_their_volume_are_found(
    scene: bpy.types.Scene, tmp_path: Path
) -> None:
    (tmp_path / "out").rename(tmp_path / "moved")
    data = scene.volillum.volume.data
    data.filepath = str(tmp_path / "moved" / Path(bpy.path.abspath(data.filepath)).name)
    assert transfer.source_of(material(scene)).parent == tmp_path / "moved"
    assert transfer.about(material(scene)).kind == "mr"


def test_a_volume_without_one_has_no_panel(extension: None) -> None:
    bare = bpy.data.scenes.new("bare")
    try:
        context = SimpleNamespace(scene=bare)
        assert not transfer_panel.VOLILLUM_PT_transfer.poll(context)
        assert not transfer_operators.VOLILLUM_OT_save_transfer.poll(context)
    finally:
        bpy.data.scenes.remove(bare)


def test_the_panel_shows_the_ramp_and_the_histogram(scene: bpy.types.Scene) -> None:
    assert transfer_panel.VOLILLUM_PT_transfer.poll(SimpleNamespace(scene=scene))
    layout = draw(scene)
    drawn = [name for name, _ in layout.log]
    assert {"template_icon", "template_color_ramp", "menu"} <= set(drawn)
    assert {"low", "high", "per_voxel", "logarithmic"} <= set(layout.properties())
    assert "default_value" in layout.properties()  # the phase function's g
    assert "volillum.apply_transfer" in layout.operators()


def test_the_shipped_presets_are_in_blenders_menu(scene: bpy.types.Scene) -> None:
    kind = transfer_operators.VOLILLUM_MT_transfer_presets
    found = {
        Path(folder) / name
        for folder in bpy.utils.preset_paths(kind.preset_subdir)
        for name in (each.name for each in Path(folder).iterdir())
    }
    assert {path.stem for path in found} >= set(transfer_presets.names())
    skin = next(path for path in found if path.stem == "ct_skin")
    assert bpy.ops.volillum.load_transfer(filepath=str(skin)) == {"FINISHED"}
    assert transfer.read(material(scene)).per_voxel == pytest.approx(1.2)
    assert kind.bl_label == "CT skin"


def test_the_presets_are_called_as_people_write(monkeypatch: pytest.MonkeyPatch) -> None:
    kind = transfer_operators.VOLILLUM_MT_transfer_presets
    names: dict[str, str] = {}

    def path_menu(folders: list[str], operator: str, **given: Callable[[str], str]) -> None:
        assert operator == "volillum.load_transfer"
        for path in (path for folder in folders for path in Path(folder).iterdir()):
            if given["filter_ext"](path.suffix):
                names[path.stem] = given["display_name"](str(path))

    kind.draw(
        SimpleNamespace(
            path_menu=path_menu,
            preset_subdir=kind.preset_subdir,
            preset_operator=kind.preset_operator,
            preset_extensions=kind.preset_extensions,
        ),
        bpy.context,
    )
    assert set(names) >= set(transfer_presets.names())
    assert (names["ct_bone"], names["mri"], names["smoke"]) == ("CT bone", "MRI", "Smoke")
    assert transfer_operators.preset_name("My_brain.py") == "My brain"


def test_a_preset_is_saved_shared_and_loaded(
    scene: bpy.types.Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        bpy.utils, "user_resource", lambda _kind, path="", create=False: _made(tmp_path / path)
    )
    bpy.context.scene.volillum.volume = scene.volillum.volume
    settings = material(scene).volillum
    settings.per_voxel = 3.25
    transfer.ramp_node(material(scene)).color_ramp.elements[0].color = (0.1, 0.2, 0.3, 0.0)
    before = transfer.read(material(scene)).as_json()
    window_scene = bpy.context.scene
    assert window_scene == scene
    assert bpy.ops.volillum.save_transfer(name="My brain") == {"FINISHED"}
    (file,) = (tmp_path / "presets" / "transfer_functions").iterdir()
    assert file.name == "My_brain.py"
    # Relative to the data, because the values have no unit: it serves another scan as well.
    entry = transfer_operators.saved(file)
    assert entry["relative"] is True
    settings.per_voxel = 1.0
    assert bpy.ops.volillum.load_transfer(filepath=str(file)) == {"FINISHED"}
    after = transfer.read(material(scene)).as_json()
    np.testing.assert_allclose(after["points"], before["points"], rtol=1e-4, atol=1e-5)
    assert after["per_voxel"] == before["per_voxel"]
    # Blender's own way of loading it does the same.
    settings.per_voxel = 1.0
    bpy.ops.script.execute_preset(filepath=str(file), menu_idname="VOLILLUM_MT_transfer_presets")
    assert settings.per_voxel == 3.25


def _made(folder: Path) -> str:
    folder.mkdir(parents=True, exist_ok=True)
    return str(folder)


def test_a_strange_preset_is_refused_and_not_run(scene: bpy.types.Scene, tmp_path: Path) -> None:
    path = tmp_path / "evil.py"
    path.write_text(f"import pathlib\npathlib.Path({str(tmp_path / 'ran')!r}).touch()\n")
    with pytest.raises(RuntimeError, match="holds no transfer function"):
        bpy.ops.volillum.load_transfer(filepath=str(path))
    assert not (tmp_path / "ran").exists()
    path.write_text('material.volillum.text = \'{"points": 1, "per_voxel": 1}\'\n')
    with pytest.raises(RuntimeError, match="points"):
        bpy.ops.volillum.load_transfer(filepath=str(path))


def known(counts: list[int], low: float = 0.0, high: float = 4.0) -> About:
    return About("x", "x", (1, 1, 1), "u1", low, high, histogram=tuple(counts))


def test_the_histograms_bars_count_voxels() -> None:
    # Four intervals of 1, seen through edges that cut them: counts go by overlap.
    edges = np.array([-1.0, 0.5, 1.0, 3.0, 9.0])
    np.testing.assert_allclose(known([10, 20, 30, 40]).voxels_between(edges), [5, 5, 50, 40])
    flat = known([7, 0], 2.0, 2.0).voxels_between(np.array([0.0, 1.0, 3.0]))
    np.testing.assert_allclose(flat, [0, 7])


@pytest.mark.parametrize("logarithmic", [False, True])
def test_the_picture_has_bars_in_the_ramps_colours_and_its_line(logarithmic: bool) -> None:
    function = TransferFunction(
        values=[0, 2, 4], density=[0, 0, 1], albedo=[[1, 0, 0], [1, 0, 0], [0, 0, 1]], per_voxel=1
    )
    image = histogram.picture(known([1000, 10, 100, 0]), function, 0.0, 4.0, logarithmic)
    assert image.shape == (histogram.HEIGHT, histogram.WIDTH, 4)
    white = np.all(image[..., :3] == 1.0, axis=-1)
    bars = (image[..., 3] == 1) & ~white
    heights = bars.sum(axis=0)
    quarter = histogram.WIDTH // 4
    middle = [float(np.median(heights[n * quarter + 8 : (n + 1) * quarter - 8])) for n in range(4)]
    wanted = [1000, 10, 100, 0] if not logarithmic else np.log1p(np.array([1000, 10, 100, 0]) / 64)
    wanted = np.asarray(wanted) / np.max(wanted) * histogram.HEIGHT
    # Whole rows, and the line of some rows lies over them.
    np.testing.assert_allclose(middle, wanted, atol=2 * histogram.THICK + 2)
    # The line climbs from the middle to the right end.
    rows = [np.flatnonzero(white[:, column]).mean() for column in (10, 120, 192, 250)]
    np.testing.assert_allclose(
        rows, [0.75, 0.75, 0.5 * histogram.HEIGHT, 0.955 * histogram.HEIGHT], atol=3
    )


def test_the_icon_is_drawn_once_for_one_state(
    scene: bpy.types.Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    histogram.forget()
    count = []
    plain = histogram.picture
    monkeypatch.setattr(histogram, "picture", lambda *a: count.append(1) or plain(*a))
    draw(scene)
    draw(scene)
    assert len(count) == 1
    material(scene).volillum.logarithmic = not material(scene).volillum.logarithmic
    draw(scene)
    assert len(count) == 2


def test_more_points_than_a_ramp_holds_are_refused(scene: bpy.types.Scene) -> None:
    many = np.linspace(0, 1, 40)
    function = TransferFunction(many, many, np.ones((40, 3)), 1.0)
    with pytest.raises(InputError, match="40 points; expected at most 32"):
        transfer.write(material(scene), function)


def test_the_ramp_lives_in_the_material(scene: bpy.types.Scene) -> None:
    copied = material(scene).copy()
    try:
        assert transfer.read(copied).as_json() == transfer.read(material(scene)).as_json()
        assert json.loads(copied.volillum.text)["kind"] == "mr"
    finally:
        bpy.data.materials.remove(copied)
