"""How the radiance that a volume scatters depends on where the eye is.

Directions omega are outward, from the shaded point toward the source of the light; v is outward
too, toward the eye. Light that arrives from omega flies along -omega and is scattered along v, so
the scattering angle's cosine is -omega . v: forward scattering (g > 0) is bright toward the light.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core import harmonics
from ..core.camera import Camera
from ..core.errors import bad, number, unit_vector, vector
from ..core.medium import LARGEST_G

Vector3 = tuple[float, float, float]
# A camera, or the outward unit direction toward an eye at infinity.
View = Camera | ArrayLike
# Bands 0 to 2: their harmonics are polynomials of the second degree, a few nodes in a material.
MOMENT_ORDER = 2
MOMENTS = harmonics.count(MOMENT_ORDER)


@dataclass(frozen=True)
class Phase:
    """Light of one direction: 4 pi times the phase function of Henyey and Greenstein (1941),

        (1 - g^2) / (1 + g^2 - 2 g cos)^(3/2),   cos = -omega . v,

    1 for g = 0, so that a term's weight keeps its meaning of F / (4 pi). omega is `direction` for a
    distant light (unit vector toward it) and points to the world `position` of a local one.
    """

    g: float
    direction: Vector3 | None = None
    position: Vector3 | None = None

    def __post_init__(self) -> None:
        object.__setattr__(
            self, "g", number("the phase function's g", self.g, -LARGEST_G, LARGEST_G)
        )
        if (self.direction is None) == (self.position is None):
            found = "nothing" if self.direction is None else "a direction and a position"
            raise bad("the phase function's light", found, "a direction or a position")
        if self.direction is not None:
            toward = unit_vector("the phase function's direction", self.direction)
            object.__setattr__(self, "direction", tuple(toward.tolist()))
        else:
            place = vector("the phase function's position", self.position)  # type: ignore[arg-type]
            object.__setattr__(self, "position", tuple(place.tolist()))

    def values(self, view: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
        """The factor [...] at world points [..., 3] for the directions to the eye [..., 3]."""
        if self.position is not None:
            omega = _normalised(np.asarray(self.position) - points)
        else:
            omega = np.broadcast_to(np.asarray(self.direction), points.shape)
        cosine = -(omega * view).sum(axis=-1)
        g = self.g
        return np.asarray((1 - g**2) * (1 + g**2 - 2 * g * cosine) ** -1.5)

    def native(self) -> tuple[object, ...]:
        """As the native line integral takes it."""
        if self.position is not None:
            return ("position", self.g, self.position)
        return ("direction", self.g, self.direction)


@dataclass(frozen=True)
class Moment:
    """The harmonic Y_lm(-v) of index l (l + 1) + m, up to l = 2 (core/harmonics.py).

    Where channels hold the moments M_lm = integral of L(omega) Y_lm(omega) d omega over outward
    omega, the light scattered toward v is

        L_s(v) = integral of p(-omega . v) L(omega) d omega
               = sum over l of g^l sum over m of M_lm Y_lm(-v),

    because g^l are the eigenvalues of Henyey and Greenstein's p: a term's weight is g^l.
    """

    index: int

    def __post_init__(self) -> None:
        if self.index not in range(MOMENTS):
            raise bad("the moment's index", self.index, f"0 to {MOMENTS - 1}")

    def values(self, view: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
        """The factor [...] at world points [..., 3] for the directions to the eye [..., 3]."""
        basis = harmonics.evaluate(-view.reshape(-1, 3))[:, self.index]
        return np.broadcast_to(basis.reshape(view.shape[:-1]), points.shape[:-1])

    def native(self) -> tuple[object, ...]:
        """As the native line integral takes it."""
        return ("moment", self.index)


Angular = Phase | Moment


def toward_eye(view: View, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Outward unit directions [..., 3] from world points [..., 3] to the eye."""
    if not isinstance(view, Camera):
        direction = unit_vector("the view (outward, toward the eye)", view)
    elif view.orthographic:
        direction = -view.forward
    else:
        return _normalised(view.eye - points)
    return np.broadcast_to(direction, points.shape)


def _normalised(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Unit vectors; the zero vector stays (scattering across, where the source is the point)."""
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(np.divide(vectors, lengths, out=np.zeros_like(vectors), where=lengths > 0))
