"""Real orthonormal spherical harmonics, bands 0 to 3, without the Condon-Shortley sign.

Coefficient (l, m) has index l (l + 1) + m; Y_1 is (y, z, x) times sqrt(3 / 4 pi).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

# Bands 0 to 3: the paper's Eq. 12 with n = 3.
LARGEST_ORDER = 3
COUNT = (LARGEST_ORDER + 1) ** 2
WINDOWS = ("none", "hanning", "lanczos")
# Window widths that keep the reconstruction of a half space within -0.05 and 1.05 (Sloan 2008).
HANNING_WIDTH = 6.0
LANCZOS_WIDTH = 4.0


def count(order: int) -> int:
    """Coefficients of bands 0 to `order`."""
    return (order + 1) ** 2


def evaluate(directions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Y_lm at unit vectors [n, 3], as [n, 16]."""
    x, y, z = directions[:, 0], directions[:, 1], directions[:, 2]
    pi = math.pi
    return np.stack(
        [
            np.full_like(x, 0.5 / math.sqrt(pi)),
            math.sqrt(3 / (4 * pi)) * y,
            math.sqrt(3 / (4 * pi)) * z,
            math.sqrt(3 / (4 * pi)) * x,
            math.sqrt(15 / (4 * pi)) * x * y,
            math.sqrt(15 / (4 * pi)) * y * z,
            math.sqrt(5 / (16 * pi)) * (3 * z * z - 1),
            math.sqrt(15 / (4 * pi)) * x * z,
            math.sqrt(15 / (16 * pi)) * (x * x - y * y),
            math.sqrt(35 / (32 * pi)) * y * (3 * x * x - y * y),
            math.sqrt(105 / (4 * pi)) * x * y * z,
            math.sqrt(21 / (32 * pi)) * y * (5 * z * z - 1),
            math.sqrt(7 / (16 * pi)) * z * (5 * z * z - 3),
            math.sqrt(21 / (32 * pi)) * x * (5 * z * z - 1),
            math.sqrt(105 / (16 * pi)) * z * (x * x - y * y),
            math.sqrt(35 / (32 * pi)) * x * (x * x - 3 * y * y),
        ],
        axis=-1,
    )


def per_coefficient(bands: NDArray[np.float64]) -> NDArray[np.float64]:
    """One value a band [4] spread to one a coefficient [16]."""
    return np.repeat(bands, [2 * band + 1 for band in range(LARGEST_ORDER + 1)])


def window(name: str, order: int) -> NDArray[np.float64]:
    """Factors [16] of the coefficients: 0 above `order`, damped by the window below it.

    Hanning: (1 + cos(pi l / 6)) / 2; Lanczos: sinc(l / 4). Band 0 is never touched, so the energy
    stays.
    """
    band = np.arange(LARGEST_ORDER + 1, dtype=np.float64)
    if name == "hanning":
        factors = (1 + np.cos(np.pi * band / HANNING_WIDTH)) / 2
    elif name == "lanczos":
        factors = np.sinc(band / LANCZOS_WIDTH)
    else:
        factors = np.ones_like(band)
    factors[order + 1 :] = 0
    return per_coefficient(factors)


def cap_attenuation(half_angle: float) -> NDArray[np.float64]:
    """Mean of the Legendre polynomial P_l over a cap, for bands 0 to 3 [4].

    Integral of P_l over [c, 1] is (P_{l-1}(c) - P_{l+1}(c)) / (2 l + 1).
    """
    c = math.cos(half_angle)
    if 1 - c < 1e-12:
        return np.ones(LARGEST_ORDER + 1)
    legendre = [1.0, c]
    for band in range(1, LARGEST_ORDER + 1):
        legendre.append(
            ((2 * band + 1) * c * legendre[band] - band * legendre[band - 1]) / (band + 1)
        )
    means = [1.0]
    for band in range(1, LARGEST_ORDER + 1):
        means.append((legendre[band - 1] - legendre[band + 1]) / ((2 * band + 1) * (1 - c)))
    return np.array(means)
