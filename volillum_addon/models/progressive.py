"""Photon runs that go on: start, refine, look, refine again, save and continue another day."""

from __future__ import annotations

import time
from collections.abc import Mapping

from ..core.control import Control
from ..core.scene import Scene
from .illuminate import VOID_MARGIN, assembled
from .photon_state import PhotonState
from .registry import get
from .volume import IlluminationVolume

MODEL = "photon_mapping"


def photon_state(
    scene: Scene,
    parameters: Mapping[str, object] | None = None,
    control: Control | None = None,
) -> PhotonState:
    """A new run without passes; `refine` adds them, `PhotonState.load` takes over saved ones."""
    chosen = get(MODEL)
    values = chosen.values(parameters or {})
    chosen.check(scene)
    return PhotonState(scene.trimmed(VOID_MARGIN), values, control)


def refine(
    state: PhotonState, passes: int | None = None, control: Control | None = None
) -> IlluminationVolume:
    """Add passes (None: as the parameters `passes`, `error` and `seconds` say) and return the
    volume of all passes so far. Passes added in parts are those of one run, bit for bit."""
    begin = time.perf_counter()
    if passes is None:
        values = state.values
        state.refine(
            int(values["passes"]), control, float(values["error"]), float(values["seconds"])
        )
    else:
        state.refine(passes, control)
    channels = state.channels()
    seconds = time.perf_counter() - begin
    return assembled(state.scene, MODEL, state.values, channels, seconds)
