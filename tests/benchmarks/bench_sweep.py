"""Time of the directional sweep beside a copy of the grid, in one run, and its error.

    python tests/benchmarks/bench_sweep.py [--size 256] [--threads 2] [--json]
    python tests/benchmarks/bench_sweep.py --sizes 64 128 256 512

Prints the machine, and nanoseconds per voxel and direction, the ratio to a copy of the grid by as
many threads, and the relative RMS error of what was computed, at random voxels against exact line
integrals through the same smooth medium. Each sweep of one direction takes turns with a copy, and
the ratio is that of their medians: both find the grid as other work leaves it, and what slows the
machine slows both. `copy, repeated` is the best case, which finds the grid where its own last turn
has left it. Copy and sweeps write to existing arrays; `copy, new` and `into a new array` show what
the system's new pages add. Medians of the repeats after a warm-up;
their quartiles are in the JSON output. Beside them one direction as a user would write it
(slice_march.py, one thread). With --sizes, the cost against the size of the grid instead.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray
from slice_march import Shift, march, shift_by_numpy, shift_by_scipy

import volillum_native
from volillum_addon.compare.machine import machine

Directions = NDArray[np.float64]
Volume = NDArray[np.float32]
IDENTITY = np.eye(4)
CONE_HALF_ANGLE = np.radians(30)
OPTICAL_SIDE = 4.0
TILTS = {"straight": (0.0, 0.0), "tilted": (0.35, 0.2), "oblique": (0.8, -0.6)}
ERROR_RAYS = 40_000  # enough for two digits of the RMS; spread over voxels and directions


def unit(vector: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(vector / np.linalg.norm(vector))


def sphere_directions(count: int) -> Directions:
    """`count` / 2 directions spread over the half sphere, each followed by its opposite."""
    half = (count + 1) // 2
    z = (np.arange(half) + 0.5) / half
    phi = np.pi * (1 + 5**0.5) * np.arange(half)
    radius = np.sqrt(1 - z * z)
    upper = np.stack([radius * np.cos(phi), radius * np.sin(phi), z], axis=1)
    return np.ascontiguousarray(np.stack([upper, -upper], axis=1).reshape(-1, 3)[:count])


def cone_directions(count: int, axis: NDArray[np.float64]) -> Directions:
    """Directions spread evenly over the solid angle of a cone."""
    axis = axis / np.linalg.norm(axis)
    across = np.cross(axis, np.roll(axis, 1))
    across /= np.linalg.norm(across)
    other = np.cross(axis, across)
    cosine = 1 - (1 - np.cos(CONE_HALF_ANGLE)) * (np.arange(count) + 0.5) / count
    sine, phi = np.sqrt(1 - cosine**2), np.pi * (1 + 5**0.5) * np.arange(count)
    return np.ascontiguousarray(
        np.outer(cosine, axis)
        + np.outer(sine * np.cos(phi), across)
        + np.outer(sine * np.sin(phi), other)
    )


def smooth_medium(size: int) -> Volume:
    """Waves of about a quarter of the side, not negative, of the mean optical side OPTICAL_SIDE."""
    x = (np.arange(size, dtype=np.float32) + 0.5) / size
    waves = [np.sin(2 * np.pi * (k * x + phase)) for k, phase in ((3, 0.1), (4, 0.35), (5, 0.6))]
    product = waves[0][:, None, None] * waves[1][None, :, None] * waves[2][None, None, :]
    return np.ascontiguousarray((1 + product) * np.float32(OPTICAL_SIDE / size), dtype=np.float32)


def relative_error(
    sigma_t: Volume, directions: Directions, weights: NDArray[np.float32], found: Volume
) -> float:
    """Relative RMS error of weighted sums of transmittance [c, nx, ny, nz] at random voxels."""
    count = max(50, ERROR_RAYS // len(directions))
    voxels = np.random.default_rng(2).integers(0, sigma_t.shape[0], (count, 3))
    depth = volillum_native.exact_optical_depth(
        sigma_t[None],
        IDENTITY,
        np.repeat(voxels.astype(np.float64), len(directions), axis=0),
        np.tile(directions, (count, 1)),
    )
    truth = np.exp(-depth).reshape(count, len(directions)) @ weights.astype(np.float64)
    error = found[:, voxels[:, 0], voxels[:, 1], voxels[:, 2]].T - truth
    return float(np.sqrt(np.mean(error**2) / np.mean(truth**2)))


def measure(work: Callable[[], object], repeats: int) -> NDArray[np.float64]:
    """Seconds of each repeat, after one to warm up."""
    return measure_in_turn((work,), repeats)[0]


def measure_in_turn(works: Sequence[Callable[[], object]], repeats: int) -> NDArray[np.float64]:
    """Seconds [work, repeat] of works that take turns, after one turn to warm up."""
    seconds = np.zeros((len(works), repeats + 1))
    for turn in range(repeats + 1):
        for index, work in enumerate(works):
            start = time.perf_counter()
            work()
            seconds[index, turn] = time.perf_counter() - start
    return seconds[:, 1:]


class Benchmark:
    def __init__(self, size: int, threads: int, repeats: int, as_json: bool) -> None:
        self.threads, self.repeats, self.as_json = threads, repeats, as_json
        self.sigma_t = smooth_medium(size)
        self.target = np.zeros_like(self.sigma_t)
        self.pool = ThreadPoolExecutor(threads)
        self.copy_seconds = 1.0

    def copy(self) -> None:
        """The grid to an existing array, by as many threads as the sweep's."""

        def part(rows: NDArray[np.int64]) -> None:
            inside = slice(rows[0], rows[-1] + 1)
            np.copyto(self.target[inside], self.sigma_t[inside])

        list(self.pool.map(part, np.array_split(np.arange(len(self.target)), self.threads)))

    def copies(self) -> None:
        seconds = measure(self.copy, 4 * self.repeats + 1)
        self.copy_seconds = float(np.median(seconds))
        self.report("copy, repeated", None, 1, 1, seconds, None)
        new = measure(self.sigma_t.copy, 2 * self.repeats + 1)
        self.report("copy, new", None, 1, 1, new, None)

    def sweep(
        self, name: str, directions: Directions, channels: int, near: int, new: bool = False
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
        """Times a sweep and copies in turn with it; returns the seconds of both and its error."""
        count = len(directions)
        weights = np.full((count, channels), 1 / count, np.float32)
        weights[:, 1:] *= np.random.default_rng(1).uniform(0.5, 1, (count, channels - 1))
        out = np.zeros((channels, *self.sigma_t.shape), np.float32)

        def work() -> object:
            return volillum_native.sweep(
                self.sigma_t,
                IDENTITY,
                directions,
                weights,
                near_slices=near,
                threads=self.threads,
                out=None if new else out,
            )

        copies, seconds = measure_in_turn((self.copy, work), self.repeats)
        self.copy_seconds = float(np.median(copies))
        error = 0.0 if new else relative_error(self.sigma_t, directions, weights, out)
        self.report(name, near, count, channels, seconds, None if new else error)
        return copies, seconds, error

    def by_user(self, name: str, shift: Shift, axis: int) -> None:
        direction = unit(np.roll(np.array([1.0, *TILTS["tilted"]]), axis))
        out = np.zeros_like(self.sigma_t)
        seconds = measure(lambda: march(self.sigma_t, direction, shift, out), 1)
        weights = np.ones((1, 1), np.float32)
        error = relative_error(self.sigma_t, direction[None], weights, out[None])
        self.report(f"1 direction, {'ijk'[axis]}, {name}", 0, 1, 1, seconds, error)

    def report(
        self,
        name: str,
        near: int | None,
        count: int,
        channels: int,
        seconds: NDArray[np.float64],
        error: float | None,
    ) -> None:
        size = self.sigma_t.shape[0]
        per_direction = seconds / (self.sigma_t.size * count) * 1e9
        low, middle, high = np.percentile(per_direction, [25, 50, 75])
        median = float(np.median(seconds))
        ratio = median / count / self.copy_seconds
        if self.as_json:
            row = {
                "case": name,
                "near_slices": near,
                "directions": count,
                "channels": channels,
                "size": size,
                "threads": self.threads,
                "instructions": volillum_native.instruction_set(),
                "seconds": median,
                "ns_per_voxel_direction": middle,
                "quartiles": [low, high],
                "ratio_to_copy": ratio,
                "relative_rms_error": error,
            }
            print(json.dumps(row), flush=True)
            return
        label = "-" if near is None else str(near)
        shown = "" if error is None else f"   error {error:.1e}"
        print(
            f"{name:28} near {label:>2}  {median * 1e3:9.1f} ms "
            f"{middle:8.3f} ns/voxel/direction {ratio:7.2f} x copy{shown}",
            flush=True,
        )

    def single_directions(self, near: int) -> None:
        copies, seconds, errors = [], [], []
        for axis in range(3):
            for tilt, (first, second) in TILTS.items():
                direction = unit(np.roll(np.array([1.0, first, second]), axis))[None]
                name = f"1 direction, {'ijk'[axis]}, {tilt}"
                found = self.sweep(name, direction, 1, near)
                copies.append(found[0])
                seconds.append(found[1])
                errors.append(found[2])
        mean_error = float(np.sqrt(np.mean(np.square(errors))))
        self.report("copy, in turn", None, 1, 1, np.concatenate(copies), None)
        self.copy_seconds = float(np.median(copies))
        self.report("1 direction, mean of all", near, 1, 1, np.mean(seconds, axis=0), mean_error)
        straight = np.array([[1.0, 0.0, 0.0]])
        self.sweep("1 direction, into a new array", straight, 1, near, new=True)


def main() -> None:
    parser = argparse.ArgumentParser(description="Time the directional sweep.")
    parser.add_argument("--size", type=int, default=256, help="voxels along each axis")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--json", action="store_true", help="one JSON object a line")
    parser.add_argument("--sizes", type=int, nargs="+", help="only the cost against the size")
    options = parser.parse_args()
    print(json.dumps(machine()), flush=True)
    axis = np.array([1.0, 0.3, 0.2])
    for size in options.sizes or []:
        benchmark = Benchmark(size, options.threads, options.repeats, options.json)
        if not options.json:
            print(f"{size}^3")
        benchmark.copies()
        benchmark.single_directions(0)
        benchmark.sweep("cone of 64 about i", cone_directions(64, axis), 1, 0)
    if options.sizes:
        return
    benchmark = Benchmark(options.size, options.threads, options.repeats, options.json)
    benchmark.copies()
    for near in (0, 4):
        benchmark.single_directions(near)
        for turn in range(3):
            directions = cone_directions(64, np.roll(axis, turn))
            benchmark.sweep(f"cone of 64 about {'ijk'[turn]}", directions, 1, near)
        benchmark.sweep("sphere of 66 x 16", sphere_directions(66), 16, near)
    for turn in (0, 2):
        benchmark.by_user("numpy", shift_by_numpy, turn)
        benchmark.by_user("scipy.ndimage", shift_by_scipy, turn)


if __name__ == "__main__":
    main()
