"""Comparing: the models' figures against full scattering."""

import sys
from pathlib import Path

import bpy
from eyes import picture
from sidebar import open_next_panel, press, scroll
from steps import Steps
from user import MODEL, cancel, choose_model, open_scene, package, running, settings, volumes


def comparing() -> Steps:
    """Compare, cancel, compare again: its figures are in the panel, the file is as it was."""
    yield from open_scene("comparing")
    child = package("blender.child")
    command, folder = child.command, Path(child.__file__).parents[2]

    def other_blender(arguments: list[str]) -> tuple[list[str], dict[str, str]]:
        # Debian's Cycles renders no volumes; the tests' own Blender, a module, does.
        environment = command(arguments)[1] | {"PYTHONPATH": str(folder)}
        return [sys.argv[-1], "-P", "-m", "volillum_addon", *arguments], environment

    child.command = other_blender
    yield from choose_model(MODEL)
    chosen = settings()
    chosen.width, chosen.noise, chosen.budget, chosen.compare_all = 16, 100, 1, False
    getattr(chosen, MODEL).directions = 8
    yield from open_next_panel("volillum.as_radiance")
    yield from scroll(6)
    yield from press("volillum.compare(")
    yield from cancel("panel_comparing")
    assert len(settings().results) == 0
    assert not list(Path(settings().directory).rglob("report.*"))
    yield from press("volillum.compare(")
    yield lambda: running() is None and len(settings().results) == 1
    (result,) = settings().results
    assert result.model == MODEL
    assert result.error > 0, result.reason
    assert Path(bpy.path.abspath(settings().report)).is_file()
    assert volumes() == {"smoke": True}
    yield from scroll(6)
    picture("panel_compared")
