"""Importing in Blender: the operator from a script, where the volume lands, what the menu, the drop
handler and the dialog are, and sequences."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import bpy
import numpy as np
import pytest
from plumes import write_plume
from recording_layout import RecordingLayout

from volillum_addon.blender import import_operators, transfer
from volillum_addon.blender.jobs import Job
from volillum_addon.blender.scene_reader import read_scene
from volillum_addon.core.control import Cancelled
from volillum_addon.readers import matter, transfer_presets
from volillum_addon.readers.formats import read_volume
from volillum_addon.readers.frames import VolumeFiles, sequence_of
from volillum_addon.readers.imported import read_about
from volillum_addon.readers.medium_file import medium_of

SHAPE = (12, 10, 8)


@pytest.fixture
def empty(extension: None, tmp_path: Path) -> Iterator[bpy.types.Scene]:
    made = bpy.data.scenes.new("imports")
    made.volillum.directory = str(tmp_path / "out")
    made.world = bpy.data.worlds.new("imports")  # some light
    with bpy.context.temp_override(scene=made, view_layer=made.view_layers[0]):
        yield made
    for item in list(made.objects):
        data = item.data
        bpy.data.objects.remove(item)
        bpy.data.volumes.remove(data)
    bpy.data.worlds.remove(made.world)
    bpy.data.scenes.remove(made)


def ct(directory: Path, **entries: object) -> Path:
    """A soft ball in Hounsfield units, 24 x 20 x 24 mm, away from the origin."""
    axes = np.meshgrid(*(np.linspace(-1, 1, n) for n in SHAPE), indexing="ij")
    radius = np.sqrt(sum(axis**2 for axis in axes))
    np.save(directory / "ct.npy", (-1000 + 2500 * np.clip(1 - radius, 0, 1)).astype(np.int16))
    entry = {"kind": "ct", "unit": "HU", "length_unit": "mm", "spacing": [2, 2, 3],
             "origin": [-300, 40, 800], **entries}  # fmt: skip
    (directory / "ct.json").write_text(json.dumps(entry))
    return directory / "ct.npy"


def imported(scene: bpy.types.Scene, path: Path, **arguments: object) -> bpy.types.Object:
    assert bpy.ops.volillum.import_volume(filepath=str(path), **arguments) == {"FINISHED"}
    item = scene.volillum.volume
    scene.view_layers[0].update()
    return item


def refusal(**arguments: object) -> str:
    with pytest.raises(RuntimeError) as caught:
        bpy.ops.volillum.import_volume(**arguments)
    (line,) = str(caught.value).strip().splitlines()
    return line


def test_the_volume_is_the_transfer_functions_medium(
    empty: bpy.types.Scene, tmp_path: Path
) -> None:
    path = ct(tmp_path)
    item = imported(empty, path, size="FILE")
    grid, about = read_volume(path)
    expected = medium_of(grid, about, transfer_presets.load("ct_bone", about)).trimmed(0)
    found = read_scene(empty, item).scene.medium.trimmed(0)
    # sigma_t is put together again from two float32.
    np.testing.assert_allclose(found.sigma_t.values.reshape(-1, found.sigma_t.channels),
                               expected.sigma_t.values.reshape(-1, 1)
                               .repeat(found.sigma_t.channels, axis=1), rtol=1e-6)  # fmt: skip
    np.testing.assert_allclose(found.sigma_t.index_to_world, expected.sigma_t.index_to_world)
    assert read_about(transfer.source_of(item.active_material)).unit == "HU"
    assert Path(bpy.path.abspath(item.data.filepath)).resolve().parent == tmp_path / "out"


def test_a_fitted_volume_is_two_units_long_about_the_origin(
    empty: bpy.types.Scene, tmp_path: Path
) -> None:
    item = imported(empty, ct(tmp_path))
    grid, _ = read_volume(tmp_path / "ct.npy")
    corners = grid.corners() @ np.array(item.matrix_world)[:3, :3].T
    corners += np.array(item.matrix_world)[:3, 3]
    np.testing.assert_allclose(corners.mean(axis=0), 0, atol=1e-5)
    assert np.ptp(corners, axis=0).max() == pytest.approx(2, rel=1e-5)
    # Its optical depth is that of the file's own size: Blender scales the coefficients back.
    fitted = read_scene(empty, item).scene.medium.sigma_t
    item.matrix_world = np.eye(4)
    plain = read_scene(empty, item).scene.medium.sigma_t
    np.testing.assert_allclose(fitted.values.max() * fitted.voxel_size,
                               plain.values.max() * plain.voxel_size, rtol=1e-5)  # fmt: skip


def test_a_true_size_is_in_metres(empty: bpy.types.Scene, tmp_path: Path) -> None:
    item = imported(empty, ct(tmp_path), size="TRUE")
    np.testing.assert_allclose(np.array(item.matrix_world), np.diag([1e-3, 1e-3, 1e-3, 1]))
    ct(tmp_path, length_unit="")
    said = refusal(filepath=str(tmp_path / "ct.npy"), size="TRUE")
    assert "unit of length is not told by the file" in said


def test_a_level_and_a_preset_are_taken(empty: bpy.types.Scene, tmp_path: Path) -> None:
    item = imported(empty, ct(tmp_path), level=1, transfer="ct_skin")
    about = transfer.about(item.active_material)
    assert (about.level, about.shape) == (1, (6, 5, 4))
    wanted = transfer_presets.load("ct_skin", about)
    np.testing.assert_allclose(
        transfer.read(item.active_material).values, wanted.values, rtol=1e-5, atol=1e-3
    )


def test_importing_twice_writes_once(empty: bpy.types.Scene, tmp_path: Path) -> None:
    first = imported(empty, ct(tmp_path))
    files = {file: file.stat().st_mtime_ns for file in (tmp_path / "out").iterdir()}
    second = imported(empty, tmp_path / "ct.npy")
    assert second != first
    assert {file: file.stat().st_mtime_ns for file in (tmp_path / "out").iterdir()} == files
    assert len(files) == 2


def test_a_damaged_file_is_refused_and_leaves_nothing(
    empty: bpy.types.Scene, tmp_path: Path
) -> None:
    path = ct(tmp_path)
    path.write_bytes(path.read_bytes()[:200])
    assert "ct.npy" in refusal(filepath=str(path))
    assert not list(empty.objects)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("known", [False, True])
def test_cancelled_between_its_two_files_leaves_what_was_there(
    tmp_path: Path, known: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    out, source = tmp_path / "out", VolumeFiles(ct(tmp_path))
    out.mkdir()
    if known:
        matter.read_matter(source, out).values.unlink()
    before = sorted(out.iterdir())
    written = []

    def cancelled(*_: object) -> None:
        written.extend(out.iterdir())
        raise Cancelled("cancelled")

    monkeypatch.setattr(matter, "write_imported", cancelled)
    with pytest.raises(Cancelled):
        matter.read_matter(source, out)
    assert len(written) == 1
    assert sorted(out.iterdir()) == before


def test_a_raw_file_takes_the_dialogs_layout(empty: bpy.types.Scene, tmp_path: Path) -> None:
    values = np.arange(3 * 4 * 5, dtype=">u2").reshape((3, 4, 5), order="F")
    (tmp_path / "plain.raw").write_bytes(b"ab" + values.tobytes(order="F"))
    assert "--dims" in refusal(filepath=str(tmp_path / "plain.raw"))
    item = imported(
        empty, tmp_path / "plain.raw", raw_dims=(3, 4, 5), raw_type="uint16",
        raw_byte_order="big", raw_offset=2, raw_spacing=(1, 1, 2),
    )  # fmt: skip
    about = transfer.about(item.active_material)
    assert (about.shape, about.high) == ((3, 4, 5), 59)


def test_the_dialog_shows_what_a_raw_file_needs(extension: None, tmp_path: Path) -> None:
    (tmp_path / "plain.raw").write_bytes(bytes(122))
    layout = RecordingLayout()
    operator = SimpleNamespace(
        layout=layout, _path=lambda: tmp_path / "plain.raw", _raw_bytes=lambda: 120
    )
    kind = import_operators.VOLILLUM_OT_import_volume
    rna = bpy.ops.volillum.import_volume.get_rna_type()
    operator.bl_rna = rna
    kind.draw(operator, None)
    assert set(import_operators.RAW) <= set(layout.properties())
    assert "120 bytes of the file's 122" in layout.labels()
    other = RecordingLayout()
    operator.layout, operator._path = other, lambda: tmp_path / "ct.nii"
    kind.draw(operator, None)
    assert not set(import_operators.RAW) & set(other.properties())


def test_a_vdb_is_taken_as_it_is(empty: bpy.types.Scene, tmp_path: Path) -> None:
    write_plume(tmp_path / "plume.vdb")
    item = imported(empty, tmp_path / "plume.vdb")
    assert Path(bpy.path.abspath(item.data.filepath)).resolve() == tmp_path / "plume.vdb"
    assert not item.data.is_sequence
    assert not (tmp_path / "out").exists()


def test_a_sequence_is_known_by_its_numbers(empty: bpy.types.Scene, tmp_path: Path) -> None:
    for frame in (3, 4, 5, 7):
        write_plume(tmp_path / f"plume_{frame:04d}.vdb")
    item = imported(empty, tmp_path / "plume_0004.vdb")
    assert item.data.is_sequence
    assert item.name == "plume"
    assert (item.data.frame_start, item.data.frame_duration) == (3, 3)
    empty.frame_set(5)
    with bpy.context.temp_override(scene=empty):
        assert list(sequence_of(tmp_path / "plume_0004.vdb").frames) == [3, 4, 5]
    assert not sequence_of(tmp_path / "plume_0007.vdb").frames


def test_several_dropped_files_are_one_volume(empty: bpy.types.Scene, tmp_path: Path) -> None:
    path = ct(tmp_path)
    assert bpy.ops.volillum.import_volume(
        directory=f"{tmp_path}/", files=[{"name": path.name}]
    ) == {"FINISHED"}
    assert empty.volillum.volume.name.startswith("ct")


def test_the_job_runs_without_blender(empty: bpy.types.Scene, tmp_path: Path) -> None:
    kind = import_operators.VOLILLUM_OT_import_volume
    operator = SimpleNamespace(
        filepath=str(ct(tmp_path)), files=[], directory="", level=0, transfer="AUTO", size="FIT",
        channel=0, raw_dims=(0, 0, 0), sequence=True,
        properties=SimpleNamespace(is_property_set=lambda _: False),
    )  # fmt: skip
    operator._path = lambda: kind._path(operator)
    operator._layout = lambda path: kind._layout(operator, path)
    work = kind.prepare(operator, bpy.context)
    job = Job("Import", work)
    result = job.result()
    assert not list(empty.objects)  # nothing of the scene before the end
    assert "HU" in work.finish(result)
    assert len(list(empty.objects)) == 1


@pytest.mark.usefixtures("extension")
def test_the_menu_and_the_drop_handler() -> None:
    layout = RecordingLayout()
    import_operators._menu(SimpleNamespace(layout=layout), bpy.context)
    assert layout.operators() == ["volillum.import_volume"]
    handler = import_operators.VOLILLUM_FH_volume
    assert handler.bl_import_operator == "volillum.import_volume"
    endings = handler.bl_file_extensions.split(";")
    assert {".nii", ".gz", ".nrrd", ".mhd", ".dcm", ".tif", ".npy", ".raw"} <= set(endings)
    assert not {".json", ".txt"} & set(endings)
    assert handler.poll_drop(SimpleNamespace(area=SimpleNamespace(type="VIEW_3D")))
    assert not handler.poll_drop(SimpleNamespace(area=SimpleNamespace(type="IMAGE_EDITOR")))
