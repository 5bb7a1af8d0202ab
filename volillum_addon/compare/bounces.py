"""How many bounces full scattering needs, chosen before (core/orders.py) and checked after."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..core.control import Control
from ..core.medium import Medium
from ..core.orders import lasting_orders
from .metrics import Mask
from .renderer import Renderer

# Share of the scattered light that may be missing beyond the limit.
TAIL = 1e-3
# The fewest that still count as full; and what Cycles allows.
FEWEST, MOST = 16, 1024
# Seeds and samples of the check: the same seeds at both limits share their paths' beginnings, so
# that the difference holds only the late light and few samples do.
CHECK_SEEDS, CHECK_SAMPLES = 4, 4


@dataclass(frozen=True)
class Truncation:
    """What the image gains from half the limit to the limit, relative to its mean, and its noise;
    light beyond the limit is less than that."""

    half: int
    gain: float
    noise: float


def bounce_limit(medium: Medium) -> int:
    """The fewest bounces, a power of two, after which less than TAIL of the light is left."""
    needed = min(float(MOST), lasting_orders(medium, TAIL))
    return int(min(MOST, max(FEWEST, 2 ** math.ceil(math.log2(max(needed, 1))))))


def truncation(renderer: Renderer, bounces: int, mask: Mask, control: Control) -> Truncation:
    """Measure what the last half of the bounces brings, with equal seeds at both limits."""
    half = bounces // 2
    gains = []
    for seed in range(1, CHECK_SEEDS + 1):
        control.check()
        full = renderer.reference(bounces, CHECK_SAMPLES, seed)[mask].sum(dtype=np.float64)
        less = renderer.reference(half, CHECK_SAMPLES, seed)[mask].sum(dtype=np.float64)
        gains.append((full - less) / full)
    spread = float(np.std(gains, ddof=1)) / math.sqrt(CHECK_SEEDS)
    return Truncation(half, float(np.mean(gains)), spread)
