"""A whole import: the VDB file that comes out, and nothing left where it fails or is cancelled."""

from __future__ import annotations

import json
import threading
from pathlib import Path

import numpy as np
import pytest

from volillum_addon.bake.grids import read_grid
from volillum_addon.blender import cli
from volillum_addon.core.control import Cancelled, Control
from volillum_addon.core.errors import InputError
from volillum_addon.readers import gather
from volillum_addon.readers.formats import FORMATS, import_volume, read_volume
from volillum_addon.readers.imported import BINS, read_about, read_imported

SHAPE = (9, 6, 11)


def made(directory: Path, values: np.ndarray | None = None) -> Path:
    """A raw file with a sidecar: int16 with a border of zeros, oblong voxels, away from 0."""
    if values is None:
        values = np.zeros(SHAPE, np.int16)
        values[2:7, 1:5, 3:9] = np.random.default_rng(3).integers(-1000, 3000, (5, 4, 6))
    path = directory / "scan.raw"
    path.write_bytes(b"head" + values.astype(">i2").tobytes(order="F"))
    entry = {
        "dims": list(values.shape),
        "type": "int16",
        "byte_order": "big",
        "offset": 4,
        "spacing": [0.5, 0.5, 2],
        "origin": [10, 20, 30],
        "direction": [0, 1, 0, -1, 0, 0, 0, 0, 1],
        "intercept": -1024,
        "unit": "HU",
        "length_unit": "mm",
        "kind": "ct",
    }
    (directory / "scan.json").write_text(json.dumps(entry))
    return path


def test_what_is_written_is_what_was_read(tmp_path: Path) -> None:
    path, target = made(tmp_path), tmp_path / "out" / "scan.vdb"
    grid, about = read_volume(path)
    assert import_volume(path, target) == about
    again, told = read_imported(target)
    np.testing.assert_array_equal(again.values, grid.values)
    np.testing.assert_array_equal(again.index_to_world, grid.index_to_world)
    assert told == about == read_about(target)
    # 90 degrees about z: i goes along y.
    np.testing.assert_allclose(again.to_world(np.array([1.0, 0, 1])), (10, 20.5, 32))
    assert (told.unit, told.length_unit, told.kind, told.low) == (
        "HU",
        "mm",
        "ct",
        grid.values.min(),
    )


def test_few_whole_numbers_have_an_interval_each(tmp_path: Path) -> None:
    values = np.repeat(np.arange(3, 103, dtype=np.uint8), 10).reshape(10, 10, 10)
    np.save(tmp_path / "a.npy", values)
    assert read_volume(tmp_path / "a.npy")[1].histogram == (10,) * 100
    np.save(tmp_path / "a.npy", values.astype(np.float32) / 7)
    assert len(read_volume(tmp_path / "a.npy")[1].histogram) == BINS


def test_a_range_of_a_few_steps_of_float32_is_counted(tmp_path: Path) -> None:
    values = np.full((3, 4, 5), 3e8, np.float32)
    values[1, 2, 3] = np.nextafter(values[0, 0, 0], np.float32(np.inf))
    np.save(tmp_path / "a.npy", values)
    counts = read_volume(tmp_path / "a.npy")[1].histogram
    assert (counts[0], counts[-1], sum(counts)) == (59, 1, 60)


def test_a_border_of_zeros_is_kept(tmp_path: Path) -> None:
    values = np.zeros(SHAPE, np.int16)
    values[4, 3, 5] = 9
    path = made(tmp_path, values)
    (tmp_path / "scan.json").write_text(
        json.dumps({"dims": list(SHAPE), "type": "int16", "byte_order": "big", "offset": 4})
    )
    import_volume(path, tmp_path / "scan.vdb")
    assert read_imported(tmp_path / "scan.vdb")[0].shape == SHAPE
    # The file's own active box is the one voxel: that is why the shape is written down.
    assert read_grid(tmp_path / "scan.vdb").shape == (1, 1, 1)
    # Importing what was imported changes nothing.
    import_volume(tmp_path / "scan.vdb", tmp_path / "again.vdb")
    assert read_imported(tmp_path / "again.vdb")[0].shape == SHAPE


@pytest.mark.parametrize("level", [1, 2, 3])
def test_a_level_is_the_mean_of_its_blocks(tmp_path: Path, level: int) -> None:
    path = made(tmp_path)
    full, _ = read_volume(path)
    coarse, about = read_volume(path, level=level)
    block = 2**level
    for index in np.ndindex(*coarse.shape):
        low = np.array(index) * block
        high = np.minimum(low + block, SHAPE)
        inside = full.values[tuple(slice(a, b) for a, b in zip(low, high, strict=True))]
        # Means of up to 512 numbers in double precision, stored in single.
        assert coarse.values[index] == pytest.approx(inside.astype(float).mean(), rel=1e-6)
        centre = low + (block - 1) / 2
        np.testing.assert_allclose(
            coarse.to_world(np.array(index, float)), full.to_world(centre), atol=1e-12
        )
    assert (about.level, about.shape) == (level, coarse.shape)


