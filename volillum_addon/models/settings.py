"""Parameters that several models share."""

from __future__ import annotations

import math

from .model import Parameter, Values

CONE_DIRECTIONS = Parameter(
    "directions",
    64,
    "Directions in the cone: more follow hard edges more closely, time grows in proportion",
    4,
    4096,
)
NEAR_SLICES = Parameter(
    "near",
    4,
    "Slices around each voxel that are integrated exactly: more for hard surfaces, 0 for smoke",
    0,
    64,
    "slices",
)

# Settings of a cone's models from fast to accurate.
CONE_LADDER: tuple[Values, ...] = (
    {"directions": 16, "near": 0},
    {"directions": 16, "near": 4},
    {"directions": 64, "near": 4},
    {"directions": 64, "near": 10},
    {"directions": 256, "near": 10},
)


def cone_theta(default: float) -> Parameter:
    """The half angle of a cone."""
    return Parameter(
        "theta",
        default,
        "Half angle of the cone: wider gives softer shadows",
        math.radians(1),
        math.radians(90),
        "radians",
    )
