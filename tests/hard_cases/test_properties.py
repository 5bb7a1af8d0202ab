"""Random media on random lattices under random lights with random parameters keep the laws of the
hard cases: any model in any scene answers within its bounds or refuses in words.

A short run draws the same scenes every time. `make properties` is the long one: more scenes, other
ones each time, drawn from the seed that it prints (VOLILLUM_SEED repeats it).
"""

from __future__ import annotations

import math
import os
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, assume, event, given, note, seed, settings
from hypothesis import strategies as st
from refusals import LIMITS

from volillum_addon.compare import hard_bounds as bounds
from volillum_addon.compare import hard_laws as laws
from volillum_addon.compare.hard_cases import THRIFT, examine
from volillum_addon.compare.hard_scenes import LAMPS, PATTERNS, Eye, HardCase, Lamp, Matter
from volillum_addon.core.errors import InputError
from volillum_addon.models.illuminate import illuminate
from volillum_addon.models.registry import MODELS

# Scenes for each model, of a long run when there are any; and its seed.
SCENES = int(os.environ.get("VOLILLUM_SCENES", "0"))
SEED = int(os.environ.get("VOLILLUM_SEED", "0"))
FEW = 4
PROFILE = settings(
    max_examples=SCENES or FEW,
    derandomize=not SCENES,
    database=None,
    deadline=None,
    print_blob=True,
    # A scene is not built up from small choices, so smaller ones are hardly simpler; what failed
    # is shown as it is.
    phases=(Phase.generate, Phase.shrink) if SCENES else (Phase.generate,),
    suppress_health_check=list(HealthCheck),
)
# What is said of a medium that is too thin for its storage, or has no voxel of its pattern.
EMPTY = "expected some voxel with extinction"
# Sizes are powers of two, so that a change of units alone rounds nothing.
UNITS = st.integers(-20, 20).map(lambda power: 2.0**power)
# Beyond these the eye of the largest scene is farther away than a camera may be.
CHANGES = st.integers(-6, 6).map(lambda power: 2.0**power)


def decades(low: float, high: float) -> st.SearchStrategy[float]:
    """Numbers even on a logarithmic scale."""
    return st.floats(low, high).map(lambda power: 10.0**power)


SHARES = st.one_of(st.sampled_from((0.0, 0.5, 0.999999, 1.0)), st.floats(0, 1))
COLOURS = st.tuples(SHARES, SHARES, SHARES)
# Along axes and diagonals, a touch beside them, and anywhere.
TIES = st.tuples(*[st.sampled_from((-1.0, 0.0, 1e-7, 1.0, 1.0 + 1e-7))] * 3)
ANYWHERE = st.tuples(*[st.floats(-1, 1)] * 3)
DIRECTIONS = st.one_of(TIES, ANYWHERE).filter(lambda v: math.hypot(*v) > 0.1)


@st.composite
def lattices(draw: st.DrawFn) -> tuple[tuple[float, float, float], ...]:
    """World vectors of the index axes: turned, sheared, oblong, mirrored, of any size."""
    size, lengths = draw(UNITS), [draw(decades(-0.7, 0.7)) for _ in range(3)]
    spin, _ = np.linalg.qr(np.array([draw(DIRECTIONS) for _ in range(3)]) + 1e-3 * np.eye(3))
    shear = np.eye(3)
    shear[0, 1], shear[0, 2], shear[1, 2] = (draw(st.floats(-0.7, 0.7)) for _ in range(3))
    axes = draw(st.sampled_from((np.eye(3), spin))) @ shear @ np.diag(lengths) * size
    axes[:, 0] *= draw(st.sampled_from((1, -1)))
    return tuple(tuple(float(x) for x in column) for column in axes.T)


