"""Compositions: each kind of light its own model, and the bakes add.

    sun=multidirectional_occlusion,sky=spherical_harmonics

A composition is a Model like any other, made from registered ones: its equation is the sum of its
parts' equations, each with its own lights; its parameters and channels are the parts', named
`<part>_<name>`. What the medium emits belongs to one part, so that it counts once: the first that
follows all light, or else the first that shows it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import NoReturn, override

import numpy as np

from ..core.control import Control
from ..core.errors import bad
from ..core.grid import Grid
from ..core.lights import Light, shines
from ..core.medium import Medium
from ..core.scene import Scene
from .model import Equation, Model, Need, Value, Values
from .volume import STANDARD_ERROR, Factor, IlluminationVolume, RadianceTerm

# What a composition calls the kinds of light.
GROUPS: dict[str, frozenset[str]] = {
    "sun": frozenset({"distant"}),
    "lamp": frozenset({"point", "spot", "area"}),
    "sky": frozenset({"environment"}),
}
FORM = "sun=ID,lamp=ID,sky=ID (two of them or all three)"


@dataclass(frozen=True)
class Part:
    """One model and the group of lights that it serves; `glows`: the medium's emission too."""

    name: str
    model: Model
    glows: bool

    @property
    def kinds(self) -> frozenset[str]:
        """The kinds of light that it serves and represents."""
        return GROUPS[self.name] & self.model.lights

    def medium(self, medium: Medium) -> Medium:
        """The medium as this part sees it."""
        return medium if self.glows else replace(medium, emission=None)

    def lights(self, lights: tuple[Light, ...]) -> tuple[Light, ...]:
        """Those of its group that shine."""
        kinds = GROUPS[self.name]
        return tuple(light for light in lights if light.kind in kinds and shines(light))

    def scene(self, scene: Scene) -> Scene | None:
        """The scene as this part sees it; None where nothing in it is this part's."""
        lights, medium = self.lights(scene.lights), self.medium(scene.medium)
        if not lights and medium.emission is None:
            return None
        return replace(scene, lights=lights, medium=medium)

    def values(self, values: Values) -> dict[str, Value]:
        """This part's own parameters among the composition's."""
        prefix = f"{self.name}_"
        return {
            name.removeprefix(prefix): value
            for name, value in values.items()
            if name.startswith(prefix)
        }

    def named[Content](self, content: Mapping[str, Content]) -> dict[str, Content]:
        """Names of its own as the composition has them."""
        return {f"{self.name}_{name}": value for name, value in content.items()}


@dataclass(frozen=True)
class Composition(Model):
    """A model made of parts."""

    parts: tuple[Part, ...] = ()

    @override
    def equations(self, scene: Scene, values: Values) -> tuple[Equation, ...]:
        """The parts' equations, each in the part's own scene."""
        found: list[Equation] = []
        for part in self.parts:
            own = part.scene(scene)
            if own is not None:
                found += part.model.equations(own, part.values(values))
        return tuple(found)

    @override
    def shows_emission(self, values: Values) -> bool:
        """Whether the part that the emission belongs to shows it."""
        return any(p.glows and p.model.shows_emission(p.values(values)) for p in self.parts)

    @override
    def knows_phase(self) -> bool:
        """Whether all parts follow the medium's phase function."""
        return all(part.model.knows_phase() for part in self.parts)

    @override
    def check(self, scene: Scene) -> None:
        """Raise an InputError in plain words when a part cannot serve its share of the scene."""
        served = 0
        for part in self.parts:
            own = part.scene(scene)
            # A glow that a part of other lights carries asks nothing of it.
            if own is not None and own.lights:
                part.model.check(own)
                served += 1
        if not served:
            have = ", ".join(sorted({light.kind for light in scene.lights})) or "none"
            raise bad("the lights of a composition", have, f"some for {self.id}")


def compose(assignments: Mapping[str, str], models: Mapping[str, Model]) -> Composition:
    """The composition of registered models by group of lights. Raises InputError."""
    for group, model in assignments.items():
        if group not in GROUPS:
            raise bad("a composition's kind of light", repr(group), "one of " + ", ".join(GROUPS))
        if model not in models:
            raise bad(f"the model of {group}", repr(model), "one of " + ", ".join(models))
        if not GROUPS[group] & models[model].lights:
            knows = ", ".join(sorted(models[model].lights))
            raise bad(f"the model of {group}", model, f"one that knows it ({model}: {knows})")
    if len(assignments) < 2:
        raise bad("a composition's number of parts", len(assignments), f"at least 2: {FORM}")
    chosen = {group: models[assignments[group]] for group in GROUPS if group in assignments}
    carrier = _carrier(chosen)
    parts = tuple(Part(name, model, name == carrier) for name, model in chosen.items())
    return Composition(
        id=",".join(f"{part.name}={part.model.id}" for part in parts),
        label=", ".join(f"{part.name} by {_lowered(part.model.label)}" for part in parts),
        citation="; ".join(dict.fromkeys(part.model.citation for part in parts)),
        equation=" + ".join(part.model.equation for part in parts),
        summary="Each kind of light its own model; the bakes add.",
        parameters=tuple(
            replace(each, name=f"{part.name}_{each.name}")
            for part in parts
            for each in part.model.parameters
        ),
        needs=tuple(
            Need(need.feature, need.treatment, f"{part.name}: {need.reason}")
            for part in parts
            for need in part.model.needs
        ),
        lights=frozenset().union(*(part.kinds for part in parts)),
        rebake_on=frozenset().union(*(part.model.rebake_on for part in parts)),
        rebake_when=partial(_rebake_when, parts),
        operator=_no_operator,
        solve=partial(_solve, parts),
        radiance=partial(_radiance, parts),
        ladder=_ladder(parts),
        quick=_first_look(parts),
        resolve=partial(_resolve, parts),
        remarks=partial(_remarks, parts),
        parts=parts,
    )


