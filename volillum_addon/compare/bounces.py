"""How many bounces full scattering needs, chosen before and checked after.

Light that has scattered n times is a share of at most (albedo * stay)^n, where `stay` is the
probability to scatter again rather than leave. For a slab of optical thickness T diffusion theory
gives its slowest mode 1 - stay = (pi / (T + 2 z))^2 / 3, z = 0.7104 the extrapolation distance (in
mean free paths) of Milne's problem. T is the largest optical depth straight through the volume
along one of its axes, which is thicker than what bounds most of it: a limit that is on the safe
side.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..core.control import Control
from ..core.medium import Medium
from .metrics import Mask
from .renderer import Renderer

# Share of the scattered light that may be missing beyond the limit.
TAIL = 1e-3
MILNE = 0.7104
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
    sigma_t = medium.sigma_t.values.astype(np.float64)
    sigma_s = medium.sigma_s.values.astype(np.float64)
    if sigma_t.ndim != sigma_s.ndim:
        sigma_t, sigma_s = (a if a.ndim == 4 else a[..., None] for a in (sigma_t, sigma_s))
    albedo = float(np.max(np.divide(sigma_s, sigma_t, out=np.zeros(sigma_s.shape),
                                    where=sigma_t > 0), initial=0.0))  # fmt: skip
    thickness = max(
        float(sigma_t.sum(axis=axis).max()) * float(medium.sigma_t.voxel_size[axis])
        for axis in range(3)
    )
    # Scattering by g counts as (1 - g) of an isotropic one in diffusion.
    leave = (math.pi / (thickness * (1 - medium.g) + 2 * MILNE)) ** 2 / 3
    stay = min(albedo, 1.0) * math.exp(-leave)
    needed = MOST if stay >= 1 else math.log(TAIL) / math.log(max(stay, 1e-9))
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
