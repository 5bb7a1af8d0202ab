"""A baked illumination: named channels, how they become radiance, and what they cost."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ..core.errors import bad
from ..core.grid import Grid, occupied
from ..core.lights import Light
from ..core.medium import Medium
from .angular import Angular, Moment, View, toward_eye

# A term as the native line integral takes it: planes, weight, and the number of its angular
# dependence.
NativeTerm = tuple[tuple[int, ...], tuple[float, float, float], int | None]


# The channel of a stochastic model that holds the standard error of its in-scattered radiance.
STANDARD_ERROR = "standard_error"


@dataclass(frozen=True)
class Factor:
    """One channel of a volume; `component` picks a part of a vector channel, None takes it whole
    (a scalar channel counts for all three colours)."""

    channel: str
    component: int | None = None


@dataclass(frozen=True)
class RadianceTerm:
    """weight (RGB) times the product of one or two channels, times what the direction of the eye
    makes of it (None: nothing, light is scattered alike to all sides)."""

    factors: tuple[Factor, ...]
    weight: tuple[float, float, float]
    angular: Angular | None = None


@dataclass(frozen=True)
class Cost:
    """What a bake took: seconds of the model's own work, and the process's peak memory; and where
    the model knows it, how far off it is (`relative_standard_error`)."""

    seconds: float = 0.0
    peak_bytes: int = 0
    error_estimate: float | None = None


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

    def as_radiance(self) -> IlluminationVolume:
        """The same radiance under the same lights in one RGB channel, `radiance`, and one more
        (`radiance_1`, ...) for each dependence on the view.

        Negative sums stay, so that they are still clamped after the interpolation: where every term
        has one channel nothing changes but rounding. A product of two channels becomes the
        interpolant of the products, not the product of the interpolants. Other lights need the
        original channels.
        """
        channels, radiance = {}, []
        for index, angular in enumerate(dict.fromkeys(term.angular for term in self.radiance)):
            name = f"radiance_{index}" if index else "radiance"
            channels[name] = self.medium.sigma_t.with_values(self._summed(angular), name)
            radiance.append(RadianceTerm((Factor(name),), (1.0, 1.0, 1.0), angular))
        return replace(self, channels=channels, radiance=tuple(radiance))

    @property
    def needs_view(self) -> bool:
        """Whether the radiance depends on where the eye is."""
        return any(term.angular is not None for term in self.radiance)

    def in_scattered(
        self,
        lights: tuple[Light, ...] | None = None,
        view: View | None = None,
        clamped: bool = True,
    ) -> Grid:
        """In-scattered radiance at the voxels, [i, j, k, 3].

        `lights` relights the channels first (models.illuminate.relight). `view` is a camera or an
        outward direction toward the eye; InputError where the radiance needs one and it is None.
        `clamped` False leaves negative sums negative.
        """
        if lights is not None:
            from .illuminate import relight  # the registry's models import this file

            return relight(self, lights).in_scattered(view=view, clamped=clamped)
        total = np.zeros((*self.medium.sigma_t.shape, 3), np.float32)
        for angular in dict.fromkeys(term.angular for term in self.radiance):
            part = self._summed(angular)
            total += part if angular is None else part * self._seen(angular, view)
        shown = np.maximum(total, 0) if clamped else total
        return self.medium.sigma_t.with_values(shown, "in_scattered")

    def mean_over_views(self) -> Grid:
        """In-scattered radiance averaged over all directions to the eye, [i, j, k, 3]."""
        return self._averaged().in_scattered()

    def mean_over_views_in(self, slab: slice) -> NDArray[np.float32]:
        """The same of a range of i, [slab, j, k, 3], without temporaries of the lattice's size."""
        return np.maximum(self._averaged()._summed(None, slab), 0)

    def _averaged(self) -> IlluminationVolume:
        """With the mean over all directions to the eye as its radiance: a phase function has the
        mean 1, and of the moments only the first has a mean."""
        terms = []
        for term in self.radiance:
            if isinstance(term.angular, Moment):
                if term.angular.index > 0:
                    continue
                red, green, blue = (weight / math.sqrt(4 * math.pi) for weight in term.weight)
                term = replace(term, weight=(red, green, blue))
            terms.append(replace(term, angular=None))
        return self.with_radiance(tuple(terms))

    def _summed(self, angular: Angular | None, slab: slice = slice(None)) -> NDArray[np.float32]:
        """The sum of the terms with this dependence on the eye, without it, [slab, j, k, 3]."""
        total = np.zeros((*self.medium.sigma_t.values[slab].shape[:3], 3), np.float32)
        for term in self.radiance:
            if term.angular == angular:
                product = np.broadcast_to(np.asarray(term.weight, np.float32), (1, 1, 1, 3))
                for factor in term.factors:
                    product = product * self.component(factor)[slab]
                total += product
        return total

    def _seen(self, angular: Angular, view: View | None) -> NDArray[np.float32]:
        """The angular factor at the voxels, [i, j, k, 1]."""
        if view is None:
            raise bad(
                "the view",
                "missing",
                f"a Camera or a direction toward the eye: the radiance of {self.model} depends on "
                "it",
            )
        lattice = self.medium.sigma_t
        factor = np.empty((*lattice.shape, 1), np.float32)
        for i in range(lattice.shape[0]):  # world positions of the whole lattice would be large
            index = np.stack(
                np.meshgrid([i], *map(np.arange, lattice.shape[1:]), indexing="ij"), -1
            )
            points = lattice.to_world(index.astype(np.float64))
            factor[i, ..., 0] = angular.values(toward_eye(view, points), points)[0]
        return factor

    def relative_standard_error(self) -> float | None:
        """RMS of the channel STANDARD_ERROR over that of the radiance averaged over views, where
        there is matter; None without that channel."""
        if STANDARD_ERROR not in self.channels:
            return None
        sigma_t = self.medium.sigma_t
        errors = self.channels[STANDARD_ERROR]
        noise = power = 0.0
        for slab in sigma_t.slabs():
            matter = occupied(sigma_t.values[slab])
            shown = self.mean_over_views_in(slab)[matter].astype(np.float64)
            error = errors.values[slab][matter].astype(np.float64)
            power += float((shown**2).sum()) / 3
            noise += float((error**2).sum()) / errors.channels
        return math.sqrt(noise / power) if power > 0 else 0.0

    def component(self, factor: Factor) -> NDArray[np.float32]:
        """The factor's values, [i, j, k, 1] or [i, j, k, 3]."""
        if factor.channel not in self.channels:
            raise bad("channel", repr(factor.channel), "one of " + ", ".join(self.channels))
        values = self.channels[factor.channel].values
        if values.ndim == 3:
            return values[..., None]
        return values if factor.component is None else values[..., factor.component, None]

    def planes(self) -> tuple[NDArray[np.float32], list[NativeTerm], list[tuple[object, ...]]]:
        """What the native line integral takes: the channels as scalar planes [m, i, j, k], the
        radiance terms over them, and the angular dependences that these count. A whole vector
        channel becomes one term per colour."""
        first: dict[str, int] = {}
        planes: list[NDArray[np.float32]] = []
        for name in dict.fromkeys(f.channel for term in self.radiance for f in term.factors):
            first[name] = len(planes)
            planes.extend(self.channels[name].planes())
        angulars = list(dict.fromkeys(t.angular for t in self.radiance if t.angular is not None))
        terms: list[NativeTerm] = []
        for term in self.radiance:
            seen = None if term.angular is None else angulars.index(term.angular)
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
                terms.append((tuple(indices), (weight[0], weight[1], weight[2]), seen))
        return np.stack(planes), terms, [angular.native() for angular in angulars]
