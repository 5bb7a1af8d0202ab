"""The files that an import of a sequence writes: resumed, told apart, and none where it fails."""

from __future__ import annotations

import shutil
from pathlib import Path

import bpy
import pytest
from blender_scenes import write_grids
from plumes import plume
from puffs import FRAMES, empty_file, puffs

from volillum_addon.bake.frame_files import frame_file
from volillum_addon.core.control import Cancelled, Control
from volillum_addon.core.errors import InputError
from volillum_addon.readers import sequence
from volillum_addon.readers.frames import sequence_of
from volillum_addon.readers.matter import Imported, read_matter
from volillum_addon.readers.source import Options


def test_an_import_that_was_stopped_goes_on_where_it_was(tmp_path: Path) -> None:
    source = sequence_of(puffs(tmp_path / "in"))
    out = tmp_path / "out"

    def run(control: Control) -> Imported:
        return read_matter(source, out, transfer="smoke", control=control)

    whole = run(Control())
    names = {file.name: file.read_bytes() for file in out.iterdir()}
    assert len(names) == 6
    for stop_after in (1, 3, 4):
        shutil.rmtree(out)
        stopping = _Stopping(out, stop_after)
        with pytest.raises(Cancelled):
            run(stopping)
        kept = {file: file.stat().st_mtime_ns for file in out.iterdir()}
        assert len(kept) >= stop_after
        assert len(kept) < 6
        assert run(Control()).medium == whole.medium
        assert {file.name for file in out.iterdir()} == set(names)
        assert all(file.stat().st_mtime_ns == time for file, time in kept.items())


class _Stopping(Control):
    """Cancels itself once there are so many files."""

    def __init__(self, folder: Path, count: int) -> None:
        super().__init__()
        self._folder, self._count = folder, count

    def check(self) -> None:
        if self._folder.is_dir() and len(list(self._folder.glob("*.vdb"))) >= self._count:
            self.cancel()
        super().check()


def test_other_content_has_other_names(tmp_path: Path) -> None:
    first = puffs(tmp_path / "in")
    source = sequence_of(first)
    sources = dict(source.frames)
    before = sequence.read_frames(sources, tmp_path / "out", "puff", 0, Options())
    same = sequence.read_frames(sources, tmp_path / "out", "puff", 0, Options())
    assert same.files == before.files
    grid = plume()
    write_grids(frame_file(first, 3), grid.with_values(grid.values * 9))
    after = sequence.read_frames(sources, tmp_path / "out", "puff", 0, Options())
    assert not set(after.files) & set(before.files)
    assert after.about.high > before.about.high
    del sources[3]
    fewer = sequence.read_frames(sources, tmp_path / "out", "puff", 0, Options())
    assert not set(fewer.files) & {*after.files, *before.files}


def test_a_sequence_without_matter_is_refused(tmp_path: Path) -> None:
    for frame in FRAMES:
        empty_file(tmp_path / f"void_{frame:04d}.vdb")
    source = sequence_of(tmp_path / "void_0002.vdb")
    with pytest.raises(InputError, match="every frame of void is empty; expected matter"):
        sequence.read_frames(source.frames, tmp_path / "out", "void", 0, Options())
    assert not list((tmp_path / "out").iterdir())


def test_a_damaged_frame_is_named_and_nothing_is_left(
    scene: bpy.types.Scene, tmp_path: Path
) -> None:
    first = puffs(tmp_path / "in")
    damaged = frame_file(first, 4)
    damaged.write_bytes(damaged.read_bytes()[:-200])
    before = set(scene.objects)
    with pytest.raises(RuntimeError, match=r"puff_0004\.vdb is cut off or damaged"):
        bpy.ops.volillum.import_volume(filepath=str(first), transfer="smoke")
    assert set(scene.objects) == before
    assert not (tmp_path / "out").exists()
