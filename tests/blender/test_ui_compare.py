"""Comparing through the operator: here, and in a Blender of its own as the interface does it."""

import json
import threading
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import numpy as np
import pytest

from volillum_addon.blender import child, comparing
from volillum_addon.blender.compare_operators import VOLILLUM_OT_compare
from volillum_addon.blender.jobs import Job, Work
from volillum_addon.core.control import Control
from volillum_addon.core.errors import InputError

MODEL = "multidirectional_occlusion"


@pytest.fixture
def small(scene: bpy.types.Scene) -> bpy.types.Scene:
    """As little work as a comparison can be."""
    settings = scene.volillum
    settings.compare_all = False
    settings.model = MODEL
    settings.multidirectional_occlusion.directions = 8
    settings.width, settings.noise, settings.budget = 16, 100, 1
    return scene


def check_result(scene: bpy.types.Scene) -> None:
    """The panel's line is the report's."""
    settings = scene.volillum
    page = Path(settings.report)
    assert page == Path(settings.directory) / "report.html"
    assert page.stat().st_size > 0
    report = json.loads(page.with_name("report.json").read_text())
    (model,) = report["models"]
    (line,) = settings.results
    assert line.model == model["id"] == MODEL
    assert model["parameters"]["directions"] == 8
    assert line.error == pytest.approx(model["errors"]["total"]["relative_rmse"], rel=1e-6)
    assert line.noise == pytest.approx(model["errors"]["total"]["noise"], rel=1e-6)
    assert line.seconds == pytest.approx(model["seconds"]["total"], rel=1e-6)
    assert report["scene"]["width"] == 16


def test_compare_from_a_script(small: bpy.types.Scene) -> None:
    before = [block.session_uid for block in bpy.data.user_map()]
    assert bpy.ops.volillum.compare() == {"FINISHED"}
    check_result(small)
    assert [block.session_uid for block in bpy.data.user_map()] == before


def test_a_blender_whose_cycles_has_no_volumes_is_refused(
    small: bpy.types.Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    comparing.check_cycles.cache_clear()
    comparing.check_cycles()  # this one has them
    comparing.check_cycles.cache_clear()
    empty = np.zeros((4, 4, 4), np.float32)
    monkeypatch.setattr(comparing, "render_image", lambda *_: empty)
    with pytest.raises(RuntimeError, match="renders volumes as empty"):
        bpy.ops.volillum.compare()
    assert not Path(small.volillum.directory).exists()


def beside(scene: bpy.types.Scene) -> Work[Any]:
    """The operator's work beside the interface, as `invoke` prepares it."""
    return VOLILLUM_OT_compare.prepare_beside(SimpleNamespace(), SimpleNamespace(scene=scene))


def test_compare_beside_the_interface(small: bpy.types.Scene) -> None:
    path = bpy.data.filepath
    work = beside(small)
    seen: set[str] = set()
    job = Job("Compare", work)
    while job.state == "running":
        seen.add(job.control.message)
        assert 0 <= job.control.fraction <= 1
        time.sleep(0.05)
    work.finish(job.result())
    check_result(small)
    # Progress came over from the child (a stage may be over before it is looked at), and the open
    # file is what it was.
    assert len(seen - {""}) > 1, seen
    assert bpy.data.filepath == path


def test_cancelling_stops_the_process_beside(small: bpy.types.Scene) -> None:
    small.volillum.budget = 600
    small.volillum.noise = 0.01
    job = Job("Compare", beside(small))
    begin = time.monotonic()
    while "scattering" not in job.control.message:
        assert time.monotonic() - begin < 120
        assert job.state == "running"
        time.sleep(0.05)
    job.cancel()
    begin = time.monotonic()
    while job.state == "running":
        assert time.monotonic() - begin < 30
        time.sleep(0.05)
    assert job.state == "cancelled"
    assert not (Path(small.volillum.directory) / "report.html").exists()


def test_the_childs_complaint_is_our_own() -> None:
    with pytest.raises(InputError, match=r"^nowhere\.blend is not there; expected a \.blend file$"):
        child.run(["bake", "nowhere.blend", "--model", MODEL, "-o", "out"], Control())


def test_a_crash_of_the_child_is_not_taken_for_bad_input() -> None:
    with pytest.raises(RuntimeError, match="ended with status 2"):
        child.run(["nonsense"], Control())


def test_a_child_that_is_cancelled_before_it_starts_ends_soon() -> None:
    control = Control()
    control.cancel()
    begin = time.monotonic()
    with pytest.raises(Exception, match="cancelled"):
        child.run(["models"], control)
    assert time.monotonic() - begin < child.PATIENCE_SECONDS
    assert threading.active_count() < 20
