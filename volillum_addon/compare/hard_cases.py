"""Every model in every hard scene: does it keep the laws, and how large is its numerical error?"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ..core.control import Cancelled, Control
from ..core.errors import InputError
from ..core.grid import Grid
from ..core.lights import PointLight
from ..core.native import native
from ..core.scene import Scene
from ..models.equation import cost
from ..models.exact import Estimate, exact
from ..models.illuminate import VOID_MARGIN, illuminate
from ..models.model import Model, Value
from ..models.volume import IlluminationVolume
from . import hard_bounds as bounds
from . import hard_laws as laws
from .hard_laws import Finding
from .hard_refined import off_refined
from .hard_scenes import HardCase

Status = Literal["kept", "refused", "broken"]

# What a stochastic model may spend on a scene of a few hundred voxels: in tests, and for the page,
# where the noise is to be small beside other errors.
THRIFT: Mapping[str, Value] = {"photons": 2000, "passes": 8}
PAGE: Mapping[str, Value] = {"photons": 16_000, "passes": 8}
# Voxels that are judged, and the judge's rays at each, of an equation of cost 1.
JUDGED, RAYS, FEWEST_RAYS = 24, 4096, 64
# A cell that takes more processor seconds hangs; how often that is looked at.
PATIENCE, LOOK = 60.0, 0.2
THREADS = 3
# How a grid complains of NaN and infinity.
NOT_FINITE = "expected finite values"
# Points of a voxel at which the judge sees how the solution varies within it.
PLACES = 4
# The judge's replicates: one t value of 7 degrees of freedom passes 8 in 1e-4 of cases, the RMS of
# many passes 4 standard errors of its own far more rarely.
CHANCE = 4.0


@dataclass(frozen=True)
class Cell:
    """One model in one scene.

    `reason`: the refusal, or the laws that are broken. `error` and `bound` as in hard_laws; None
    where they are not known, `remark` then says why.
    """

    case: str
    model: str
    status: Status
    seconds: float
    reason: str = ""
    error: float | None = None
    bound: float | None = None
    remark: str = ""
    findings: tuple[Finding, ...] = ()


def run(
    cases: Sequence[HardCase],
    models: Sequence[Model],
    told: Callable[[Cell], None] = lambda cell: None,
    thrift: Mapping[str, Value] = PAGE,
) -> tuple[Cell, ...]:
    """All cells, case by case; `told` hears of each when it is done."""
    cells = []
    for case in cases:
        for model in models:
            cells.append(examine(case, model, thrift))
            told(cells[-1])
    return tuple(cells)


def examine(case: HardCase, model: Model, thrift: Mapping[str, Value] = THRIFT) -> Cell:
    """One cell. Never raises for what a model does: that is what is examined."""
    begin = time.perf_counter()
    try:
        with patience() as control:
            found = _examined(case, model, thrift, control)
    except InputError as refusal:
        # A grid that refuses what a bake computed is no answer of the model's.
        status: Status = "broken" if NOT_FINITE in str(refusal) else "refused"
        found = Cell(case.id, model.id, status, 0.0, str(refusal))
    except Cancelled:
        found = Cell(
            case.id, model.id, "broken", 0.0, f"not done in {PATIENCE:g} processor seconds"
        )
    except Exception as fault:  # noqa: BLE001 - a crash is a finding
        found = Cell(case.id, model.id, "broken", 0.0, f"{type(fault).__name__}: {fault}")
    return replace(found, seconds=time.perf_counter() - begin)


@contextmanager
def patience() -> Iterator[Control]:
    """A control that is cancelled when the cell hangs."""
    control, done = Control(), threading.Event()
    begin = time.process_time()

    def watch() -> None:
        while not done.wait(LOOK):
            if time.process_time() - begin > PATIENCE:
                control.cancel()

    watcher = threading.Thread(target=watch, daemon=True)
    watcher.start()
    try:
        yield control
    finally:
        done.set()
        watcher.join()


def _examined(case: HardCase, model: Model, thrift: Mapping[str, Value], control: Control) -> Cell:
    scene = case.scene()
    trimmed = scene.trimmed(VOID_MARGIN)
    known = {parameter.name for parameter in model.parameters}
    spent = {name: value for name, value in thrift.items() if name in known}
    given = {**spent, **case.given(model)}
    # Lengths that follow the lattice by default stay those of this one.
    given = dict(model.resolved(trimmed, model.values(given)))
    operator = model.operator(given)
    lights = model.represented(trimmed)

    before = native.set_threads(THREADS)
    try:
        volume = illuminate(scene, model.id, given, control)
        native.set_threads(1)
        alone = illuminate(scene, model.id, given, control)
    finally:
        native.set_threads(before)
    found = bounds.radiance(volume, scene.camera)
    scale = _scale(scene, model, found)
    sigma = bounds.rms(bounds.noise(volume)) / scale
    off = off_refined(model, scene, given, THRIFT, found, control)
    estimate = 2 * bounds.rms(off[np.isfinite(off)]) / scale + laws.ROUNDING
    findings = [
        laws.is_finite(found),
        laws.is_not_negative(operator, volume, scene.camera, found),
        laws.is_within(operator, lights, volume, found, estimate * scale),
        laws.has_the_bits_of(volume, alone),
    ]
    one, two = (
        bounds.radiance(illuminate(each, model.id, given, control), each.camera)
        for each in _to_either_side(scene)
    )
    findings.append(laws.is_continuous(one, two, scale, estimate, CHANCE * sigma))
    conserved = laws.conserves(operator, lights, volume, found, estimate)
    findings += [conserved] if conserved else []
    error, bound, remark = _judged(scene, model, given, volume, found, off)
    if error is not None and bound is not None:
        detail = f"error {error:.3g}, estimated {bound:.3g}"
        findings.append(Finding("accurate", error <= bound, detail))
    broken = [f"{each.law}: {each.detail}" for each in findings if not each.holds]
    status: Status = "broken" if broken else "kept"
    return Cell(
        case.id, model.id, status, 0.0, "; ".join(broken), error, bound, remark, tuple(findings)
    )


def _scale(scene: Scene, model: Model, found: NDArray[np.float64]) -> float:
    """The larger of the radiance and of what arrives unoccluded; 1 in the dark."""
    grid = scene.trimmed(VOID_MARGIN).medium.sigma_t
    full = bounds.unoccluded(model.represented(scene), bounds.lattice_points(grid), grid)
    return max(bounds.rms(full), bounds.rms(found)) or 1.0


def _to_either_side(scene: Scene) -> tuple[Scene, Scene]:
    angle = laws.TURN / max(1.0, laws.depth_across(scene.medium))
    return laws.turned(scene, angle), laws.turned(scene, -angle)


def _judged(
    scene: Scene,
    model: Model,
    given: Mapping[str, Value],
    volume: IlluminationVolume,
    found: NDArray[np.float64],
    off: NDArray[np.float64],
) -> tuple[float | None, float | None, str]:
    """Error and bound at voxels in matter and around it, and why there is none."""
    grid = volume.medium.sigma_t
    compared = np.isfinite(off).all(axis=-1)
    index = judged_voxels(volume, model.represented(scene), compared)
    if not len(index):
        return None, None, "every voxel is beside a lamp"
    points = grid.to_world(index.astype(np.float64))
    operator, lights = model.operator(given), model.represented(scene)
    samples = max(FEWEST_RAYS, RAYS // cost(operator))
    closed = bounds.conserved_radiance(operator, lights, volume.medium)
    varies = 0.0

    def judge(places: NDArray[np.float64]) -> Estimate:
        return exact(scene, model.id, places, samples, 0, its_own, **dict[str, Any](given))

    try:
        with patience() as its_own:  # what takes the judge long is no fault of the model's
            if closed is not None:  # no walk needs to be followed
                everywhere = np.broadcast_to(closed, found.shape)[tuple(index.T)]
                truth = Estimate(everywhere, np.zeros(points.shape))
            else:
                truth = judge(points)
                if model.averages:
                    varies = variation(grid, index, truth.value, judge)
    except InputError as refusal:
        return None, None, f"the judge cannot follow: {refusal}"
    except Cancelled:
        return None, None, f"the judge is not done in {PATIENCE:g} processor seconds"
    picked = tuple(index.T)
    full = bounds.rms(bounds.unoccluded(lights, points, grid))
    scale = max(bounds.rms(truth.value), full) or 1.0
    baked = found[picked]
    own = np.broadcast_to(bounds.noise(volume), found.shape)[picked]
    error = bounds.rms(baked - truth.value) / scale
    # At these voxels, or at all where chance made it small here.
    estimate = (2 * max(bounds.rms(off[picked]), bounds.rms(off[compared])) + varies) / scale
    chance = CHANCE * math.hypot(bounds.rms(truth.standard_error), bounds.rms(own)) / scale
    return error, estimate + chance + laws.ROUNDING + truth.neglected, ""


def variation(
    grid: Grid,
    index: NDArray[np.int64],
    centres: NDArray[np.float64],
    judge: Callable[[NDArray[np.float64]], Estimate],
) -> float:
    """RMS over voxels [n, 3] of the mean distance of the solution within each from that at its
    centre, `centres` [n, 3]."""
    random = np.random.default_rng(1)
    away = np.zeros_like(centres)
    for _ in range(PLACES):
        places = index + random.uniform(-0.5, 0.5, index.shape)
        away += np.abs(judge(grid.to_world(places)).value - centres) / PLACES
    return bounds.rms(away)


def judged_voxels(
    volume: IlluminationVolume,
    lights: Sequence[object],
    compared: NDArray[np.bool_],
    count: int = JUDGED,
) -> NDArray[np.int64]:
    """Up to `count` index positions [n, 3] where `compared` [i, j, k], half of them in matter; none
    within a voxel of a lamp, where 1 / d^2 is stored as its mean over the voxel."""
    grid = volume.medium.sigma_t
    matter = grid.values.reshape(*grid.shape, -1).any(axis=-1)
    random = np.random.default_rng(0)
    allowed = compared.copy()
    points = bounds.lattice_points(grid)
    for light in lights:
        if isinstance(light, PointLight):
            away = np.linalg.norm(points - np.asarray(light.position), axis=-1)
            allowed &= away > 1.5 * float(grid.voxel_size.max())
    chosen: list[NDArray[np.int64]] = []
    for some in (matter & allowed, allowed):
        places = np.argwhere(some)
        if len(places):
            chosen.append(places[random.permutation(len(places))[: count // 2]])
    return np.concatenate(chosen) if chosen else np.zeros((0, 3), np.int64)
