"""`volillum import` and `volillum scene` of VDB sequences: real files in, every frame's out."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import bpy
import numpy as np
import pytest
from blender_scenes import write_grids
from bpy_extras.object_utils import world_to_camera_view
from command_line import session
from mathutils import Vector
from plumes import plume
from puffs import FRAMES, empty_file, puffs

from volillum_addon.bake.grids import read_grid
from volillum_addon.bake.vdb import read_metadata, read_vdb
from volillum_addon.blender import cli, extent, scene_presets, transfer, work
from volillum_addon.blender.gallery_presets import column
from volillum_addon.blender.scene_reader import read_scene
from volillum_addon.core.control import Control
from volillum_addon.core.grid import Grid
from volillum_addon.readers.formats import read_volume
from volillum_addon.readers.imported import read_about, read_imported
from volillum_addon.readers.medium_file import medium_of

pytestmark = pytest.mark.usefixtures("no_file_left_open")

BAKE = ["--model", "ambient_occlusion", "--frames", "2-4"]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working directory, with the sequence in `in`."""
    puffs(tmp_path / "in")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def opened(file: Path) -> bpy.types.Scene:
    bpy.ops.wm.open_mainfile(filepath=str(file))
    return bpy.context.scene


def volume_of(scene: bpy.types.Scene) -> bpy.types.Object:
    (found,) = (each for each in scene.objects if each.type == "VOLUME")
    return found


