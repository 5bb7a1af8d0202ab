"""Time, memory and error of every model at every setting of its ladder, before any of it is done.

From bakes on two coarse grids of the same scene (coarse_run.py), with spacings h_1 > h_2:

    seconds   each stage's own power of the number of voxels, taken from the two grids; and the
              time to store as many bytes as there will be
    bytes     the channels' and the medium's, on as many voxels as there will be
    error     of the image against full scattering after the best-fitting exposure: what is the
              same in every bake is continued linearly in h (to nothing where the model neglects
              nothing), what chance adds by its own power of h

Lengths that follow the grid (Model.resolve) are those of the real grid.
"""

from __future__ import annotations

import math
import tempfile
import time
from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

from ..bake.vdb import write_vdb
from ..core.analysis import Analysis, analysis
from ..core.control import Control
from ..core.errors import InputError
from ..core.scene import Scene
from ..models.composition import GROUPS
from ..models.illuminate import VOID_MARGIN, illuminate
from ..models.model import Model, Value, Values
from ..models.registry import MODELS, get
from ..models.terms import terms
from .coarse_run import Level, Run, baked_voxels, levels
from .expected import Continuation, Expected, expected
from .metrics import relative_noise
from .stopwatch import Lap

# Powers of the number of voxels that a stage can have: none, to a little above in proportion.
LARGEST_POWER = 1.1
# Stages below this many seconds on the finer grid are noise of the clock: in proportion.
CLOCK_SECONDS = 2e-3
# A coarse bake of more seconds (of this machine without other work) is costly: it is not made on
# the coarser grid too, nor where the rung before gained nothing. An expensive one is not made at
# all: its error is that of the last rung times what the last step gained, but no estimator gains
# faster than the root of its work.
COSTLY_SECONDS, EXPENSIVE_SECONDS = 1.0, 3.0
# A rung that lowers the error by less than this share gained nothing.
LEAST_GAIN = 0.02
# A kernel's planes and the channels made from them are in memory together.
COPIES = 2


@dataclass(frozen=True)
class Prediction:
    """One model at one setting. `parameters` are those of the ladder's rung.

    `seconds` of bake and hand-over, `peak_bytes` on top of the loaded scene; `error` is the total
    error after the best exposure and `unexposed` without, `noise` the standard error of the former.
    """

    model: str
    parameters: Values
    seconds: float
    peak_bytes: int
    error: float
    noise: float
    unexposed: float


@dataclass(frozen=True)
class Predictions:
    """What is foreseen for a scene: `entries`, and models that cannot serve it with the `reasons`.

    `noise` is the relative noise of the coarse full scattering, `seconds` what predicting took.
    """

    analysis: Analysis
    entries: tuple[Prediction, ...]
    reasons: dict[str, str]
    noise: float
    seconds: float

    @property
    def frontier(self) -> tuple[Prediction, ...]:
        """The entries that no other beats in both time and error, from fast to accurate."""
        return frontier(self.entries)


def frontier(entries: Iterable[Prediction]) -> tuple[Prediction, ...]:
    """Those that no other beats in both time and error, from fast to accurate."""
    found: list[Prediction] = []
    for entry in sorted(entries, key=lambda each: (each.seconds, each.error)):
        if not found or entry.error < found[-1].error:
            found.append(entry)
    return tuple(found)


class Powers:
    """Each stage's power of the number of voxels; a bake on one grid alone has the last ones."""

    def __init__(self) -> None:
        self._known: dict[tuple[int, str], float] = {}

    def seconds(self, counts: list[int], runs: list[tuple[Run, ...]], voxels: int) -> float:
        """What the runs of one setting, on grids of `counts` voxels, would take on so many."""
        total = 0.0
        for index, run in enumerate(runs[-1]):
            for stage, lap in run.laps.items():
                if len(runs) > 1:
                    earlier = runs[0][index].laps.get(stage, Lap())
                    self._known[index, stage] = _power(earlier, lap, counts[-1] / counts[0])
                power = self._known.get((index, stage), 1.0)
                total += lap.clock * (voxels / counts[-1]) ** power
        return total


def _power(earlier: Lap, later: Lap, ratio: float) -> float:
    if later.clock < CLOCK_SECONDS or earlier.processor <= 0:
        return 1.0
    grown = max(later.processor / earlier.processor, 1.0)
    return min(math.log(grown) / math.log(ratio), LARGEST_POWER)


def predict(scene: Scene, aspect: float = 1.0, control: Control | None = None) -> Predictions:
    """Predict for all registered models, and for compositions of those of which none serves all of
    the scene's lights. `aspect` is the image's width over its height. Raises InputError for a scene
    without a camera, or that no model serves, and Cancelled."""
    control = control or Control()
    scene.need_camera()
    begin = time.perf_counter()
    known = analysis(scene)
    with control.stage(0, 0.4, "full scattering on a coarse grid"):
        grids = levels(scene, aspect, control)
    entries: list[Prediction] = []
    reasons: dict[str, str] = {}
    chosen = candidates(known)
    voxels = baked_voxels(scene)
    rate = _store_rate(grids[-1].scene)
    for index, model in enumerate(chosen):
        with control.stage(
            0.4 + 0.6 * index / len(chosen), 0.4 + 0.6 * (index + 1) / len(chosen), model.label
        ):
            try:
                entries += _of_model(model, scene, grids, voxels, rate, control)
            except InputError as error:
                reasons[model.id] = str(error)
    if not entries:
        raise InputError("; ".join(reasons.values()))
    noise = relative_noise(grids[-1].full, grids[-1].mask)
    return Predictions(known, tuple(entries), reasons, noise, time.perf_counter() - begin)


