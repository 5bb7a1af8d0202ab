"""Time of neighbourhood sums beside a copy of the grid and scipy.fft, in one run, and their error.

    python tests/benchmarks/bench_convolution.py [--size 256] [--threads 2] [--json]

Radii in voxels. `single` is what bounded ambient occlusion takes, `double` its linear law; both
include the kernel's integration and spectrum, and write a new array. `scipy.fft` transforms in
single precision what is padded to fast lengths, multiplies by a kernel's spectrum that it is given,
and transforms back. Errors are the largest differences to scipy.fft in double precision, relative
to the largest sum. Medians of the repeats after a warm-up. `half ball` are the direct sums over the
open side of every voxel's gradient, once, for radii whose cubes are affordable.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy import fft

import volillum_native

RADII = (8, 12, 32)
HALF_RADII = (4, 8, 12)
WORLD = np.eye(4)
AXES = (0, 1, 2)


def measure(work: Callable[[], object], repeats: int) -> float:
    work()
    seconds = []
    for _ in range(repeats):
        start = time.perf_counter()
        work()
        seconds.append(time.perf_counter() - start)
    return float(np.median(seconds))


def kernel(radius: int) -> NDArray[np.float64]:
    """The weights [2 r + 1] * 3: what one voxel of 1 gives to its neighbours."""
    spike = np.zeros((1, *(2 * radius + 1,) * 3), np.float32)
    spike[0, radius, radius, radius] = 1
    weights = volillum_native.convolve(spike, WORLD, radius=float(radius), precision="double")
    return np.asarray(weights[0], np.float64)


class ScipyConvolution:
    """The same sums by scipy.fft, its kernel's spectrum made once."""

    def __init__(self, field: NDArray[np.float32], radius: int, dtype: type, threads: int) -> None:
        self.field, self.threads = field.astype(dtype), threads
        # What wraps around lands in the padding.
        self.padded = [fft.next_fast_len(n + radius, real=True) for n in field.shape]
        weights = np.zeros(self.padded, dtype)
        side = 2 * radius + 1
        weights[:side, :side, :side] = kernel(radius)
        centred = np.roll(weights, (-radius,) * 3, axis=AXES)
        # A kernel that is even has a real spectrum.
        self.spectrum = fft.rfftn(centred, workers=threads).real.copy()

    def __call__(self) -> NDArray[np.floating]:
        forward = fft.rfftn(self.field, self.padded, workers=self.threads)
        forward *= self.spectrum
        back = fft.irfftn(forward, self.padded, workers=self.threads, overwrite_x=True)
        x, y, z = self.field.shape
        return np.asarray(back[:x, :y, :z])


def main() -> None:
    parser = argparse.ArgumentParser(description="Time the neighbourhood sums.")
    parser.add_argument("--size", type=int, default=256, help="voxels along each axis")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--json", action="store_true", help="one JSON object a line")
    options = parser.parse_args()
    size, threads = options.size, options.threads

    field = np.random.default_rng(1).random((size,) * 3, dtype=np.float32)
    target = np.zeros_like(field)
    parts = list(zip(np.array_split(target, threads), np.array_split(field, threads), strict=True))

    def copy() -> None:
        with ThreadPoolExecutor(threads) as pool:
            list(pool.map(lambda part: np.copyto(*part), parts))

    copy_seconds = measure(copy, 2 * options.repeats)

    def report(name: str, seconds: float, scipy_seconds: float, error: float | None) -> None:
        row = {
            "case": name,
            "size": size,
            "threads": threads,
            "seconds": seconds,
            "ns_per_voxel": seconds / field.size * 1e9,
            "ratio_to_copy": seconds / copy_seconds,
            "ratio_to_scipy": seconds / scipy_seconds if scipy_seconds else None,
            "error": error,
        }
        if options.json:
            print(json.dumps(row), flush=True)
            return
        beside = f"{seconds / scipy_seconds:6.2f} x scipy" if scipy_seconds else ""
        wrong = "" if error is None else f"  error {error:.1e}"
        print(
            f"{name:26} {seconds * 1e3:9.1f} ms {seconds / field.size * 1e9:7.2f} ns/voxel "
            f"{seconds / copy_seconds:8.1f} x copy {beside}{wrong}",
            flush=True,
        )

    report("copy", copy_seconds, 0.0, None)
    for radius in RADII:
        truth = ScipyConvolution(field, radius, np.float64, threads)()
        largest = float(truth.max())
        by_scipy = ScipyConvolution(field, radius, np.float32, threads)
        scipy_seconds = measure(by_scipy, options.repeats)
        error = float(np.abs(by_scipy() - truth).max()) / largest
        report(f"radius {radius}, scipy.fft", scipy_seconds, scipy_seconds, error)
        del by_scipy
        for precision in ("single", "double"):
            work = partial(
                volillum_native.convolve, field[None], WORLD, radius=float(radius),
                precision=precision, threads=threads,
            )  # fmt: skip
            seconds = measure(work, options.repeats)
            error = float(np.abs(work()[0] - truth).max()) / largest
            report(f"radius {radius}, {precision}", seconds, scipy_seconds, error)

    for radius in HALF_RADII:
        half = partial(
            volillum_native.hemisphere_sums, field[None], field[None], WORLD,
            radius=float(radius), threads=threads,
        )  # fmt: skip
        start = time.perf_counter()
        half()
        report(f"radius {radius}, half ball", time.perf_counter() - start, 0.0, None)


if __name__ == "__main__":
    main()
