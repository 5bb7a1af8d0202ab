"""How many orders of scattering a medium has: an upper bound, from diffusion.

Light that has scattered n times is a share of at most (albedo * stay)^n, where `stay` is the
probability to scatter again rather than leave. For a slab of optical thickness T diffusion theory
gives its slowest mode 1 - stay = (pi / (T + 2 z))^2 / 3, z = 0.7104 the extrapolation distance (in
mean free paths) of Milne's problem. T is the largest optical depth straight through the volume
along one of its axes, which is thicker than what bounds most of it: a limit that is on the safe
side.
"""

from __future__ import annotations

import math

import numpy as np

from .medium import Medium

MILNE = 0.7104


def lasting_orders(medium: Medium, tail: float) -> float:
    """The order after which less than the share `tail` of the scattered light is left (inf: in a
    medium that neither absorbs nor lets out)."""
    albedo = largest_albedo(medium)
    thickness = max(
        float(medium.sigma_t.values.sum(axis=axis, dtype=np.float64).max())
        * float(medium.sigma_t.voxel_size[axis])
        for axis in range(3)
    )
    # Scattering by g counts as (1 - g) of an isotropic one in diffusion.
    leave = (math.pi / (thickness * (1 - medium.g) + 2 * MILNE)) ** 2 / 3
    stay = min(albedo, 1.0) * math.exp(-leave)
    return math.inf if stay >= 1 else math.log(tail) / math.log(max(stay, 1e-9))


def largest_albedo(medium: Medium) -> float:
    """The largest sigma_s / sigma_t of any voxel and colour."""
    sigma_t, sigma_s = medium.sigma_t.planes(), medium.sigma_s.planes()
    ratio = np.zeros(np.broadcast_shapes(sigma_t.shape, sigma_s.shape))
    np.divide(sigma_s, sigma_t, out=ratio, where=sigma_t > 0)
    return float(ratio.max(initial=0.0))
