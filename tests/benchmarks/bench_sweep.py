"""Time of the directional sweep beside a copy of the grid, in one run.

    python tests/benchmarks/bench_sweep.py [--size 256] [--threads 2] [--json]

Prints nanoseconds per voxel and direction, and the ratio to a copy of the grid by as many threads.
Copy and sweeps write to existing arrays; `copy new` and `into a new array` show what the system's
new pages add. Medians of the repeats after a warm-up. The machine's noise is in the quartiles of
the JSON output.
"""

import argparse
import json
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

import volillum_native

IDENTITY = np.eye(4)


def fibonacci_directions(count: int) -> NDArray[np.float64]:
    """`count` / 2 directions spread over the half sphere, each followed by its opposite."""
    half = (count + 1) // 2
    z = (np.arange(half) + 0.5) / half
    phi = np.pi * (1 + 5**0.5) * np.arange(half)
    radius = np.sqrt(1 - z * z)
    upper = np.stack([radius * np.cos(phi), radius * np.sin(phi), z], axis=1)
    return np.ascontiguousarray(np.stack([upper, -upper], axis=1).reshape(-1, 3)[:count])


def measure(work: Callable[[], object], repeats: int) -> NDArray[np.float64]:
    work()
    seconds = []
    for _ in range(repeats):
        start = time.perf_counter()
        work()
        seconds.append(time.perf_counter() - start)
    return np.array(seconds)


def main() -> None:
    parser = argparse.ArgumentParser(description="Time the directional sweep.")
    parser.add_argument("--size", type=int, default=256, help="voxels along each axis")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--json", action="store_true", help="one JSON object a line")
    options = parser.parse_args()
    size, threads, repeats = options.size, options.threads, options.repeats

    random = np.random.default_rng(1)
    sigma_t = (random.random((size,) * 3, dtype=np.float32) * np.float32(4 / size)).astype("f4")
    target = np.zeros_like(sigma_t)
    voxels = sigma_t.size
    slabs = np.array_split(np.arange(size), threads)
    with ThreadPoolExecutor(threads) as pool:

        def copy() -> None:
            def part(rows: NDArray[np.int64]) -> None:
                np.copyto(target[rows[0] : rows[-1] + 1], sigma_t[rows[0] : rows[-1] + 1])

            list(pool.map(part, slabs))

        copy_seconds = float(np.median(measure(copy, 2 * repeats + 1)))

    def report(
        name: str, near: int | None, count: int, channels: int, seconds: NDArray[np.float64]
    ) -> None:
        per_direction = seconds / (voxels * count) * 1e9
        low, middle, high = np.percentile(per_direction, [25, 50, 75])
        ratio = float(np.median(seconds)) / count / copy_seconds
        row = {
            "case": name,
            "near_slices": near,
            "directions": count,
            "channels": channels,
            "size": size,
            "threads": threads,
            "seconds": float(np.median(seconds)),
            "ns_per_voxel_direction": middle,
            "quartiles": [low, high],
            "ratio_to_copy": ratio,
        }
        if options.json:
            print(json.dumps(row), flush=True)
        else:
            label = "-" if near is None else str(near)
            print(
                f"{name:28} near {label:>2}  {np.median(seconds) * 1e3:9.1f} ms "
                f"{middle:8.3f} ns/voxel/direction {ratio:7.2f} x copy",
                flush=True,
            )

    report("copy", None, 1, 1, np.array([copy_seconds]))
    report("copy new", None, 1, 1, measure(lambda: sigma_t.copy(), 2 * repeats + 1))

    one = np.ones((1, 1), np.float32)
    tilts = {"straight": (0.0, 0.0), "tilted": (0.35, 0.2), "oblique": (0.8, -0.6)}
    for near in (0, 4):
        totals = []
        for axis in range(3):
            for tilt, (first, second) in tilts.items():
                vector = np.roll(np.array([1.0, first, second]), axis)
                direction = (vector / np.linalg.norm(vector))[None]

                def single(direction: NDArray[np.float64] = direction, near: int = near) -> object:
                    return volillum_native.sweep(
                        sigma_t,
                        IDENTITY,
                        direction,
                        one,
                        near_slices=near,
                        threads=threads,
                        out=target[None],
                    )

                seconds = measure(single, repeats)
                totals.append(seconds)
                report(f"1 direction, {'ijk'[axis]}, {tilt}", near, 1, 1, seconds)
        report("1 direction, mean of all", near, 1, 1, np.mean(totals, axis=0))

        def new(direction: NDArray[np.float64] = direction, near: int = near) -> object:
            return volillum_native.sweep(
                sigma_t, IDENTITY, direction, one, near_slices=near, threads=threads
            )

        report("the last, into a new array", near, 1, 1, measure(new, repeats))
        for count, channels in ((64, 1), (66, 16)):
            directions = fibonacci_directions(count)
            weights = random.normal(size=(count, channels)).astype(np.float32)
            out = np.zeros((channels, *sigma_t.shape), np.float32)

            def many(
                directions: NDArray[np.float64] = directions,
                weights: NDArray[np.float32] = weights,
                near: int = near,
                out: NDArray[np.float32] = out,
            ) -> object:
                return volillum_native.sweep(
                    sigma_t,
                    IDENTITY,
                    directions,
                    weights,
                    near_slices=near,
                    threads=threads,
                    out=out,
                )

            report(
                f"{count} directions x {channels}", near, count, channels, measure(many, repeats)
            )


if __name__ == "__main__":
    main()
