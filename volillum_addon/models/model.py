"""What a model is: its equation, parameters, needs, and how it is solved."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Literal

from ..core.control import Control
from ..core.errors import InputError, bad, choice, number
from ..core.grid import Grid
from ..core.lights import Light, shines
from ..core.medium import LARGEST_G, Medium
from ..core.scene import Scene
from .operator import Operator
from .volume import IlluminationVolume, RadianceTerm

Value = float | int | str
Values = Mapping[str, Value]
Treatment = Literal["represents", "approximates", "ignores"]


@dataclass(frozen=True)
class Parameter:
    """One setting: its default, range or choices, unit, and what it trades."""

    name: str
    default: Value
    description: str
    minimum: float = -math.inf
    maximum: float = math.inf
    unit: str = ""
    choices: tuple[str, ...] = ()

    def check(self, value: object) -> Value:
        """`value` in the parameter's own type and range, or an InputError."""
        if self.choices:
            return choice(self.name, str(value), self.choices)
        checked = number(self.name, value, self.minimum, self.maximum, self.unit)  # type: ignore[arg-type]
        if isinstance(self.default, int):
            if checked != round(checked):
                raise bad(self.name, f"{checked:g}", "a whole number")
            return round(checked)
        return checked


@dataclass(frozen=True)
class Need:
    """How a model treats one feature of a scene, and why, in plain words."""

    feature: str
    treatment: Treatment
    reason: str


@dataclass(frozen=True, eq=False)
class Equation:
    """An operator and the scene that it is solved in, whose lights are all its own."""

    operator: Operator
    scene: Scene


@dataclass(frozen=True)
class Model:
    """One illumination model. See docs/add-a-model.md for what a new one has to bring.

    `operator(values)` is its equation as data; `solve(scene, values, control)` computes the
    channels, grids on the scene's (trimmed) lattice; `radiance(lights, medium, values)` says how
    the channels become in-scattered radiance for given lights.
    `resolve(scene, values)`, where a model has settings whose default follows the scene, puts them
    in; `operator` and `solve` get resolved values.
    `remarks(volume)` tells what a bake found out about its own limits, in plain words.
    `ladder` holds settings from fast to accurate, for measurements of error against time; `quick`
    those for a first look at some 64^3 voxels in a fraction of a second, where they are no rung of
    it (see `first_look`).
    `largest_g` is the largest |g| of a medium that it can serve.
    `averages` tells that its values are means over voxels, not values at their centres.
    `lights` are the kinds of light that it represents; `rebake_on` the scene's parts whose change
    makes its channels stale, `rebake_when(values)` those that some settings add to them.
    """

    id: str
    label: str
    citation: str
    equation: str
    summary: str
    parameters: tuple[Parameter, ...]
    needs: tuple[Need, ...]
    lights: frozenset[str]
    rebake_on: frozenset[str]
    operator: Callable[[Values], Operator]
    solve: Callable[[Scene, Values, Control], dict[str, Grid]]
    radiance: Callable[[tuple[Light, ...], Medium, Values], tuple[RadianceTerm, ...]]
    ladder: tuple[Values, ...] = ()
    quick: Values | None = None
    largest_g: float = LARGEST_G
    averages: bool = False
    resolve: Callable[[Scene, Values], Values] | None = None
    rebake_when: Callable[[Values], frozenset[str]] = lambda values: frozenset()
    remarks: Callable[[IlluminationVolume], tuple[str, ...]] = lambda volume: ()

    def values(self, given: Mapping[str, object]) -> dict[str, Value]:
        """All parameters with `given` applied; refuses unknown names and values out of range."""
        known = {parameter.name: parameter for parameter in self.parameters}
        for name in given:
            if name not in known:
                raise bad(f"{self.id}'s parameter", repr(name), "one of " + ", ".join(known))
        return {name: p.check(given.get(name, p.default)) for name, p in known.items()}

    def resolved(self, scene: Scene, values: Values) -> Values:
        """`values` with what follows the scene put in."""
        return values if self.resolve is None else self.resolve(scene, values)

    def rebakes_on(self, values: Values) -> frozenset[str]:
        """The scene's parts whose change makes a bake with these settings stale."""
        return self.rebake_on | self.rebake_when(values)

    @property
    def first_look(self) -> Values:
        """Settings for a first look: `quick`, or else the ladder's fastest rung."""
        if self.quick is not None:
            return self.quick
        return self.ladder[0] if self.ladder else {}

    def operator_in(self, scene: Scene, values: Values) -> Operator:
        """The model's equation in this scene."""
        return self.operator(self.resolved(scene, values))

    def equations(self, scene: Scene, values: Values) -> tuple[Equation, ...]:
        """What the model solves in this scene; its solution is the sum of theirs."""
        own = replace(scene, lights=self.represented(scene))
        return (Equation(self.operator_in(scene, values), own),)

    def shows_emission(self, values: Values) -> bool:
        """Whether the medium's own emission enters the image."""
        return self.operator(values).image_emission

    def knows_phase(self) -> bool:
        """Whether light scatters by the medium's phase function."""
        return self.operator(self.values({})).lobe == "phase"

    def represented(self, scene: Scene) -> tuple[Light, ...]:
        """The scene's lights that shine and that the model's equation has; the others stay out of
        its bake."""
        return self.known(scene.lights)

    def known(self, lights: tuple[Light, ...]) -> tuple[Light, ...]:
        """Those of the lights that shine and are of the model's kinds."""
        return tuple(light for light in lights if light.kind in self.lights and shines(light))

    def check(self, scene: Scene) -> None:
        """Raise an InputError in plain words when the model cannot serve the scene at all."""
        operator = self.operator(self.values({}))
        glows = scene.medium.emission is not None and operator.source == "lights"
        if not self.represented(scene) and not glows:
            have = ", ".join(sorted({light.kind for light in scene.lights})) or "none"
            wants = ", ".join(sorted(self.lights))
            if any(light.kind in self.lights for light in scene.lights):
                raise InputError(
                    f"no light of the kinds {wants} shines: the scene's are of strength 0; "
                    f"{self.label} needs one that shines"
                )
            raise InputError(
                f"{self.label} knows only lights of the kinds {wants}; the scene has {have}; "
                "expected one of these kinds, or another model"
            )
        if abs(scene.medium.g) > self.largest_g:
            raise InputError(
                f"{self.label} knows media of g from {-self.largest_g:g} to {self.largest_g:g}; "
                f"the scene's has {scene.medium.g:g}; expected such a one, or another model"
            )
        if operator.sees_camera:
            scene.need_camera()
