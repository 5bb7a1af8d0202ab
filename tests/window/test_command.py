"""The command line inside the real Blender: `blender --background FILE --command volillum ...`."""

from __future__ import annotations

import json
import subprocess

from window.system import System

from volillum_addon.models.registry import MODELS

MODEL = "multidirectional_occlusion"


def volillum(system: System, *arguments: str) -> subprocess.CompletedProcess[str]:
    """The command on the scene, which is the open file."""
    return system.blender("/volillum/smoke.blend", "--command", "volillum", *arguments)


def test_models(system: System) -> None:
    done = volillum(system, "models", "--json")
    assert done.returncode == 0, done.stderr
    # Blender talks on standard output too, before and after.
    found, _ = json.JSONDecoder().raw_decode(done.stdout[done.stdout.index("[\n") :])
    assert [model["id"] for model in found] == list(MODELS)


def test_bake_twice(system: System) -> None:
    arguments = ("--model", MODEL, "--set", "directions=8", "-o", "/volillum/command")
    for said in ("baked in", "found, baked before in"):
        done = volillum(system, "bake", *arguments)
        assert done.returncode == 0, done.stdout + done.stderr
        assert f"{MODEL} {said}" in done.stderr
        (baked,) = (system.work / "command").iterdir()
        assert f"/volillum/command/{baked.name}" in done.stdout.splitlines()


def test_bad_input_is_one_line_and_status_1(system: System) -> None:
    done = volillum(system, "bake", "--model", MODEL, "--set", "theta=7", "-o", "/volillum/bad")
    assert done.returncode == 1
    (line,) = [line for line in done.stderr.splitlines() if line.startswith("volillum: ")]
    assert "theta is 7" in line
    assert not (system.work / "bad").exists()


def test_compare_says_at_once_that_this_blender_renders_no_volumes(system: System) -> None:
    # Debian builds its Cycles without them; elsewhere this is a comparison that works.
    done = volillum(system, "compare", "--models", MODEL, "-o", "/volillum/compared")
    assert done.returncode == 1
    (line,) = [line for line in done.stderr.splitlines() if line.startswith("volillum: ")]
    assert "renders volumes as empty" in line
    assert not (system.work / "compared").exists()