def test_slabs_of_any_thickness_give_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = made(tmp_path)
    whole = [read_volume(path, level)[0].values for level in (0, 1, 2)]
    for voxels in (1, 2 * 9 * 6, 5 * 9 * 6):
        monkeypatch.setattr(gather, "SLAB_VOXELS", voxels)
        for level, values in enumerate(whole):
            np.testing.assert_array_equal(read_volume(path, level)[0].values, values)


def test_cancelling_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = made(tmp_path)
    before = sorted(tmp_path.iterdir())
    control = Control()
    control.cancel()
    with pytest.raises(Cancelled):
        import_volume(path, tmp_path / "scan.vdb", control=control)
    # In the middle of the file: the second slab asks before it goes on.
    monkeypatch.setattr(gather, "SLAB_VOXELS", 1)
    later = Control()
    reported: list[float] = []

    def report(fraction: float) -> None:
        reported.append(fraction)
        if len(reported) == 4:
            later.cancel()

    monkeypatch.setattr(later, "report", report)
    with pytest.raises(Cancelled):
        import_volume(path, tmp_path / "scan.vdb", control=later)
    assert reported == [(n + 1) / SHAPE[2] for n in range(4)]
    assert sorted(tmp_path.iterdir()) == before


def test_more_than_the_memory_is_refused_with_a_level_that_fits(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = made(tmp_path)
    room = gather.BYTES_PER_VOXEL * 5 * 3 * 6  # exactly level 1
    monkeypatch.setattr(gather, "available_bytes", lambda: room)
    with pytest.raises(InputError, match=r"9 x 6 x 11 voxels at level 0.*--level 1"):
        read_volume(path)
    assert read_volume(path, level=1)[0].shape == (5, 3, 6)


def test_progress_is_told_from_another_thread(tmp_path: Path) -> None:
    control = Control()
    done: list[object] = []
    thread = threading.Thread(
        target=lambda: done.append(
            import_volume(made(tmp_path), tmp_path / "o.vdb", control=control)
        )
    )
    thread.start()
    thread.join()
    assert done
    assert control.fraction == 1.0


def test_the_command_imports(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    target = tmp_path / "scan.vdb"
    assert cli.main(["import", str(made(tmp_path)), "-o", str(target), "--level", "1"]) == cli.DONE
    out, err = capsys.readouterr()
    assert out == f"{target}\n"
    assert "raw, 5 x 3 x 6 of int16" in err
    assert "HU" in err
    assert read_about(target).level == 1


def test_the_command_takes_a_raw_files_layout(tmp_path: Path) -> None:
    path = tmp_path / "plain.raw"
    values = np.arange(60, dtype=">f4").reshape((3, 4, 5), order="F")
    path.write_bytes(b"12" + values.tobytes(order="F"))
    target = tmp_path / "plain.vdb"
    layout = ["--dims", "3x4x5", "--type", "float32", "--byte-order", "big", "--offset", "2"]
    arguments = ["import", str(path), "-o", str(target), *layout, "--spacing", "1,1,2.5"]
    assert cli.main(arguments) == cli.DONE
    grid, _ = read_imported(target)
    np.testing.assert_array_equal(grid.values, values)
    np.testing.assert_allclose(grid.voxel_size, (1, 1, 2.5))


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["nothing.nii"], "nothing.nii"),
        (["scan.raw", "--dims", "9x6x12", "--type", "int16"], "1192 bytes long; expected 1296"),
        (["scan.raw", "--dims", "9x6", "--type", "int16"], "its dims"),
        (["scan.raw", "--dims", "9x6x11"], "its type is missing"),
        (["scan.json"], "index.json of vtk.js"),
        (["folder"], "without DICOM images (there is no file)"),
    ],
)
def test_the_command_says_what_is_wrong(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    arguments: list[str],
    said: str,
) -> None:
    made(tmp_path)
    (tmp_path / "folder").mkdir()
    monkeypatch.chdir(tmp_path)
    assert cli.main(["import", *arguments, "-o", "out.vdb"]) == cli.FAILED
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert said in err
    assert not list(tmp_path.glob("*.vdb"))


def test_every_format_has_a_reader() -> None:
    assert len({each.id for each in FORMATS}) == len(FORMATS)
    suffixes = [suffix for each in FORMATS for suffix in each.suffixes]
    assert len(set(suffixes)) == len(suffixes)
    assert all(callable(each.read) for each in FORMATS)
