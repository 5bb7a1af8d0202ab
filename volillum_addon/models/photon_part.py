"""What photons of one light have brought so far."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..core.native import native


@dataclass(eq=False)
class Part:
    """One light, or the medium's emission, at unit strength.

    `sums` and `deviations` float32 [voxels, colours], and `higher` and `wraps` int32 [voxels, 8
    moments, colours] or None, are the native engine's, of `passes` passes; `unscattered`
    [1 or 9 moments, 1 or 3, i, j, k] is exact, None for the medium's emission; `scale` is the
    in-scattered radiance of one unit of `sums`, times the number of photons. `one_way`: unscattered
    light comes from one direction, and is kept apart where the phase function needs to know.
    `scatterings` of all photons, of which `endless` were given up.
    """

    source: native.PhotonSource
    sums: NDArray[np.float32]
    deviations: NDArray[np.float32]
    higher: NDArray[np.int32] | None
    wraps: NDArray[np.int32] | None
    unscattered: NDArray[np.float32] | None
    scale: float
    strength: NDArray[np.float64]
    one_way: bool
    passes: int = 0
    scatterings: int = 0
    endless: int = 0

    def counts(self) -> dict[str, NDArray[np.generic]]:
        """What passes have summed up, by name."""
        every = {"sums": self.sums, "deviations": self.deviations,
                 "higher": self.higher, "wraps": self.wraps}  # fmt: skip
        return {name: array for name, array in every.items() if array is not None}

    def shorten(self, voxels: int) -> None:
        """Keep the higher moments of the first `voxels` only, and give back the others' memory."""
        for array in (self.higher, self.wraps):
            if array is not None:
                array.resize((voxels, *array.shape[1:]), refcheck=False)