def test_every_frame_is_imported_under_its_number(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    line = ["import", "in/puff_####.vdb", "--level", "1", "-o", "out/coarse_#.vdb"]
    assert cli.main(line) == cli.DONE
    said = capsys.readouterr()
    assert said.out == "out/coarse_#.vdb\n"
    assert said.err.startswith("3 frames, VDB, ")
    files = sorted((folder / "out").iterdir())
    assert [file.name for file in files] == [f"coarse_{frame}.vdb" for frame in FRAMES]
    for frame, file in zip(FRAMES, files, strict=True):
        grid, about = read_imported(file)
        wanted, _ = read_volume(folder / "in" / f"puff_{frame:04d}.vdb", level=1)
        np.testing.assert_array_equal(grid.values, wanted.values)
        np.testing.assert_array_equal(grid.index_to_world, wanted.index_to_world)
        assert about.level == 1


def test_a_part_and_another_format_are_imported_too(folder: Path) -> None:
    for frame in FRAMES:
        np.save(folder / f"beat_{frame}.npy", np.full((2, 3, 4), frame, np.uint8))
    line = ["import", "beat_#.npy", "--frames", "3-4", "-o", "beat_####.vdb"]
    assert cli.main(line) == cli.DONE
    found = sorted(path.name for path in folder.glob("beat_*.vdb"))
    assert found == ["beat_0003.vdb", "beat_0004.vdb"]
    assert read_about(folder / "beat_0004.vdb").high == 4


def test_a_scene_of_a_sequence_as_it_is(folder: Path) -> None:
    line = ["scene", *sorted(map(str, Path("in").iterdir())), "-o", "puff.blend"]
    assert cli.main(line) == cli.DONE
    assert sorted(path.name for path in folder.iterdir()) == ["in", "puff.blend"]
    scene = opened(folder / "puff.blend")
    data = volume_of(scene).data
    assert (data.is_sequence, data.frame_start, data.frame_duration, data.frame_offset) == (
        True, 2, 3, 1)  # fmt: skip
    assert (scene.frame_start, scene.frame_end, scene.frame_current) == (2, 4, 2)
    assert scene.name == "puff"
    # The material is the brightest frame's, and the camera holds every frame's matter.
    depths = [read_scene(scene).scene.medium.sigma_t for _ in map(scene.frame_set, FRAMES)]
    wanted = scene_presets.load("default").medium
    assert wanted is not None
    assert max(map(column, depths)) == pytest.approx(wanted.optical_depth, rel=1e-5)
    for depth in depths:
        assert in_picture(scene, depth)


def in_picture(scene: bpy.types.Scene, grid: Grid) -> bool:
    matter = np.argwhere(grid.values > extent.HAZE * grid.values.max())
    places = [
        world_to_camera_view(scene, scene.camera, Vector(point))
        for point in grid.to_world(matter.astype(float))
    ]
    margin = scene_presets.load("default").camera.margin - 1e-4
    return all(margin <= n <= 1 - margin for place in places for n in (place.x, place.y))


def test_a_scene_through_a_function_bakes_frame_by_frame(folder: Path) -> None:
    made, first, again = session(
        folder,
        ["scene", "in/puff_####.vdb", "--transfer", "smoke", "--level", "1", "-o", "puff.blend"],
        ["bake", "puff.blend", *BAKE, "-o", "bakes"],
        ["bake", "puff.blend", *BAKE, "-o", "bakes"],
    )
    assert (made.status, first.status, again.status) == (0, 0, 0), made.err + first.err
    lines = [json.loads(line) for line in first.out.splitlines()]
    assert [line["frame"] for line in lines] == list(FRAMES)
    assert [line["found"] for line in lines] == [False] * 3
    assert all(json.loads(line)["found"] for line in again.out.splitlines())
    assert len({read_metadata(folder / line["path"])["hash"] for line in lines}) == 3
    # As by hand: each frame's own file, and the one function that the scene keeps, on their values.
    with_settings(folder / "puff.blend", lines)


def with_settings(file: Path, lines: list[dict[str, str]]) -> None:
    transfer.register()
    try:
        scene = opened(file)
        material = volume_of(scene).data.materials[0]
        assert material.volillum.frames == 3
        assert transfer.about(material).level == 1
        assert material.volillum.applied == transfer.signature(material)
        function = transfer.read(material)
        for frame, line in zip(FRAMES, lines, strict=True):
            values = read_volume(file.parent / "in" / f"puff_{frame:04d}.vdb", level=1)
            wanted = medium_of(*values, function).sigma_t
            found = read_vdb(file.parent / line["path"]).medium.sigma_t
            middle = np.argwhere(wanted.values > 0.5 * wanted.values.max()).astype(float)
            index = np.round(found.to_index(wanted.to_world(middle))).astype(int)
            np.testing.assert_allclose(
                found.values[tuple(index.T)], wanted.values[tuple(middle.astype(int).T)], rtol=1e-4
            )
    finally:
        transfer.unregister()


def test_a_scene_that_moves_with_its_files_keeps_its_function(
    folder: Path, extension: None
) -> None:
    line = ["scene", "in/puff_####.vdb", "--transfer", "smoke", "-o", "here/puff.blend"]
    assert cli.main(line) == cli.DONE
    shutil.move(folder / "here", folder / "there")
    scene = opened(folder / "there" / "puff.blend")
    material = transfer.material_of(scene)
    assert material is not None
    material.volillum.per_voxel *= 2
    scene.volillum.directory = "//"
    assert bpy.ops.volillum.apply_transfer() == {"FINISHED"}
    assert volume_of(scene).data.is_sequence
    assert work.read(scene).scene.medium.sigma_t.values.max() > 0


def test_empty_frames_are_part_of_a_scene(folder: Path) -> None:
    empty_file(folder / "in" / "puff_0005.vdb")
    assert cli.main(["scene", "in/puff_####.vdb", "-o", "puff.blend"]) == cli.DONE
    assert opened(folder / "puff.blend").frame_end == 5


def test_a_scene_takes_the_grid_that_is_named(folder: Path) -> None:
    for frame in (1, 2):
        write_grids(folder / f"two_{frame}.vdb", plume(), plume(name="heat"))
    line = ["scene", "two_#.vdb", "--grid", "heat", "-o", "two.blend"]
    assert cli.main(line) == cli.DONE
    material = volume_of(opened(folder / "two.blend")).data.materials[0]
    names = [node.inputs["Density Attribute"].default_value for node in material.node_tree.nodes
             if "Density Attribute" in node.inputs]  # fmt: skip
    assert names == ["heat"]


def damage(folder: Path) -> None:
    file = folder / "puff_0003.vdb"
    file.write_bytes(file.read_bytes()[:-200])


def gap(folder: Path) -> None:
    (folder / "puff_0003.vdb").unlink()


def other_grid(folder: Path) -> None:
    write_grids(folder / "puff_0003.vdb", plume(name="heat"))


def nothing(folder: Path) -> None:
    for file in folder.iterdir():
        file.rename(file.with_name(f"x{file.name}"))


def all_empty(folder: Path) -> None:
    for file in sorted(folder.iterdir()):
        empty_file(file)


WRONG = {
    damage: r"puff_0003.vdb is cut off or damaged",
    gap: "sequence puff_####.vdb is without puff_0003.vdb; expected every frame from 2 to 4",
    other_grid: "'heat'",
    nothing: "what puff_####.vdb names is no file (there are xpuff_0002.vdb, xpuff_0003.vdb",
    all_empty: "empty; expected matter in one of them at least",
}


@pytest.mark.parametrize("wrong", WRONG)
@pytest.mark.parametrize(
    "line",
    [
        ["import", "in/puff_####.vdb", "-o", "out/puff_####.vdb"],
        ["scene", "in/puff_####.vdb", "-o", "out/puff.blend"],
        ["scene", "in/puff_####.vdb", "--transfer", "smoke", "-o", "out/puff.blend"],
    ],
    ids=["import", "scene", "transfer"],
)
def test_what_is_wrong_is_one_line_and_nothing_is_written(
    folder: Path, capsys: pytest.CaptureFixture[str], wrong: object, line: list[str]
) -> None:
    wrong(folder / "in")
    assert cli.main(line) == cli.FAILED
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.count("\n") == 1
    assert WRONG[wrong] in said.err
    assert "expected" in said.err
    assert not list((folder / "out").glob("*"))


@pytest.mark.parametrize(
    ("line", "said"),
    [
        (["import", "in/puff_####.vdb", "-o", "out.vdb"], "as out_####.vdb"),
        (["import", "in/puff_0002.vdb", "-o", "out_#.vdb"], "expected one file's, as out.vdb"),
        (["import", "in/puff_####.vdb", "-o", "in/puff_####.vdb"], "expected others than are read"),
        (["import", "in/puff_####.vdb", "-o", "out_####.nrrd"], "a name that ends in .vdb"),
        (["scene", "in/puff_####.vdb", "--transfer", "smoke", "-o", "out"], "ends in .blend"),
        (["scene", "in/puff_####.vdb", "--grid", "x", "-o", "out.blend"], "grid 'x' is missing"),
    ],
)
def test_a_wrong_output_or_grid_is_said_before_any_work(
    folder: Path, capsys: pytest.CaptureFixture[str], line: list[str], said: str
) -> None:
    assert cli.main(line) == cli.FAILED
    assert said in capsys.readouterr().err
    assert [path.name for path in folder.iterdir()] == ["in"]
    assert len(list((folder / "in").iterdir())) == 3


def test_an_import_that_was_stopped_goes_on_where_it_was(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    line = ["import", "in/puff_####.vdb", "-o", "out/puff_####.vdb"]
    check = Control.check

    def stopping(self: Control) -> None:
        if (folder / "out").is_dir() and len(list((folder / "out").glob("*.vdb"))) == 2:
            self.cancel()
        check(self)

    with monkeypatch.context() as patched:
        patched.setattr(Control, "check", stopping)
        assert cli.main(line) == cli.CANCELLED
    kept = {path.stat().st_mtime_ns for path in (folder / "out").iterdir()}
    assert len(kept) == 2
    assert cli.main(line) == cli.DONE
    files = sorted((folder / "out").iterdir())
    assert [file.name for file in files] == [f"puff_{frame:04d}.vdb" for frame in FRAMES]
    assert kept < {path.stat().st_mtime_ns for path in files}
    assert read_grid(files[0]).values.max() > 0
