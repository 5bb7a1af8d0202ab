"""The command line: what it prints, its exit status, one line for bad input and nothing written."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from command_line import ENVIRONMENT, Result, session
from plumes import plume

from volillum_addon.bake.grids import to_vdb
from volillum_addon.bake.openvdb_module import openvdb
from volillum_addon.bake.vdb import read_metadata
from volillum_addon.blender import terminal
from volillum_addon.models.registry import MODELS, models

FEW = ["--set", "directions=8"]


def test_models_as_json_are_the_registry_and_need_no_blender(tmp_path: Path) -> None:
    code = (
        "import sys; sys.modules['bpy'] = None\n"
        "from volillum_addon.blender.cli import main\n"
        "sys.exit(main(['models', '--json']))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=tmp_path, env=ENVIRONMENT, capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert done.stderr == ""
    found = json.loads(done.stdout)
    assert [each["id"] for each in found] == list(MODELS)
    for each, model in zip(found, models(), strict=True):
        assert [p["name"] for p in each["parameters"]] == [p.name for p in model.parameters]
        given = {p["name"]: p["default"] for p in each["parameters"]}
        assert model.values(given) == model.values({})
        assert len(each["needs"]) == len(model.needs)


def test_models_as_text_name_every_parameter() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "volillum_addon", "models"],
        env=ENVIRONMENT, capture_output=True, text=True, check=True,
    )  # fmt: skip
    for model in models():
        assert model.id in done.stdout
        for parameter in model.parameters:
            assert f"    {parameter.name} = " in done.stdout


def test_bake_finds_its_own_bakes(made: Path) -> None:
    call = ["bake", "plume.blend", "--model", "spherical_harmonics", *FEW, "-o", "bakes"]
    first, second, other = session(made, call, call, [*call, "--set", "order=1"])
    assert [first.status, second.status, other.status] == [0, 0, 0]
    # Standard output is the file's path alone, whatever Blender says.
    path = Path(first.out.strip())
    assert first.out == second.out == f"{path}\n"
    assert Path(other.out.strip()) != path
    assert "baked in" in first.err
    assert "found" in second.err
    assert "baked in" in other.err
    assert sorted(f"bakes/{each.name}" for each in (made / "bakes").iterdir()) == sorted(
        [str(path), other.out.strip()]
    )
    metadata = read_metadata(made / path)
    assert metadata["model"] == "spherical_harmonics"
    assert metadata["parameters"]["directions"] == 8


def test_each_kind_of_light_may_have_its_own_model(made: Path) -> None:
    pair = "sun=multidirectional_occlusion,sky=spherical_harmonics"
    few = ["--set", "sun_directions=8", "--set", "sky_directions=8"]
    (result,) = session(made, ["bake", "plume.blend", "--model", pair, *few, "-o", "pairs"])
    assert result.status == 0, result.err
    metadata = read_metadata(made / result.out.strip())
    assert metadata["model"] == pair
    assert metadata["parameters"]["sun_directions"] == 8
    assert {name.partition("_")[0] for name in metadata["channels"]} == {"sun", "sky"}


def test_analyse_says_what_the_scene_needs_and_what_to_bake(made: Path) -> None:
    first, second = session(
        made,
        ["analyse", "plume.blend", "--json", "--error", "50%", "--seconds", "600"],
        ["analyse", "plume.blend"],
    )
    assert (first.status, second.status) == (0, 0), first.err + second.err
    found = json.loads(first.out)
    assert {light["kind"] for light in found["scene"]["lights"]} == {"distant", "environment"}
    assert [each["id"] for each in found["models"]][: len(MODELS)] == list(MODELS)
    for each in found["models"][: len(MODELS)]:
        assert each["reason"] or len(each["settings"]) == max(1, len(MODELS[each["id"]].ladder))
    (answer,) = found["recommendations"]
    assert (answer["error"], answer["seconds"]) == (0.5, 600)
    assert answer["answer"]["error"] <= 0.5
    # In words: every model, what of the scene it leaves out, and an answer to the usual requests.
    for model in models():
        assert model.label in second.out
    assert "ignores environment light" in second.out
    assert second.out.count("\nfor error up to") == 5


BAD_INPUT = {
    # First: the file that is open is Blender's own, with a cube.
    "no volume at all": (
        ["bake", "--model", "spherical_harmonics"],
        "the scene is not named; expected SCENE.blend; `volillum scene",
    ),
    "no such file": (["bake", "no.blend", "--model", "spherical_harmonics"], "no.blend is not the"),
    "not a blend": (
        ["bake", "plume.vdb", "--model", "spherical_harmonics"],
        "expected a .blend file; `volillum scene VOLUME",
    ),
    "no such scene": (
        ["bake", "plume.blend", "--scene", "x", "--model", "spherical_harmonics"],
        "scene is 'x'; expected one of plume",
    ),
    "unknown parameter": (
        ["bake", "plume.blend", "--model", "spherical_harmonics", "--set", "theta=1"],
        "spherical_harmonics's parameter is 'theta'; expected one of order",
    ),
    "out of range": (
        ["bake", "plume.blend", "--model", "directional_occlusion", "--set", "theta=2"],
        "theta is 2; expected 0.0174533 to 1.5708 radians",
    ),
    "not a number": (
        ["bake", "plume.blend", "--model", "directional_occlusion", "--set", "theta=wide"],
        "theta is 'wide'; expected a number",
    ),
    "too small an image": (["compare", "plume.blend", "--width", "2"], "width is 2; expected 8"),
    "a volume that is none": (["scene", "calls.json"], "calls.json"),
    "a volume that is missing": (["scene", "no.vdb"], "no.vdb"),
    "a scene that is no blend": (["scene", "plume.vdb", "-o", "out"], "ends in .blend"),
    "a NaN": (["scene", "nan.vdb"], "NaN"),
    "an empty grid": (["scene", "empty.vdb"], "empty.vdb"),
}


@pytest.fixture(scope="module")
def refusals(made: Path) -> dict[str, Result]:
    """All the bad input, in one Blender."""
    broken = plume().values.copy()
    broken[3, 0, 7] = float("nan")
    grid = to_vdb(plume(), "density")
    grid.copyFromArray(plume().values)
    accessor = grid.getAccessor()
    accessor.setValueOn((3, 0, 7), float("nan"))  # copyFromArray would make it background
    openvdb().write(str(made / "nan.vdb"), grids=[grid])
    empty = openvdb().FloatGrid()
    empty.name = "density"
    openvdb().write(str(made / "empty.vdb"), grids=[empty])
    calls = [
        call if "-o" in call else [*call, "-o", "out.blend" if call[0] == "scene" else "out"]
        for call, _ in BAD_INPUT.values()
    ]
    return dict(zip(BAD_INPUT, session(made, *calls), strict=True))


@pytest.mark.parametrize("name", BAD_INPUT)
def test_bad_input_is_one_line_status_1_and_nothing_written(
    made: Path, refusals: dict[str, Result], name: str
) -> None:
    result = refusals[name]
    assert result.status == 1
    assert result.out == ""
    assert BAD_INPUT[name][1] in result.line
    assert not (made / "out").exists()
    assert not (made / "out.blend").exists()
    assert not list(made.glob(".*"))


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["nonsense"],
        ["bake", "x.blend", "-o", "out"],
        ["bake", "x.blend", "--model", "nonsense", "-o", "out"],
        ["bake", "x.blend", "--model", "spherical_harmonics"],
        ["bake", "x.blend", "--model", "spherical_harmonics", "--set", "order", "-o", "out"],
        ["compare", "x.blend", "--models", "spherical_harmonics,nonsense", "-o", "out"],
        ["bake", "x.blend", "--model", "spherical_harmonics", "--frames", "3-1", "-o", "out"],
        ["bake", "x.blend", "--model", "spherical_harmonics", "--frames", "-1", "-o", "out"],
        ["compare", "x.blend", "--samples", "0", "-o", "out"],
        ["compare", "x.blend", "--noise", "-1", "-o", "out"],
        ["scene", "x.vdb", "--preset", "nonsense", "-o", "x.blend"],
    ],
)
def test_wrong_usage_is_status_2(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    from volillum_addon.blender.cli import main

    assert main(arguments) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert "usage: volillum" in captured.err


def test_a_foreign_handler_gives_way_to_the_systems(monkeypatch: pytest.MonkeyPatch) -> None:
    # In a real Blender SIGINT has a handler that Python does not know and so calls None.
    install, installed = signal.signal, []

    def signal_(number: int, handler: Any) -> None:
        install(number, handler)
        installed.append(handler)

    before = signal.getsignal(signal.SIGINT)
    monkeypatch.setattr(signal, "signal", signal_)
    try:
        with terminal.watched("waiting"):
            assert len(installed) == 1
        assert installed[1:] == [signal.SIG_DFL]
    finally:
        install(signal.SIGINT, before)


def test_the_settings_of_the_file_count(made: Path) -> None:
    code = (
        "import bpy, volillum_addon\n"
        "volillum_addon.register()\n"
        "bpy.ops.wm.open_mainfile(filepath='plume.blend')\n"
        "settings = bpy.context.scene.volillum\n"
        "settings.spherical_harmonics.order = 2\n"
        "settings.spherical_harmonics.directions = 8\n"
        "bpy.ops.wm.save_as_mainfile(filepath='set.blend')\n"
    )
    subprocess.run(
        [sys.executable, "-c", code], cwd=made, env=ENVIRONMENT, check=True, capture_output=True
    )
    (result,) = session(
        made, ["bake", "set.blend", "--model", "spherical_harmonics", "-o", "bakes"]
    )
    assert result.status == 0, result.err
    parameters = read_metadata(made / result.out.strip())["parameters"]
    assert (parameters["order"], parameters["directions"]) == (2, 8)


def test_a_range_of_frames_is_a_line_of_json_each(made: Path) -> None:
    call = ["bake", "plume.blend", "--model", "multidirectional_occlusion", *FEW, "-o", "frames"]
    first, again = session(made, [*call, "--frames", "4-6"], [*call, "--frames", "4-6"])
    assert (first.status, again.status) == (0, 0), first.err + again.err
    lines = [json.loads(line) for line in first.out.splitlines()]
    assert [line["frame"] for line in lines] == [4, 5, 6]
    # Nothing moves: one is solved, the others are the same.
    assert [line["found"] for line in lines] == [False, True, True]
    assert len({line["hash"] for line in lines}) == 1
    for line in lines:
        assert read_metadata(made / line["path"])["hash"] == line["hash"]
    assert all(json.loads(line)["found"] for line in again.out.splitlines())
