"""What photons of one light have brought so far."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..core.lights import Light
from ..core.native import native


@dataclass(eq=False)
class Part:
    """One light, or the medium's emission, at unit strength.

    `sums` and `deviations` float32 [voxels, colours], and `higher` and `wraps` int32 [voxels, 8
    moments, colours] or None, are the native engine's, of `passes` passes; `light` is None for the
    medium's emission. `unscattered` [1 or 3, i, j, k] is its exact mean over directions, None for
    emission and until it is asked for where channels hold its moments: these are added to the
    photons' at last, so that there is no time at which both are held. `scale` is the in-scattered
    radiance of one unit of `sums`, times the number of photons. `one_way`: unscattered light comes
    from one direction, and is kept apart where the phase function needs to know. `scatterings` of
    all photons, of which `endless` were given up.
    """

    light: Light | None
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

    def forget(self, name: str) -> None:
        """Give back an array's memory."""
        held = getattr(self, name)
        if held is not None:
            setattr(self, name, held[:0].copy())

    def shorten(self, voxels: int) -> None:
        """Keep the moments of the first `voxels` only, and give back the others' memory."""
        for array in (self.sums, self.higher, self.wraps):
            if array is not None:
                array.resize((voxels, *array.shape[1:]), refcheck=False)
