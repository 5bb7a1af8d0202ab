"""Every model in a row: its light, or its error."""

import numpy as np
from eyes import look, picture
from hand import into_view, key, region, view
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


def open_finely_lit(directory: str) -> Steps:
    """The scene as EEVEE draws it, finely enough for several volumes beside each other."""
    yield from open_scene(directory)
    quick()
    yield from lit_view()
    scene().eevee.volumetric_tile_size = "2"


def side_by_side() -> Steps:
    """Every model in a row with its name."""
    yield from open_finely_lit("side_by_side")
    yield from press("volillum.side_by_side(")
    yield lambda: running() is None and settings().stage.way == "ROW"
    row = settings().exhibit.objects
    labels = [each.data.body for each in row if each.type == "FONT"]
    models = package("models.registry").models()
    assert [" ".join(label.split()) for label in labels] == [model.label for model in models]
    assert len([each for each in row if each.type == "VOLUME"]) == len(models)
    # The view has turned from the camera to the row.
    yield from look()
    picture("side_by_side_panel", "view")
    yield from into_view()
    key("n")
    yield lambda: region("UI").width <= 1
    assert columns((yield from look())) == len(models)
    picture("side_by_side", "view")
    key("n")
    yield lambda: region("UI").width > 1
    yield from press("volillum.clear_row(")
    assert volumes() == {"smoke": True}
    assert view().spaces.active.region_3d.view_perspective == "CAMERA"


def columns(shown: np.ndarray) -> int:
    """How many separate things stand beside each other in the middle of the view."""
    middle = shown[len(shown) // 2 - 20 : len(shown) // 2].max(axis=(0, 2))
    lit = np.flatnonzero(middle > np.median(middle) + 0.08)
    return 1 + int(np.count_nonzero(np.diff(lit) > 3))


def errors() -> Steps:
    """One model's errors in the volume, then every model's in a row."""
    yield from open_finely_lit("errors")
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
