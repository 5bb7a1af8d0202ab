"""The state of a progressive photon run: what has been counted so far, to be refined and saved."""

from __future__ import annotations

import math
import mmap
import sys
import time
from pathlib import Path
from typing import TypeGuard

import numpy as np
from numpy.typing import NDArray

from ..core.control import Control
from ..core.errors import InputError, bad
from ..core.grid import Grid
from ..core.lights import EnvironmentLight, Light
from ..core.native import native
from ..core.scene import Scene
from . import photon_file, photon_kernel, photon_lights
from .angular import MOMENTS
from .model import Values
from .photon_part import Part
from .volume import STANDARD_ERROR

# A standard error needs two passes.
LEAST_PASSES = 2
# The largest share of the scatterings that may be left out because photons are given up. One that
# is given up would have scattered about as often again, or more.
MOST_LEFT_OUT = 0.01
# Scalar moments in one vector grid: a material reads at most 15 grids in EEVEE.
PACK = 3


def in_small_pages(shape: tuple[int, ...]) -> NDArray[np.float32]:
    """An array of zeros whose memory is taken bit by bit, as it is filled: large pages, which numpy
    asks for, are half a plane of a small grid, and many planes are begun at once."""
    if sys.platform != "linux":
        return np.zeros(shape, np.float32)
    size = math.prod(shape)
    memory = mmap.mmap(-1, 4 * size, mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
    memory.madvise(mmap.MADV_NOHUGEPAGE)
    return np.frombuffer(memory, np.float32, size).reshape(shape)


def _has_moments(light: Light | None) -> TypeGuard[EnvironmentLight]:
    """Whether the light's unscattered part, in an anisotropic medium, has moments of its own."""
    return light is not None and not photon_lights.has_direction(light)


class PhotonState:
    """A run that can be refined, saved and continued.

    Pass k draws the random numbers of (seed, k), its sums are integers, and passes are added in the
    order of their numbers: a continued run equals an uninterrupted one bit for bit, with any number
    of threads.
    """

    def __init__(self, scene: Scene, values: Values, control: Control | None = None) -> None:
        """`scene` is trimmed; computes the unscattered light."""
        control = control or Control()
        self.scene, self.values = scene, dict(values)
        medium = scene.medium
        self._moments = 1 if medium.g == 0 else MOMENTS
        # Track lengths are deposited on the lattice itself, kernels on a wider one.
        self._margin, floor = (0, 0, 0), 0.0
        self._first_radius = 0.0
        if values["estimate"] == "kernel":
            size = photon_kernel.voxel_size(medium.sigma_t)
            self._first_radius = float(values["radius"]) * size
            self._margin = photon_kernel.padding(medium.sigma_t, self._first_radius)
            floor = photon_kernel.least_majorant(medium.sigma_t)
        traced = photon_kernel.widened_medium(medium, self._margin) if floor else medium
        self._traced = traced.sigma_t.shape
        self._photons = native.Photons(
            traced.sigma_t.planes(), traced.sigma_s.planes(), traced.sigma_t.index_to_world,
            medium.g, floor,
        )  # fmt: skip
        self.parts: list[Part] = []
        lattice = medium.sigma_t
        for index, light in enumerate(scene.lights):
            begin, end = index / len(scene.lights), (index + 1) / len(scene.lights)
            with control.stage(begin, end, f"light {index + 1}"):
                late = medium.g != 0 and _has_moments(light)
                exact = None if late else self._unscattered(light, control)
            source, unit = photon_lights.source(light), photon_lights.unit(light, lattice)
            strength = photon_lights.strength(light, lattice)
            self.parts.append(self._part(light, source, exact, unit, strength))
        if medium.emission is not None:
            assert traced.emission is not None
            source = photon_lights.emission_source(traced.emission)
            self.parts.append(self._part(None, source, None, 1.0, np.ones(3)))

    def _unscattered(self, light: Light, control: Control) -> NDArray[np.float32]:
        """Its mean over directions."""
        directions, near = int(self.values["directions"]), int(self.values["near"])
        return photon_lights.unscattered(light, self.scene.medium, directions, near, control)

    def _part(
        self,
        light: Light | None,
        source: native.PhotonSource,
        unscattered: NDArray[np.float32] | None,
        unit: float,
        strength: NDArray[np.float64],
    ) -> Part:
        plain = (math.prod(self._traced), self._photons.colours(source))
        moments = (plain[0], self._moments - 1, plain[1]) if self._moments > 1 else None
        return Part(
            light,
            source,
            np.zeros(plain, np.float32),
            np.zeros(plain, np.float32),
            None if moments is None else np.zeros(moments, np.int32),
            None if moments is None else np.zeros(moments, np.int32),
            unscattered,
            unit * self._photons.deposit_unit(source, light is None),
            strength,
            self._moments > 1 and light is not None and photon_lights.has_direction(light),
        )

    @property
    def passes(self) -> int:
        """Passes of all parts so far."""
        return min(part.passes for part in self.parts)

    def refine(
        self,
        passes: int,
        control: Control | None = None,
        error: float = 0.0,
        seconds: float = math.inf,
    ) -> None:
        """Add up to `passes` passes; stops earlier at the relative error `error` or after
        `seconds`, but never before LEAST_PASSES passes in all."""
        control = control or Control()
        begin, looked = time.perf_counter(), self.passes
        for done in range(passes):
            number = self.passes
            for index, part in enumerate(self.parts):
                first = (done + index / len(self.parts)) / passes
                last = (done + (index + 1) / len(self.parts)) / passes
                # A cancelled run may have left some parts a pass ahead.
                if part.passes == number:
                    with control.stage(first, last, f"pass {number + 1}"):
                        self._trace(index, part, control)
            if self.passes < LEAST_PASSES:
                continue
            if time.perf_counter() - begin >= seconds:
                return
            # The error falls with the root of the passes: looked at after every eighth more.
            if error > 0 and self.passes >= looked * 9 / 8:
                looked = self.passes
                if self.relative_error(control) <= error:
                    return

    def _radius(self, index: int) -> float:
        """Of a pass's kernel, world units; 0: track lengths."""
        if not self._first_radius:
            return 0.0
        return photon_kernel.radius(self._first_radius, float(self.values["alpha"]), index)

    def _inner[Scalar: np.generic](self, values: NDArray[Scalar], slab: slice) -> NDArray[Scalar]:
        """Values [traced voxels, colours] of the lattice's own voxels, [slab, j, k, colours]."""
        return photon_kernel.inner(values, self.scene.medium.sigma_t.shape, self._margin)[slab]

    def _trace(self, index: int, part: Part, control: Control) -> None:
        tally = self._photons.run(
            part.source, part.sums, part.deviations, part.higher, part.wraps,
            seed=(int(self.values["noise_seed"]) << 16) + index,
            pass_index=part.passes, photons=int(self.values["photons"]),
            unscattered=part.light is None, radius=self._radius(part.passes),
            control=control.native,
        )  # fmt: skip
        part.passes += 1
        part.scatterings += int(tally["scatterings"])
        part.endless += int(tally["endless"])
        # Three standard deviations off their number: what is left out beyond chance.
        known = part.endless - 3 * math.sqrt(part.endless)
        left_out = known * native.most_scatterings / max(part.scatterings, 1)
        if left_out > MOST_LEFT_OUT:
            raise InputError(
                f"at least {left_out / (1 + left_out):.0%} of the light's scatterings would be "
                f"left out after {native.most_scatterings} of each photon; expected at most "
                f"{MOST_LEFT_OUT:.0%}: a less deep medium, or an albedo below 1"
            )

    def channels(self, control: Control | None = None, release: bool = False) -> dict[str, Grid]:
        """In-scattered radiance at unit strength, by light (`photon_mapping.radiance` has their
        names and meaning), and `standard_error`: of the mean over directions of the sum over all
        lights, at their strengths. `release`: the state gives its memory for them, and is of no
        use afterwards."""
        self._need_passes()
        control = control or Control()
        if release:
            del self._photons
        lattice = self.scene.medium.sigma_t
        error = np.empty((1 if self._is_grey() else 3, *lattice.shape), np.float32)
        for slab in lattice.slabs():
            error[:, slab] = np.moveaxis(np.sqrt(self._variance(slab)), -1, 0)
        result: dict[str, Grid] = {}
        for part in self.parts if release else []:
            part.forget("deviations")
        for index, part in enumerate(self.parts):
            suffix = f"_{index}" if index < len(self.scene.lights) else "_emitted"
            if self._moments == 1:
                light = np.empty((part.sums.shape[1], *lattice.shape), np.float32)
                for slab in lattice.slabs():
                    light[:, slab] = np.moveaxis(self._mean(part, slab), -1, 0)
                result["light" + suffix] = lattice.with_planes(light, "light" + suffix)
                for name in ("sums", "unscattered") if release else ():
                    part.forget(name)
                continue
            if part.one_way and part.unscattered is not None:
                name = "direct" + suffix
                result[name] = lattice.with_planes(part.unscattered, name)
            with control.stage(index / len(self.parts), (index + 1) / len(self.parts), "moments"):
                for name, planes in self._packs(part, control, release).items():
                    result[name + suffix] = lattice.with_planes(planes, name + suffix)
        result[STANDARD_ERROR] = lattice.with_planes(error, STANDARD_ERROR)
        return result

    def _packs(self, part: Part, control: Control, release: bool) -> dict[str, NDArray[np.float32]]:
        """Moments of what is not kept apart, [3, i, j, k]: coloured ones in grids of their own,
        scalar ones three to a grid."""
        lattice, colours = self.scene.medium.sigma_t, part.sums.shape[1]
        planes = in_small_pages((self._moments * colours, *lattice.shape))
        # From the end, so that what has been read can be given back.
        for slab in reversed(list(lattice.slabs())):
            for moment in range(self._moments):
                values = np.moveaxis(self._moment(part, moment, slab), -1, 0)
                planes[colours * moment : colours * (moment + 1), slab] = values
            if release:
                part.shorten(math.prod(self._traced[1:]) * (slab.start + self._margin[0]))
        if _has_moments(part.light):
            directions, near = int(self.values["directions"]), int(self.values["near"])
            photon_lights.add_moments(
                part.light, self.scene.medium, directions, near, planes, control
            )
        name = "moment" if colours == 3 else "moments"
        return {
            f"{name}_{first // PACK}": planes[first : first + PACK]
            for first in range(0, len(planes), PACK)
        }

    def _mean(self, part: Part, slab: slice) -> NDArray[np.float32]:
        """The mean over directions at unit strength, [slab, j, k, 1 or 3]."""
        scattered = self._moment(part, 0, slab)
        if part.unscattered is None:
            return scattered
        return np.asarray(scattered + np.moveaxis(part.unscattered[:, slab], 0, -1))

    def _moment(self, part: Part, moment: int, slab: slice) -> NDArray[np.float32]:
        """One moment of the scattered light at unit strength, [slab, j, k, 1 or 3]."""
        scale = part.scale / (int(self.values["photons"]) * part.passes)
        if moment == 0:
            sums = self._inner(part.sums, slab).astype(np.float64)
        else:
            assert part.higher is not None
            assert part.wraps is not None
            sums = self._inner(part.wraps[:, moment - 1], slab).astype(np.float64) * 2.0**32
            sums += self._inner(part.higher[:, moment - 1], slab)
            sums *= native.higher_unit
        return np.asarray((sums * scale).astype(np.float32))

    def relative_error(self, control: Control | None = None) -> float:
        """Root mean square of the standard error over that of the in-scattered radiance (its mean
        over directions), in voxels with matter."""
        self._need_passes()
        for part in self.parts:
            if part.light is not None and part.unscattered is None:
                part.unscattered = self._unscattered(part.light, control or Control())
        noise = power = 0.0
        for slab in self.scene.medium.sigma_t.slabs():
            matter = self.scene.medium.sigma_t.values[slab] > 0
            if matter.ndim == 4:
                matter = matter.any(axis=-1)
            total = np.zeros((int(matter.sum()), 3))
            for part in self.parts:
                total += self._mean(part, slab)[matter].astype(np.float64) * part.strength
            noise += float(np.broadcast_to(self._variance(slab)[matter], total.shape).sum())
            power += float((total**2).sum())
        return math.sqrt(noise / power) if power > 0 else 0.0

    def _is_grey(self) -> bool:
        return all(part.sums.shape[1] == 1 and np.ptp(part.strength) == 0 for part in self.parts)

    def _variance(self, slab: slice) -> NDArray[np.float64]:
        """Squared standard error of the in-scattered radiance, [slab, j, k, 1 or 3]."""
        total = np.zeros(1)
        channels = 1 if self._is_grey() else 3
        for part in self.parts:
            count = part.passes
            deviations = self._inner(part.deviations, slab).astype(np.float64)
            variance = deviations / (count * (count - 1))
            scale = part.scale / int(self.values["photons"]) * part.strength[:channels]
            total = total + variance * scale**2
        return total

    def _need_passes(self) -> None:
        if self.passes < LEAST_PASSES:
            raise bad("the number of passes so far", self.passes, f"at least {LEAST_PASSES}")

    def save(self, path: Path | str) -> None:
        """Write the state, whole or not at all (a temporary file, then renamed)."""
        photon_file.write(path, self.parts, photon_file.fingerprint(self.scene, self.values))

    def load(self, path: Path | str) -> None:
        """Take over the counts that `save` wrote for the same scene and settings.

        Raises InputError for a file that is not such a state, or one of other inputs.
        """
        photon_file.read(path, self.parts, photon_file.fingerprint(self.scene, self.values))
