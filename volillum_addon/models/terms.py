"""The paper's comparison, read off the operators: how each model's terms differ from the full
volume rendering equation, and what follows numerically.

Everything here is derived from an `Operator`; no model is known by name.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from .operator import Operator

# The volume rendering equation itself (the paper's Eqs. 1 to 3).
FULL = Operator(
    "phase",
    "none",
    "lights",
    order=math.inf,
    rescatter="phase",
    gathers_emission=True,
    image_emission=True,
)


@dataclass(frozen=True)
class Term:
    """One term of an equation: its name, what stands there, and what follows from it ("": as in
    the full equation)."""

    name: str
    here: str
    consequence: str

    @property
    def differs(self) -> bool:
        """Whether it is not the full equation's."""
        return bool(self.consequence)


def terms(operator: Operator) -> tuple[Term, ...]:
    """The operator's terms, in the order of the comparison's columns."""
    return tuple(Term(name, *read(operator)) for name, read in READERS.items())


_AXES = {
    "light": "the direction to the light",
    "view": "the direction to the eye",
    "gradient": "the way out of the surface",
    "none": "any axis",
}


def _phase(operator: Operator) -> tuple[str, str]:
    about = _AXES[operator.axis]
    if operator.lobe == "phase":
        return "Henyey-Greenstein, g of the medium", ""
    even = "the medium's g does not show: no silver lining, no halo"
    if operator.lobe == "sphere":
        return "isotropic", even
    if operator.lobe == "hemisphere":
        return f"even over the half space about {about}", even
    angle = f"{math.degrees(operator.theta):.3g} degrees"
    if operator.lobe == "phong":
        return f"cos^{operator.beta:.3g} in a cone of {angle} about {about}", even
    return f"even in a cone of {angle} about {about}", even


def _directions(operator: Operator) -> tuple[str, str]:
    if operator.lobe in ("phase", "sphere"):
        return "all", ""
    if operator.lobe == "hemisphere":
        return "half of the sphere", "light that comes through the surface is lost"
    if operator.axis == "view":
        return "a cone toward the eye", "shadows follow the camera, not the light; re-bake on moves"
    if operator.split == "luminance":
        return "one to the light, and a cone for hue", "shadows are hard, whatever the light's size"
    return "a cone toward the light", "every light looks as large as the cone; edges need many rays"


def _source(operator: Operator) -> tuple[str, str]:
    if operator.basis is not None:
        order, window = operator.basis
        return (
            f"distant light in harmonics up to band {order} (window: {window})",
            "sharp lights blur and ring; no light inside the medium; new light, no new visibility",
        )
    # A constant over a cone about each light is that light, spread.
    kind = "light" if operator.axis == "light" else operator.source
    return {
        "lights": ("every light as it is", ""),
        "environment": ("distant light", "no light inside the medium"),
        "light": ("each light, spread over the cone", "the sky and large lights are left out"),
        "constant": ("one constant", "where light comes from does not matter"),
    }[kind]


def _attenuation(operator: Operator) -> tuple[str, str]:
    if operator.law == "exp":
        return "exp(-optical depth)", ""
    weight = {2.0: "", 1.0: ", nearer matter counts less along a ray (Eq. 13)"}.get(
        operator.weight_p, f", weight s^{2 - operator.weight_p:.3g}"
    )
    if operator.law == "linear":
        return f"1 - optical depth{weight}", "negative beyond optical depth 1: good for thin media"
    return (
        f"1 - mean opacity{weight}",
        "occluders behind occluders count again; a convolution solves it, and a new transfer "
        "function is a dot product",
    )


def _radius(operator: Operator) -> tuple[str, str]:
    if math.isinf(operator.radius):
        return "all of the medium", ""
    if operator.radius == 0:  # a default that follows the grid
        return "a few voxels", "far shadows are missing"
    return f"within {operator.radius:.3g}", "far shadows are missing"


def _order(operator: Operator) -> tuple[str, str]:
    if operator.order == 1:
        return "1", "too dark inside bright media: no light that scattered before"
    if operator.rescatter == "lobe":
        return (
            "all, into the same cone",
            "no light comes back; one causal sweep solves it",
        )
    return "all", ""


def _emission(operator: Operator) -> tuple[str, str]:
    gathered, shown = operator.gathers_emission, operator.image_emission
    if gathered and shown:
        return "lights the medium, and is seen", ""
    if shown:
        return "is seen", "the medium's own light does not light the medium"
    if gathered:
        return "lights the medium", "fire is dark itself"
    return "none", "fire is dark"


def _colour(operator: Operator) -> tuple[str, str]:
    if operator.split == "luminance":
        return (
            "brightness along the axis, hue from the cone",
            "hard shadows with soft colours; not linear: lights are baked apart",
        )
    if operator.gathers_colour > 0 and operator.order == 1:
        return "colour of the neighbourhood bleeds", "a glow that no light pays for"
    return "RGB throughout", ""


READERS: dict[str, Callable[[Operator], tuple[str, str]]] = {
    "phase function": _phase,
    "directions": _directions,
    "incoming light": _source,
    "attenuation": _attenuation,
    "reach": _radius,
    "scattering orders": _order,
    "emission": _emission,
    "luminance and chroma": _colour,
}
