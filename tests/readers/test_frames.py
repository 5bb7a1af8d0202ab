"""Which files a name means: one, or a sequence's, complete and in order."""

from __future__ import annotations

from pathlib import Path

import pytest

from volillum_addon.core.errors import InputError
from volillum_addon.readers.frames import LAST_FRAME, VolumeFiles, chosen, sequence_of


def made(folder: Path, *names: str) -> list[Path]:
    folder.mkdir(exist_ok=True)
    for name in names:
        (folder / name).touch()
    return [folder / name for name in names]


def names(files: VolumeFiles) -> dict[int, str]:
    return {frame: path.name for frame, path in files.frames.items()}


def test_a_hash_is_a_digit_and_more_may_follow(tmp_path: Path) -> None:
    made(tmp_path, "s_098.vdb", "s_099.vdb", "s_100.vdb", "s_0101.vdb", "s_101x.vdb", "t_101.vdb")
    found = chosen([tmp_path / "s_###.vdb"])
    assert names(found) == {98: "s_098.vdb", 99: "s_099.vdb", 100: "s_100.vdb"}
    assert found.path == tmp_path / "s_098.vdb"
    assert found.stem == "s"
    made(tmp_path, "u_9.vdb", "u_10.vdb")
    assert list(chosen([tmp_path / "u_#.vdb"]).frames) == [9, 10]


def test_files_may_be_named_one_by_one_in_any_order(tmp_path: Path) -> None:
    # As a shell sorts u_*.vdb.
    paths = made(tmp_path, "u_10.vdb", "u_8.vdb", "u_9.vdb")
    assert names(chosen(paths)) == {8: "u_8.vdb", 9: "u_9.vdb", 10: "u_10.vdb"}


def test_a_range_takes_a_part(tmp_path: Path) -> None:
    made(tmp_path, *(f"s_{frame:04d}.vdb" for frame in (1, 2, 4, 5, 6)))
    assert list(chosen([tmp_path / "s_####.vdb"], range(4, 6)).frames) == [4, 5]


def test_a_sequence_of_any_format_has_its_whole_suffix(tmp_path: Path) -> None:
    made(tmp_path, "heart1.nii.gz", "heart2.nii.gz")
    found = chosen([tmp_path / "heart#.nii.gz"])
    assert (list(found.frames), found.stem) == ([1, 2], "heart")


def test_a_file_that_is_called_so_is_that_file(tmp_path: Path) -> None:
    (path,) = made(tmp_path, "a##.vdb")
    assert not chosen([path]).frames


def test_a_picked_files_neighbours_are_found_with_fewer_and_with_more_digits(
    tmp_path: Path,
) -> None:
    made(tmp_path, *(f"u_{frame}.vdb" for frame in (8, 9, 10, 11, 13)))
    for picked in ("u_8", "u_11"):
        assert list(sequence_of(tmp_path / f"{picked}.vdb").frames) == [8, 9, 10, 11]
    assert not sequence_of(tmp_path / "u_13.vdb").frames
    made(tmp_path, "p_09.vdb", "p_10.vdb", "p_9.vdb")
    assert names(sequence_of(tmp_path / "p_09.vdb")) == {9: "p_09.vdb", 10: "p_10.vdb"}
    # Not frames: Blender counts no further.
    made(tmp_path, "scan20240101.vdb", "scan20240102.vdb")
    assert not sequence_of(tmp_path / "scan20240101.vdb").frames


@pytest.mark.parametrize(
    ("given", "frames", "said"),
    [
        (["s_####.vdb"], None,
         r"sequence s_####\.vdb is without s_0003\.vdb; expected every frame from 1 to 5"),
        (["s_####.vdb"], range(4, 8), r"without s_0006\.vdb, s_0007\.vdb; .* from 4 to 7"),
        (["s_0001.vdb", "s_0004.vdb"], None, r"without s_0002\.vdb, s_0003\.vdb"),
        (["s_##.vdb"], None,
         r"s_##\.vdb names is no file \(there are s_0001\.vdb, .*\); expected files such as s_01"),
        (["s_####.nrrd"], None, r"no file \(there are none of this suffix\)"),
        (["nowhere/s_####.vdb"], None, r"nowhere cannot be read \(No such file"),
        (["s_####_a.vdb"], None, r"a sequence's name is .*right before the suffix"),
        (["#s_##.vdb"], None, r"a sequence's name is .*as in smoke_####\.vdb"),
        (["s_0001.vdb", "t_0002.vdb"], None, r"2 files \(s_0001\.vdb, t_0002\.vdb\); expected one"),
        (["s_0001.vdb"], range(1, 3), r"s_0001\.vdb, one file; expected a sequence"),
        (["slice_#.tif"], None, r"2 files of slices \(slice_#\.tif\); expected their folder"),
        (["scan########.vdb"], None, rf"is 20240102; expected at most {LAST_FRAME}"),
    ],
)  # fmt: skip
def test_what_is_no_sequence_is_refused(
    tmp_path: Path, given: list[str], frames: range | None, said: str
) -> None:
    made(tmp_path, *(f"s_{frame:04d}.vdb" for frame in (1, 2, 4, 5)), "t_0002.vdb")
    made(tmp_path, "scan20240101.vdb", "scan20240102.vdb", "slice_1.tif", "slice_2.tif")
    with pytest.raises(InputError, match=said):
        chosen([tmp_path / name for name in given], frames)


def test_a_long_gap_is_counted(tmp_path: Path) -> None:
    made(tmp_path, "s_1.vdb", "s_900.vdb")
    with pytest.raises(InputError, match=r"s_2\.vdb, .*s_6\.vdb and 893 more"):
        chosen([tmp_path / "s_#.vdb"])
