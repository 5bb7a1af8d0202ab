"""Luminance of linear RGB."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

# Rec. 709, linear light.
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


def luminance(rgb: ArrayLike) -> float:
    """Of one linear colour [3]."""
    return float(LUMINANCE @ np.asarray(rgb, dtype=np.float64))