def candidates(known: Analysis) -> tuple[Model, ...]:
    """The registered models, and compositions in which a model serves what it does best because it
    does not serve all."""
    groups = [group for group, kinds in GROUPS.items() if kinds & known.kinds]
    found = list(MODELS.values())
    if len(groups) < 2:
        return tuple(found)
    able = [
        [model for model in MODELS.values() if GROUPS[group] & known.kinds <= model.lights]
        for group in groups
    ]
    for chosen in product(*able):
        if len({model.id for model in chosen}) > 1 and any(
            not known.kinds <= model.lights for model in chosen
        ):
            found.append(get({g: m.id for g, m in zip(groups, chosen, strict=True)}))
    return tuple(found)


def _of_model(
    model: Model,
    scene: Scene,
    grids: tuple[Level, ...],
    voxels: int,
    rate: float,
    control: Control,
) -> list[Prediction]:
    """Up the ladder, as far as it pays to try; what lies above is continued."""
    found: list[Prediction] = []
    tried: list[tuple[Run, ...]] = []
    exposed: list[Expected] = []
    plain: list[Expected] = []
    equations = model.equations(scene, model.values({}))
    whole = not any(term.differs for each in equations for term in terms(each.operator))
    powers = Powers()
    after, before = Continuation(voxels, whole), Continuation(voxels, whole)
    trimmed = scene.trimmed(VOID_MARGIN)
    for rung in model.ladder or ({},):
        if _is_not_worth_it(found, tried):
            tried.append(tuple(map(continued_run, *tried[-2:])))
            seconds = powers.seconds([grids[-1].voxels], tried[-1:], voxels)
            size = found[-1].peak_bytes // COPIES
            work = _effort(tried[-1]) / max(_effort(tried[-2]), 1e-9)
            exposed.append(exposed[-1].with_more_work(exposed[-2], work))
            plain.append(plain[-1].with_more_work(plain[-2], work))
        else:
            values = model.resolved(trimmed, model.values(rung))
            able, runs = _runs(model, values, grids, control)
            tried.append(runs[-1])
            size = sum(run.channel_bytes for run in runs[-1]) * voxels // able[-1].voxels
            counts = [grid.voxels for grid in able]
            seconds = powers.seconds(counts, runs, voxels)
            pairs = list(zip(able, runs, strict=True))
            exposed.append(after(counts, [expected(grid, run, True) for grid, run in pairs]))
            plain.append(before(counts, [expected(grid, run, False) for grid, run in pairs]))
        found.append(
            Prediction(
                model.id,
                rung,
                seconds + size * rate,
                COPIES * size,
                exposed[-1].error,
                exposed[-1].noise,
                plain[-1].error,
            )
        )
    return found


def _effort(runs: tuple[Run, ...]) -> float:
    return sum(run.effort for run in runs)


def _is_not_worth_it(found: list[Prediction], tried: list[tuple[Run, ...]]) -> bool:
    """Whether the next rung, which costs as many times more as the last one did, is not tried."""
    if len(found) < 2:
        return False
    if any(run.draws > 1 for run in tried[-1]):
        return True  # what more work does to chance is known without trying
    gained = found[-1].error < (1 - LEAST_GAIN) * found[-2].error
    coming = _effort(tried[-1]) * max(1.0, _effort(tried[-1]) / _effort(tried[-2]))
    return coming > (EXPENSIVE_SECONDS if gained else COSTLY_SECONDS)


def continued_run(before: Run, last: Run) -> Run:
    """The run of a rung above: each stage as many times longer as it became before."""
    laps = {}
    for stage, lap in last.laps.items():
        earlier = before.laps.get(stage, lap)
        longer = 1.0
        if lap.clock > CLOCK_SECONDS and earlier.processor > 0:
            longer = max(1.0, lap.processor / earlier.processor)
        laps[stage] = Lap(lap.clock * longer, lap.processor * longer)
    return replace(last, laps=laps)


def _runs(
    model: Model, values: Values, grids: tuple[Level, ...], control: Control
) -> tuple[list[Level], list[tuple[Run, ...]]]:
    """The bakes on the grids, coarse to fine, as far as they are cheap; and a limit that hangs on
    the size of voxels may rule out the coarsest grids. Raises InputError where it rules out all."""
    able, runs = [grids[-1]], [grids[-1].run(model, values, control)]
    if _effort(runs[0]) > COSTLY_SECONDS:
        return able, runs
    for grid in grids[-2::-1]:
        try:
            runs.insert(0, grid.run(model, values, control))
        except InputError:
            break
        able.insert(0, grid)
    return able, runs


def _store_rate(scene: Scene) -> float:
    """Seconds a byte of channels that the hand-over takes."""
    given: dict[str, Value] = {"directions": 8, "near": 0}
    volume = illuminate(scene, "spherical_harmonics", given)
    with tempfile.TemporaryDirectory(prefix="volillum-") as folder:
        begin = time.perf_counter()
        write_vdb(volume, Path(folder) / "rate.vdb")
        seconds = time.perf_counter() - begin
    return seconds / sum(grid.values.nbytes for grid in volume.channels.values())
