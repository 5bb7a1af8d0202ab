"""Time of the cone transport beside a copy of the medium, in one run.

    python tests/benchmarks/bench_cone_transport.py [--size 256] [--threads 2] [--json]

Extinction and scattering of three channels each, 16 directions in a cone of 30 degrees, with the
light along an axis of the grid and oblique. Medians of the repeats after a warm-up. `sweep` is the
unscattered light, which the model takes from there. A medium of one extinction with coloured albedo
is solved for all three at once, a grey one once. Albedos are 0.8 everywhere, but nothing is made of
that.
"""

import argparse
import json
import math
import time
from collections.abc import Callable

import numpy as np

import volillum_native
from volillum_addon.core.directions import about, cone_rule

AXES = {"along k": (0.0, 0.0, 1.0), "along i": (1.0, 0.0, 0.0), "oblique": (0.6, 0.3, 0.7)}


def measure(work: Callable[[], object], repeats: int) -> float:
    work()
    seconds = []
    for _ in range(repeats):
        start = time.perf_counter()
        work()
        seconds.append(time.perf_counter() - start)
    return float(np.median(seconds))


def main() -> None:
    parser = argparse.ArgumentParser(description="Time the cone transport.")
    parser.add_argument("--size", type=int, default=256, help="voxels along each axis")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--repeats", type=int, default=1)
    parser.add_argument("--directions", type=int, default=16)
    parser.add_argument("--channels", type=int, default=3, choices=(1, 3))
    parser.add_argument("--json", action="store_true", help="one JSON object a line")
    options = parser.parse_args()
    size, channels = options.size, options.channels

    random = np.random.default_rng(1)
    shape = (channels, size, size, size)
    sigma_t = random.random(shape, dtype=np.float32) * np.float32(4 / size)
    sigma_s = sigma_t * np.float32(0.8)
    world = np.eye(4)
    vectors, weights = cone_rule(math.radians(30), options.directions)

    def report(name: str, seconds: float, copy_seconds: float) -> None:
        steps = sigma_t.size * len(weights)
        row = {
            "case": name,
            "size": size,
            "channels": channels,
            "directions": len(weights),
            "threads": options.threads,
            "seconds": seconds,
            "ns_per_voxel_direction_channel": seconds / steps * 1e9,
            "ratio_to_copy": seconds / copy_seconds,
        }
        if options.json:
            print(json.dumps(row), flush=True)
        else:
            print(
                f"{name:28} {seconds * 1e3:9.1f} ms {seconds / steps * 1e9:8.3f} "
                f"ns/voxel/direction/channel {seconds / copy_seconds:8.2f} x copy",
                flush=True,
            )

    target = np.zeros_like(sigma_t)
    copy_seconds = measure(lambda: np.copyto(target, sigma_t), 3)
    report("copy", copy_seconds, copy_seconds)
    for name, vector in AXES.items():
        axis = np.array(vector) / np.linalg.norm(vector)
        directions = np.ascontiguousarray(about(vectors, axis))

        def sweep(directions: np.ndarray = directions) -> object:
            column = weights[:, None].astype(np.float32)
            return [
                volillum_native.sweep(
                    each, world, directions, column, threads=options.threads, out=target[:1]
                )
                for each in sigma_t
            ]

        report(f"sweep, {name}", measure(sweep, options.repeats), copy_seconds)

        def march(
            extinctions: int,
            scatterings: int,
            spacing: float,
            axis: np.ndarray = axis,
            directions: np.ndarray = directions,
        ) -> Callable[[], object]:
            return lambda: volillum_native.cone_transport(
                sigma_t[:extinctions], sigma_s[:scatterings], world, axis, directions, weights,
                transmittance=target[:extinctions], spacing=spacing, threads=options.threads,
            )  # fmt: skip

        for spacing in (1.0, 0.7):
            each = march(channels, channels, spacing)
            report(f"spacing {spacing:g}, {name}", measure(each, options.repeats), copy_seconds)
        if channels == 3:  # what is absent costs nothing
            each = march(1, 3, 1.0)
            report(f"one extinction, {name}", measure(each, options.repeats), copy_seconds)
            each = march(1, 1, 1.0)
            report(f"one channel, {name}", measure(each, options.repeats), copy_seconds)


if __name__ == "__main__":
    main()
