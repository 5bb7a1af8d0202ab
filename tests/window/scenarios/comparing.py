"""Comparing: the models' figures against full scattering."""

import sys
from pathlib import Path

import bpy
import numpy as np
from eyes import look, picture
from hand import into_view, key
from sidebar import open_next_panel, press, scroll
from steps import Steps
from user import (
    MODEL,
    choose_model,
    lit_view,
    open_scene,
    package,
    quick,
    running,
    scene,
    settings,
    volumes,
)


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
    yield lambda: running() is not None and running().control.fraction > 0
    yield 0.3
    picture("panel_comparing")
    yield from into_view()
    key("Escape")
    yield lambda: running() is None
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


def errors() -> Steps:
    """One model's errors in the volume, then every model's in a row."""
    yield from open_scene("errors")
    quick()
    yield from lit_view()
    scene().eevee.volumetric_tile_size = "2"
    yield from choose_model(MODEL)
    settings().noise, settings().budget = 30, 5
    yield from open_next_panel("volillum.as_radiance")
    yield from scroll(12)
    yield from press("volillum.show_error(")
    yield lambda: running() is None and settings().stage.way == "ERROR"
    assert package("models.registry").get(MODEL).label in settings().errors
    shown = yield from look()
    assert coloured(shown)[0] > 0.01  # without the sky's light it is too dark
    picture("error_view", "view")
    yield from press("volillum.error_row(")
    yield lambda: running() is None and settings().errors.count("\n") > 3
    row = [each for each in settings().exhibit.objects if each.type == "VOLUME"]
    assert len(row) == len(package("models.registry").MODELS)
    shown = yield from look()
    # Of all models some are too dark and some too bright; errors of 0 would be grey all over.
    assert min(coloured(shown)) > 0.002, coloured(shown)
    picture("error_row", "view")


def coloured(shown: np.ndarray) -> tuple[float, float]:
    """The shares of the view that are blue and red."""
    apart = shown[..., 2] - shown[..., 0]
    return float(np.mean(apart > 0.15)), float(np.mean(apart < -0.15))
