"""The command line stopped or killed in the middle: what stays, and that it goes on from there."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

from command_line import ENVIRONMENT, session, start


def test_interrupting_a_bake_is_status_130_and_leaves_nothing(made: Path, tmp_path: Path) -> None:
    # Some minutes of work, in kernels that hold the main thread.
    child = start(
        made, "bake", "plume.blend", "--model", "spherical_harmonics", "--set", "directions=4096",
        "--set", "near=64", "-o", str(tmp_path / "out"), "--progress-seconds", "0.1",
    )  # fmt: skip
    assert child.stderr is not None
    for line in child.stderr:
        if "sweeping" in line:
            break
    begin = time.monotonic()
    child.send_signal(signal.SIGINT)
    out, err = child.communicate(timeout=60)
    assert child.returncode == 130
    assert out == ""
    assert err.splitlines()[-1] == "volillum: cancelled"
    # Kernels poll every few milliseconds of work; leaving Blender takes the rest.
    assert time.monotonic() - begin < 20
    assert list((tmp_path / "out").glob("**/*")) == []


def test_a_killed_range_of_frames_resumes(made: Path, tmp_path: Path) -> None:
    folder = tmp_path / "out"
    call = [
        "bake", "turning.blend", "--model", "multidirectional_occlusion", "--frames", "1-3",
        "--set", "directions=4096", "-o", str(folder),
    ]  # fmt: skip
    code = (
        "import bpy\n"
        "bpy.ops.wm.open_mainfile(filepath='plume.blend')\n"
        "sun = next(o for o in bpy.context.scene.objects if o.type == 'LIGHT')\n"
        "for frame in (1, 3):\n"
        "    sun.rotation_euler[0] += 0.2\n"
        "    sun.keyframe_insert('rotation_euler', frame=frame)\n"
        "bpy.ops.wm.save_as_mainfile(filepath='turning.blend')\n"
    )
    subprocess.run(
        [sys.executable, "-c", code], cwd=made, env=ENVIRONMENT, check=True, capture_output=True
    )
    child = start(made, *call)
    assert child.stdout is not None
    said = json.loads(child.stdout.readline())  # the first frame is there
    child.kill()
    child.communicate()
    (whole,) = folder.glob("*.vdb")
    assert str(whole) == said["path"]
    before = whole.stat().st_mtime_ns
    (result,) = session(made, call)
    assert result.status == 0, result.err
    found = [json.loads(line)["found"] for line in result.out.splitlines()]
    assert found[0]
    assert len(found) == 3 == len(list(folder.iterdir()))  # no temporary is left
    assert whole.stat().st_mtime_ns == before


def test_a_killed_comparison_is_resumed_and_loses_nothing(made: Path) -> None:
    asked = ["compare", "plume.blend", "--models", "ambient_occlusion", "--width", "16",
             "--samples", "2", "--seconds", "0.1", "--baselines", "1", "-o", "killed"]  # fmt: skip
    killed, parts = made / "killed", made / "killed" / "parts"
    process = start(made, *asked)
    while len(list(parts.glob("*.npz"))) < 4:
        assert process.poll() is None, process.communicate()
        time.sleep(0.02)
    process.kill()
    process.communicate()
    assert not (killed / "report.json").exists()
    before = {path.name: path.read_bytes() for path in parts.glob("*.npz")}
    elsewhere, others, finer, more, resumed, again = session(
        made,
        ["compare", "other.blend", "--resume", "-o", "killed"],
        ["compare", "--resume", "--models", "half_angle", "-o", "killed"],
        ["compare", "--resume", "--samples", "64", "-o", "killed"],
        ["compare", "--resume", "--thorough", "-o", "killed"],
        ["compare", "--resume", *asked[2:]],
        ["compare", "--resume", "-o", "killed"],
    )
    assert elsewhere.status == others.status == finer.status == more.status == 1
    assert "the file to resume with is" in elsewhere.line
    assert others.line == (
        "the models to resume with is ['half_angle']; expected ['ambient_occlusion'] (killed)"
    )
    # A default that is asked for is asked for all the same.
    assert finer.line == "the samples to resume with is 64; expected 2 (killed)"
    assert more.line == "the baselines to resume with is 1024; expected 1 (killed)"
    assert resumed.status == 0, resumed.err
    assert resumed.out.splitlines()[-1] == str(Path("killed") / "report.html")
    report = json.loads((killed / "report.json").read_text())
    assert [model["id"] for model in report["models"]] == ["ambient_occlusion"]
    assert report["scene"]["width"] == 16
    assert {entry["samples"] for entry in report["baselines"]} == {1}
    # What was done is as it was, but for a reference's tally that had not all its seeds yet.
    for name, held in before.items():
        assert name.startswith("reference") or (parts / name).read_bytes() == held
    assert again.status == 1
    assert again.line == (
        "the comparison in killed is a finished one; expected an unfinished one for --resume"
    )


def test_another_unfinished_comparison_is_noted(made: Path) -> None:
    held = made / "noted"
    held.mkdir()
    (held / "unfinished.json").write_text('{"file": "elsewhere.blend"}')
    (refused,) = session(made, ["compare", "plume.blend", "--width", "2", "-o", "noted"])
    note, complaint = refused.err.splitlines()
    assert note.startswith("note: noted holds an unfinished comparison that was asked for")
    assert "width is 2" in complaint
    # What is refused takes nothing's place.
    assert json.loads((held / "unfinished.json").read_text()) == {"file": "elsewhere.blend"}
