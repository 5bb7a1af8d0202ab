"""Files are there whole or not at all, whenever a process dies and whatever the disk says."""

from __future__ import annotations

import errno
import resource
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from bake.conftest import import_paths, random_values, volume

from volillum_addon.bake import store, vdb
from volillum_addon.core.errors import InputError
from volillum_addon.core.grid import Grid
from volillum_addon.core.medium import Medium

KILLS = 40
# Forks a writer again and again, and kills it after a random while: from before its first file to
# in the middle of some later one. Says how many kills left a temporary.
KILLER = """
import os, random, signal, sys, time
from pathlib import Path
sys.path[:0] = {path!r}
from bake.conftest import import_paths, random_values, volume
from volillum_addon.bake import layout, store, vdb
from volillum_addon.core.grid import Grid
from volillum_addon.core.medium import Medium
import numpy as np

vdb.openvdb()
folder = Path({folder!r})
grid = Grid(random_values(16, 17, 18), np.eye(4))
given = volume(Medium(grid, grid))
clock, left = random.Random(7), 0
for attempt in range({kills}):
    child = os.fork()
    if child == 0:
        for number in range(1000):
            vdb.write_vdb(given, folder / f"{{attempt}}.{{number}}.vdb")
        os._exit(0)
    time.sleep(clock.uniform(0, 0.12))
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    left += bool(list(folder.glob(".volillum-*")))
    for file in folder.glob("*.vdb"):
        layout.check_whole(file)
print(left)
"""


def small_volume(side: int = 30) -> vdb.IlluminationVolume:
    grid = Grid(random_values(side, side, side), np.eye(4))
    return volume(Medium(grid, grid))


def test_a_killed_writer_leaves_no_partial_file(tmp_path: Path) -> None:
    code = KILLER.format(path=import_paths(), folder=str(tmp_path), kills=KILLS)
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=100, check=False
    )
    assert done.returncode == 0, done.stderr
    # Kills fall into the writing of a file nearly always: else this would test nothing.
    assert int(done.stdout) > KILLS / 4
    files = list(tmp_path.glob("*.vdb"))
    assert len(files) > KILLS / 4
    for file in files:
        vdb.read_vdb(file)
    # The last kills' temporaries go with the next run in this directory.
    vdb.write_vdb(small_volume(4), tmp_path / "next.vdb")
    assert sorted(tmp_path.iterdir()) == sorted([*files, tmp_path / "next.vdb"])


def test_only_abandoned_temporaries_are_removed(tmp_path: Path) -> None:
    abandoned = tmp_path / f"{store.PREFIX}1-00000000{store.SUFFIX}"
    abandoned.write_bytes(b"half a file")
    foreign = tmp_path / "notes.tmp"
    foreign.write_text("mine")
    holder = f"""
import sys
sys.path[:0] = {import_paths()!r}
from pathlib import Path
from volillum_addon.bake import store
with store.replacing(Path({str(tmp_path / "other.vdb")!r})) as temporary:
    print(temporary, flush=True)
    sys.stdin.readline()
    temporary.write_bytes(b"done")
"""
    with subprocess.Popen(
        [sys.executable, "-c", holder], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as other:
        assert other.stdout is not None
        live = Path(other.stdout.readline().strip())
        assert not abandoned.exists()
        with store.replacing(tmp_path / "mine.vdb") as own:
            store.prepare(tmp_path)
            assert live.exists()
            assert own.exists()
            assert str(other.pid) in live.name
            own.write_bytes(b"own")
        other.communicate("go\n")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["mine.vdb", "notes.tmp", "other.vdb"]
    assert (tmp_path / "other.vdb").read_bytes() == b"done"


def test_an_error_leaves_the_old_file(tmp_path: Path) -> None:
    target = tmp_path / "x.vdb"
    target.write_bytes(b"old")

    def interrupted() -> None:
        with store.replacing(target) as temporary:
            temporary.write_bytes(b"new")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert list(tmp_path.iterdir()) == [target]
    assert target.read_bytes() == b"old"


@contextmanager
def full_disk_after(size: int) -> Iterator[None]:
    """Files of this process cannot grow beyond `size` bytes."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.parametrize("size", [0, 100, 4096, 100_000])
def test_full_disk(size: int, tmp_path: Path) -> None:
    """OpenVDB's writer returns as if all were well; the file itself is asked."""
    given = small_volume()
    with pytest.raises(store.StorageError) as caught, full_disk_after(size):
        vdb.write_vdb(given, tmp_path / "x.vdb")
    assert list(tmp_path.iterdir()) == []
    message = str(caught.value)
    assert message.startswith(f"{tmp_path} cannot be written (File too large); expected a direct")
    assert "\n" not in message


def test_full_disk_at_the_flush(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(file: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(store.os, "fsync", full)
    with pytest.raises(store.StorageError, match=r"\(No space left on device\); expected a"):
        vdb.write_vdb(small_volume(4), tmp_path / "x.vdb")
    assert list(tmp_path.iterdir()) == []


def test_directory_that_cannot_be_written(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.touch()
    for directory in (file, file / "below", Path("/proc/volillum")):
        with pytest.raises(InputError, match=r"cannot be written \(.+\); expected") as caught:
            vdb.write_vdb(small_volume(4), directory / "x.vdb")
        assert str(directory) in str(caught.value)
    assert list(tmp_path.iterdir()) == [file]


def test_target_that_is_a_directory(tmp_path: Path) -> None:
    (tmp_path / "x.vdb").mkdir()
    with pytest.raises(store.StorageError, match="cannot be written"):
        vdb.write_vdb(small_volume(4), tmp_path / "x.vdb")
    assert [p.name for p in tmp_path.iterdir()] == ["x.vdb"]


def test_missing_directories_are_made(tmp_path: Path) -> None:
    vdb.write_vdb(small_volume(4), tmp_path / "a" / "b" / "x.vdb")
    assert [p.name for p in (tmp_path / "a" / "b").iterdir()] == ["x.vdb"]
