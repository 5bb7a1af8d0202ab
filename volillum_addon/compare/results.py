"""What a comparison found, before it is written anywhere."""

from __future__ import annotations

import statistics
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..core.scene import Scene
from ..models.model import Value
from ..models.published import EQUATION
from .bounces import Truncation
from .errors import ErrorImages
from .flip import Flip
from .metrics import Agreement, Exposure, Figure, Mask
from .reference import Reference
from .renderer import Way


@dataclass(frozen=True)
class Timing:
    """Repeated measurements of one thing, in seconds."""

    seconds: tuple[float, ...]

    @property
    def median(self) -> float:
        """The middle one."""
        return statistics.median(self.seconds)


@dataclass(frozen=True)
class Seconds:
    """What a model takes: a cold process's `bake` (the model's own work), `hand_over` (writing the
    file) and `whole` (from start to end), and one `display` of the file."""

    whole: Timing
    bake: Timing
    hand_over: Timing
    display: Timing

    @property
    def total(self) -> float:
        """From a scene in memory to a picture: bake, hand-over and display."""
        return self.bake.median + self.hand_over.median + self.display.median


@dataclass(frozen=True)
class Saving:
    """What a scene lacks, and how many times as long its bake would take, and as much would be
    stored, if it had that."""

    what: str
    seconds: float
    stored: float


@dataclass(frozen=True, eq=False)
class Measured:
    """Times and errors of a model that serves the scene. A rung of a ladder has no `witness`, no
    `flip`, no error of its field and no `savings`."""

    seconds: Seconds
    peak_bytes: int
    images: ErrorImages
    errors: Mapping[str, Figure]
    exposure: Exposure
    total_after_exposure: Figure
    flip: Flip | None = None
    witness: Agreement | None = None
    savings: tuple[Saving, ...] = ()


@dataclass(frozen=True, eq=False)
class Rung:
    """A model under other settings than the compared ones: `measured`, or the `reason` why not."""

    settings: Mapping[str, Value]
    measured: Measured | None = None
    reason: str | None = None


@dataclass(frozen=True, eq=False)
class BaselineMeasured:
    """Times and errors of path tracing with few samples; `picture` is one of those drawn."""

    seconds: Timing
    picture: NDArray[np.float32]
    total: Figure
    exposure: Exposure
    total_after_exposure: Figure
    flip: Flip


@dataclass(frozen=True, eq=False)
class Baseline:
    """What the user would otherwise render: `measured`, or the `reason` why not."""

    way: Way
    samples: int
    measured: BaselineMeasured | None = None
    reason: str | None = None


@dataclass(frozen=True, eq=False)
class ModelResult:
    """One model with its settings: `measured`, or the `reason` why it cannot serve the scene."""

    id: str
    label: str
    citation: str
    variant: str
    parameters: Mapping[str, Value]
    left_out: tuple[str, ...] = ()
    measured: Measured | None = None
    reason: str | None = None
    ladder: tuple[Rung, ...] = ()

    @property
    def file(self) -> str:
        """The name of its OpenEXR file."""
        return f"{self.id}.exr" if self.variant == EQUATION else f"{self.id}.{self.variant}.exr"


@dataclass(frozen=True, eq=False)
class Comparison:
    """Everything that a report says and shows."""

    name: str
    scene: Scene
    mask: Mask
    single: Reference
    full: Reference
    truncation: Truncation
    models: tuple[ModelResult, ...]
    baselines: tuple[Baseline, ...]
    machine: Mapping[str, object]
    versions: Mapping[str, str]

    @property
    def measured(self) -> tuple[tuple[ModelResult, Measured], ...]:
        """The models that serve the scene."""
        return tuple((m, m.measured) for m in self.models if m.measured is not None)