def parsed(text: str) -> dict[str, str]:
    """`sun=ID,sky=ID` as a mapping. Raises InputError."""
    assignments: dict[str, str] = {}
    for piece in text.split(","):
        group, equals, model = (side.strip() for side in piece.partition("="))
        if not (group and equals and model) or group in assignments:
            raise bad("a composition", repr(text), FORM)
        assignments[group] = model
    return assignments


def _lowered(label: str) -> str:
    return label[0].lower() + label[1:]


def _carrier(chosen: Mapping[str, Model]) -> str | None:
    """The part to which the medium's emission belongs."""
    rows = {name: model.operator(model.values({})) for name, model in chosen.items()}
    followed = [name for name, row in rows.items() if row.source == "lights"]
    shown = [name for name, row in rows.items() if row.image_emission]
    return next(iter([*followed, *shown]), None)


def _no_operator(values: Values) -> NoReturn:
    raise TypeError("a composition has several equations; expected Model.equations")


def _ladder(parts: tuple[Part, ...]) -> tuple[Values, ...]:
    """All parts from fast to accurate together; a shorter ladder stays on its last rung."""
    rungs = max(len(part.model.ladder) for part in parts)
    ladder = []
    for rung in range(rungs):
        together: dict[str, Value] = {}
        for part in parts:
            own = part.model.ladder
            together |= part.named(own[min(rung, len(own) - 1)] if own else {})
        ladder.append(together)
    return tuple(ladder)


def _first_look(parts: tuple[Part, ...]) -> Values:
    together: dict[str, Value] = {}
    for part in parts:
        together |= part.named(part.model.first_look)
    return together


def _rebake_when(parts: tuple[Part, ...], values: Values) -> frozenset[str]:
    return frozenset().union(*(part.model.rebake_when(part.values(values)) for part in parts))


def _resolve(parts: tuple[Part, ...], scene: Scene, values: Values) -> Values:
    found: dict[str, Value] = dict(values)
    for part in parts:
        found |= part.named(part.model.resolved(scene, part.values(values)))
    return found


def _solve(
    parts: tuple[Part, ...], scene: Scene, values: Values, control: Control
) -> dict[str, Grid]:
    """The parts' channels; STANDARD_ERROR is that of the sum of independent parts."""
    channels: dict[str, Grid] = {}
    noise: list[Grid] = []
    scenes = [(part, part.scene(scene)) for part in parts]
    present = [(part, own) for part, own in scenes if own is not None]
    for index, (part, own) in enumerate(present):
        begin, end = index / len(present), (index + 1) / len(present)
        with control.stage(begin, end, part.name):
            solved = part.model.solve(own, part.values(values), control)
        if STANDARD_ERROR in solved:
            noise.append(solved.pop(STANDARD_ERROR))
        channels |= {name: _renamed(grid, name) for name, grid in part.named(solved).items()}
    if noise:
        channels[STANDARD_ERROR] = _root_sum_square(noise)
    return channels


def _renamed(grid: Grid, name: str) -> Grid:
    return grid.with_values(grid.values, name)


def _root_sum_square(grids: list[Grid]) -> Grid:
    if len(grids) == 1:
        return grids[0]
    wide = any(grid.channels == 3 for grid in grids)
    squares = [
        (grid.values if grid.channels == 3 or not wide else grid.values[..., None]) ** 2
        for grid in grids
    ]
    return grids[0].with_values(np.sqrt(np.sum(np.broadcast_arrays(*squares), axis=0)))


def _radiance(
    parts: tuple[Part, ...], lights: tuple[Light, ...], medium: Medium, values: Values
) -> tuple[RadianceTerm, ...]:
    terms = []
    for part in parts:
        own = tuple(light for light in lights if light.kind in part.kinds)
        if not own and part.medium(medium).emission is None:
            continue
        for term in part.model.radiance(own, part.medium(medium), part.values(values)):
            factors = (replace(f, channel=f"{part.name}_{f.channel}") for f in term.factors)
            terms.append(replace(term, factors=tuple(factors)))
    return tuple(terms)


def _remarks(parts: tuple[Part, ...], volume: IlluminationVolume) -> tuple[str, ...]:
    """What the parts found out about their own limits."""
    notes = []
    for part in parts:
        prefix = f"{part.name}_"
        radiance = tuple(
            replace(term, factors=tuple(_own(factor, prefix) for factor in term.factors))
            for term in volume.radiance
            if term.factors[0].channel.startswith(prefix)
        )
        channels = {
            name.removeprefix(prefix): grid
            for name, grid in volume.channels.items()
            if name.startswith(prefix) or name == STANDARD_ERROR
        }
        own = replace(
            volume,
            model=part.model.id,
            parameters=part.values(volume.parameters),
            medium=part.medium(volume.medium),
            channels=channels,
            radiance=radiance,
        )
        notes += [f"{part.name}: {note}" for note in part.model.remarks(own)]
    return tuple(notes)


def _own(factor: Factor, prefix: str) -> Factor:
    return replace(factor, channel=factor.channel.removeprefix(prefix))
