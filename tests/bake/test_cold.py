"""Cold bakes: in another process, timed whole, cancelled and failing without a trace."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bake.conftest import import_paths, random_values

from volillum_addon.bake import cold, run, vdb
from volillum_addon.bake.scene_file import write_scene
from volillum_addon.core.control import Cancelled, Control
from volillum_addon.core.errors import InputError
from volillum_addon.core.grid import Grid
from volillum_addon.core.medium import Medium
from volillum_addon.core.scene import Scene

MODEL = "multidirectional_occlusion"
# Enough directions that a bake of this scene takes many seconds: it is to be cancelled.
ENDLESS = {"directions": 4096}


def large(scene: Scene) -> Scene:
    grid = Grid(random_values(96, 96, 96), np.eye(4))
    return replace(scene, medium=Medium(grid, grid))


def test_cold_bake_is_timed_and_found(scene: Scene, tmp_path: Path) -> None:
    timings = cold.cold_bake(scene, MODEL, tmp_path, "cloud", {"directions": 8}, repeats=2)
    assert len(timings) == 2
    for timing in timings:
        parts = (timing.start_up, timing.load, timing.bake, timing.hand_over)
        assert all(part > 0 for part in parts)
        assert sum(parts) < timing.whole < 60
        # A Python with numpy and OpenVDB takes 30 MB at least, whatever this process holds.
        assert timing.peak_bytes > 3e7
        assert 0 <= timing.bake_bytes < timing.peak_bytes
    found = run.bake_file(scene, MODEL, tmp_path, "cloud", {"directions": 8})
    assert found.found
    assert found.seconds_bake == timings[-1].bake
    assert list(tmp_path.iterdir()) == [found.path]
    here = run.bake_file(scene, MODEL, tmp_path / "here", "cloud", {"directions": 8})
    cold_volume, warm_volume = vdb.read_vdb(found.path), vdb.read_vdb(here.path)
    for name, channel in warm_volume.channels.items():
        np.testing.assert_array_equal(cold_volume.channels[name].values, channel.values)


def test_the_child_s_memory_is_its_own(scene: Scene, tmp_path: Path) -> None:
    """ru_maxrss of a child starts at its parent's peak: this one holds 400 MB more."""
    ballast = np.ones(50_000_000)
    (timing,) = cold.cold_bake(scene, MODEL, tmp_path, "cloud", {"directions": 8})
    assert timing.peak_bytes < ballast.nbytes


def test_cancelling_kills_the_child(scene: Scene, tmp_path: Path) -> None:
    control = Control()
    seen: list[float] = []

    def watch() -> None:
        deadline = time.monotonic() + 60
        while control.fraction < 0.01 and time.monotonic() < deadline:
            time.sleep(0.02)
        seen.append(control.fraction)
        control.cancel()

    watcher = threading.Thread(target=watch)
    watcher.start()
    with pytest.raises(Cancelled):
        cold.cold_bake(large(scene), MODEL, tmp_path, "cloud", ENDLESS, control=control)
    cancelled = time.perf_counter()
    watcher.join()
    assert time.perf_counter() - cancelled < 5
    # The child's progress has reached this process.
    assert 0.01 <= seen[0] < 1
    assert list(tmp_path.iterdir()) == []


def test_the_child_ends_with_its_parent(scene: Scene, tmp_path: Path) -> None:
    write_scene(large(scene), tmp_path / "scene.npz")
    code = f"""
import os, subprocess, sys, threading, time
sys.path[:0] = {import_paths()!r}
from volillum_addon.bake import cold
from volillum_addon.bake.scene_file import read_scene
from volillum_addon.core.control import Control
control, start = Control(), subprocess.Popen
def popen(*arguments, **named):
    child = start(*arguments, **named)
    print(child.pid, flush=True)
    return child
def die():
    while control.fraction < 0.01:
        time.sleep(0.02)
    os.kill(os.getpid(), 9)
subprocess.Popen = popen
threading.Thread(target=die).start()
scene = read_scene({str(tmp_path / "scene.npz")!r})
cold.cold_bake(scene, {MODEL!r}, {str(tmp_path / "out")!r}, "cloud", {ENDLESS!r}, control=control)
"""
    parent = subprocess.run(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, text=True, timeout=60, check=False
    )
    assert parent.returncode == -signal.SIGKILL
    child = Path("/proc") / parent.stdout.strip() / "stat"
    deadline = time.monotonic() + 10
    while _runs(child) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not _runs(child)
    (left,) = (tmp_path / "out").iterdir()
    run.bake_file(scene, MODEL, tmp_path / "out", "cloud", {"directions": 8})
    assert not left.exists()


def _runs(stat: Path) -> bool:
    """Whether the process is there and no zombie (proc(5): the state follows the name)."""
    try:
        return stat.read_text().rsplit(")", 1)[1].split()[0] not in "ZX"
    except (FileNotFoundError, ProcessLookupError):
        return False


def test_failures_of_the_child_are_this_process_s(
    scene: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(InputError, match="theta is 9; expected"):
        cold.cold_bake(scene, MODEL, tmp_path, "cloud", {"theta": 9.0})
    monkeypatch.setattr(cold, "CHILD", "volillum_addon.bake.no_such_module")
    with pytest.raises(RuntimeError, match=r"status 1; expected 0: .*no_such_module"):
        cold.cold_bake(scene, MODEL, tmp_path, "cloud")
    assert list(tmp_path.iterdir()) == []


def test_it_starts_from_inside_the_extension(tmp_path: Path) -> None:
    """There the package's parents are Blender's, and stop whoever imports them elsewhere."""
    parents = tmp_path / "bl_ext_like" / "user_default"
    extension = parents / "volillum"
    extension.mkdir(parents=True)
    for folder in (parents.parent, parents, extension):
        (folder / "__init__.py").write_text(
            "import sys\nassert 'cold_child' not in str(sys.orig_argv), 'no Blender'\n"
        )
    package = cold.PACKAGE
    shutil.copytree(package, extension / package.name)
    code = f"""
import sys
sys.path.insert(0, {str(tmp_path)!r})
from bl_ext_like.user_default.volillum.volillum_addon.bake import cold
from bl_ext_like.user_default.volillum.volillum_addon.core.grid import Grid
from bl_ext_like.user_default.volillum.volillum_addon.core.lights import DistantLight
from bl_ext_like.user_default.volillum.volillum_addon.core.medium import Medium
from bl_ext_like.user_default.volillum.volillum_addon.core.scene import Scene
import numpy as np
grid = Grid(np.ones((3, 4, 5)), np.eye(4))
scene = Scene(Medium(grid, grid), (DistantLight((0, 0, 1), 1.0),))
few = {{"directions": 4}}
(timing,) = cold.cold_bake(scene, {MODEL!r}, {str(tmp_path / "out")!r}, "cloud", few)
assert "volillum_addon" not in sys.modules
assert timing.bake > 0
"""
    paths = [path for path in import_paths() if not (Path(path) / package.name).exists()]
    done = subprocess.run(
        [sys.executable, "-P", "-c", code],
        capture_output=True, text=True, timeout=100, check=False,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(paths)},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert len(list((tmp_path / "out").iterdir())) == 1