MATTER = st.builds(
    Matter,
    shape=st.tuples(*[st.integers(1, 8)] * 3),
    pattern=st.sampled_from(PATTERNS),
    depth=decades(-8, 6),
    albedo=st.one_of(SHARES, COLOURS),
    colour=st.one_of(st.just(1.0), COLOURS.filter(any)),
    g=st.one_of(st.just(0.0), st.floats(-0.9, 0.9)),
    glow=st.one_of(st.just(0.0), decades(-2, 3)),
    spike=decades(0, 6),
    wave=st.tuples(*[st.sampled_from((0.0, 1.0))] * 3),
    axes=lattices(),
    half=st.booleans(),
)
LIGHTS = st.lists(
    st.builds(
        Lamp,
        kind=st.sampled_from(LAMPS),
        strength=st.one_of(decades(-3, 3), COLOURS.filter(any)),
        toward=DIRECTIONS,
        angle=st.one_of(st.just(0.0), st.floats(0.01, 180)),
        at=st.tuples(*[st.floats(-20, 20)] * 3),
        pixels=st.integers(1, 8),
        sun=st.one_of(decades(-2, 5), st.just(-1.0)),
    ),
    min_size=1,
    max_size=3,
)
PARAMETERS = st.fixed_dictionaries(
    {},
    optional={
        "theta": st.floats(0.02, math.pi / 2),
        "directions": st.integers(4, 100),
        "near": st.integers(0, 12),
        "spacing": st.floats(0.5, 2),
        "beta": decades(-2, 4),
        "order": st.integers(0, 3),
        "window": st.sampled_from(("none", "hanning", "lanczos")),
        "weight_p": st.integers(0, 2),
        "opacity": st.sampled_from(("bounded", "linear")),
        "neighbourhood": st.sampled_from(("sphere", "hemisphere")),
        "bleeding": SHARES,
        "alpha": st.floats(0.05, 1),
        "estimate": st.sampled_from(("track_length", "kernel")),
        "noise_seed": st.integers(0, 1000),
    },
)
CASES = st.builds(
    HardCase,
    id=st.just("random"),
    hard=st.just("anything"),
    holds=st.just("all laws"),
    medium=MATTER,
    lights=LIGHTS.map(tuple),
    camera=st.builds(
        Eye, at=st.tuples(*[st.floats(-60, 60)] * 3), orthographic=st.booleans()
    ).filter(lambda eye: math.hypot(*eye.at) > 20),
    parameters=PARAMETERS,
)


@pytest.mark.parametrize("model", MODELS)
@PROFILE
@seed(SEED)
@given(case=CASES)
def test_any_scene_keeps_the_laws(model: str, case: HardCase) -> None:
    cell = examine(case, MODELS[model])
    note(repr(cell))
    event(cell.status)
    assert cell.status != "broken", cell.reason
    if cell.status == "refused":
        assert any(limit in cell.reason for limit in (*LIMITS, EMPTY)), cell.reason


@pytest.mark.parametrize("model", MODELS)
@PROFILE
@seed(SEED)
@given(case=CASES, unit=CHANGES)
def test_units_of_length_do_not_matter(model: str, case: HardCase, unit: float) -> None:
    # Of 16 bits the range ends, whose ends are of some unit.
    case = replace(case, medium=replace(case.medium, half=False))
    other = replace(case, medium=in_units(case.medium, unit))
    known = {parameter.name for parameter in MODELS[model].parameters}
    values = {name: value for name, value in THRIFT.items() if name in known}
    values |= case.given(MODELS[model])
    found = []
    for each in (case, other):
        scene = each.scene()
        try:
            volume = illuminate(scene, model, values)
            found.append(bounds.radiance(volume, scene.camera))
        except InputError as refusal:
            event("refused")
            found.append(str(refusal))
    one, two = found
    if isinstance(one, str) or isinstance(two, str):
        # Lengths stand in the words.
        assert isinstance(one, str), two
        assert isinstance(two, str), one
        return
    assume(one.any())
    assert bounds.rms(one - two) <= laws.ROUNDING * bounds.rms(one)


def in_units(matter: Matter, unit: float) -> Matter:
    """The same matter, measured in another unit of length."""
    axes = tuple(tuple(unit * x for x in axis) for axis in matter.axes)
    return replace(matter, axes=axes)
