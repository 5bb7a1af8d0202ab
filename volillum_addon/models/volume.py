"""A baked illumination: named channels, how they become radiance, and what they cost."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ..core.errors import bad
from ..core.grid import Grid
from ..core.medium import Medium


@dataclass(frozen=True)
class Factor:
    """One channel of a volume; `component` picks a part of a vector channel, None takes it whole
    (a scalar channel counts for all three colours)."""

    channel: str
    component: int | None = None


@dataclass(frozen=True)
class RadianceTerm:
    """weight (RGB) times the product of one or two channels."""

    factors: tuple[Factor, ...]
    weight: tuple[float, float, float]


@dataclass(frozen=True)
class Cost:
    """What a bake took: seconds of the model's own work, and the process's peak memory."""

    seconds: float = 0.0
    peak_bytes: int = 0


@dataclass(frozen=True, eq=False)
class IlluminationVolume:
    """Baked channels on the lattice of `medium`.

    In-scattered radiance is max(0, sum of the radiance terms), of channels interpolated first:
    the display material, `in_scattered` and the line integral share this definition.
    """

    model: str
    parameters: Mapping[str, float | int | str]
    medium: Medium
    channels: Mapping[str, Grid]
    radiance: tuple[RadianceTerm, ...]
    image_emission: bool = False
    cost: Cost = field(default_factory=Cost)
    notes: tuple[str, ...] = ()

    def with_radiance(self, terms: tuple[RadianceTerm, ...]) -> IlluminationVolume:
        """The same channels under other lights."""
        return replace(self, radiance=terms)

    def in_scattered(self) -> Grid:
        """In-scattered radiance at the voxels, [i, j, k, 3]."""
        total = np.zeros((*self.medium.sigma_t.shape, 3), np.float32)
        for term in self.radiance:
            product = np.broadcast_to(np.asarray(term.weight, np.float32), (1, 1, 1, 3))
            for factor in term.factors:
                product = product * self.component(factor)
            total += product
        return self.medium.sigma_t.with_values(np.maximum(total, 0), "in_scattered")

    def component(self, factor: Factor) -> NDArray[np.float32]:
        """The factor's values, [i, j, k, 1] or [i, j, k, 3]."""
        if factor.channel not in self.channels:
            raise bad("channel", repr(factor.channel), "one of " + ", ".join(self.channels))
        values = self.channels[factor.channel].values
        if values.ndim == 3:
            return values[..., None]
        return values if factor.component is None else values[..., factor.component, None]

    def planes(
        self,
    ) -> tuple[NDArray[np.float32], list[tuple[tuple[int, ...], tuple[float, float, float]]]]:
        """The channels as scalar planes [m, i, j, k], and the radiance terms over them: what the
        native line integral takes. A whole vector channel becomes one term per colour."""
        first: dict[str, int] = {}
        planes: list[NDArray[np.float32]] = []
        for name in dict.fromkeys(f.channel for term in self.radiance for f in term.factors):
            first[name] = len(planes)
            planes.extend(self.channels[name].planes())
        terms: list[tuple[tuple[int, ...], tuple[float, float, float]]] = []
        for term in self.radiance:
            by_colour = any(
                factor.component is None and self.channels[factor.channel].channels == 3
                for factor in term.factors
            )
            for colour in range(3) if by_colour else (None,):
                indices = []
                for factor in term.factors:
                    wide = self.channels[factor.channel].channels == 3
                    part = factor.component if factor.component is not None else colour
                    indices.append(first[factor.channel] + ((part or 0) if wide else 0))
                weight = np.array(term.weight)
                if colour is not None:
                    weight = weight * (np.arange(3) == colour)
                terms.append((tuple(indices), (weight[0], weight[1], weight[2])))
        return np.stack(planes), terms
