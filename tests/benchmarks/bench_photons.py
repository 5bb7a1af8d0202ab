"""Photons a second beside a copy of the grid, and the time to a relative error of 5 %.

    python tests/benchmarks/bench_photons.py [--size 128] [--threads 2] [--json]

A cube of smoke (a random field with a steep spectrum), albedo 0.9, mean optical depth 20 and 100
along a side, under a sun. Tracing includes the deposit of track lengths and the error estimate of
every voxel; `scatterings` are the mean number a photon. The time to 5 % is that of passes alone
until the root mean square of the standard error is 5 % of that of the scattered light, in matter.
"""

import argparse
import json
import time

import numpy as np
from numpy.typing import NDArray

import volillum_native

SUN = np.array([0.3, 0.5, 0.81]) / np.linalg.norm([0.3, 0.5, 0.81])
WANTED = 0.05


def smoke(size: int) -> NDArray[np.float32]:
    """A ball of noise with a mean of 1 over the cube, [1, size, size, size]."""
    random = np.random.default_rng(0)
    whole, half = np.fft.fftfreq(size) * size, np.fft.rfftfreq(size) * size
    wave = np.sqrt(whole[:, None, None] ** 2 + whole[:, None] ** 2 + half**2)
    spectrum = np.fft.rfftn(random.normal(size=(size,) * 3)) * (1 + wave) ** -2.5
    field = np.fft.irfftn(spectrum, (size,) * 3, axes=(0, 1, 2))
    axis = np.linspace(-1, 1, size)
    radius = np.sqrt(axis[:, None, None] ** 2 + axis[:, None] ** 2 + axis**2)
    density = np.maximum(0, 1.2 - 1.5 * radius + 0.5 * field / field.std())
    return (density / density.mean()).astype(np.float32)[None]


def main() -> None:
    parser = argparse.ArgumentParser(description="Time the photon engine.")
    parser.add_argument("--size", type=int, default=128, help="voxels along each axis")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--photons", type=int, default=1_000_000, help="of a pass")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--json", action="store_true", help="one JSON object a line")
    options = parser.parse_args()
    size, photons = options.size, options.photons

    density = smoke(size)
    target = np.zeros_like(density)
    copies = []
    for _ in range(7):
        begin = time.perf_counter()
        np.copyto(target, density)
        copies.append(time.perf_counter() - begin)
    copy = float(np.median(copies))
    affine = np.diag([1 / size, 1 / size, 1 / size, 1.0])
    for side in (20, 100):
        sigma_t = density * np.float32(side)
        engine = volillum_native.Photons(sigma_t, sigma_t * np.float32(0.9), affine)
        source = volillum_native.PhotonSource.distant(SUN, 1.0)
        sums = np.zeros((sigma_t.size, 1, 1), np.int64)
        squares = np.zeros((sigma_t.size, 1))
        seconds, passes, error, scatterings = [], 0, np.inf, 0.0
        matter = sigma_t.reshape(-1) > 0
        while len(seconds) <= options.repeats or error > WANTED:
            begin = time.perf_counter()
            tally = engine.run(source, sums, squares, seed=1, pass_index=passes, photons=photons,
                               threads=options.threads)  # fmt: skip
            seconds.append(time.perf_counter() - begin)
            passes += 1
            scatterings = float(tally["scatterings"]) / photons
            if passes > 1:
                mean = sums[matter, 0, 0] / passes
                variance = (squares[matter, 0] / passes - mean**2) / (passes - 1)
                error = float(np.sqrt(variance.sum() / (mean**2).sum()))
        # The first pass also makes its buffers.
        rate = photons / float(np.median(seconds[1:]))
        row = {
            "case": "photons", "size": size, "threads": options.threads, "optical_side": side,
            "photons_a_second": rate, "scatterings": scatterings,
            "copies_a_million": 1e6 / rate / copy, "relative_error": error,
            "seconds_to_5_percent": sum(seconds) * (error / WANTED) ** 2,
        }  # fmt: skip
        if options.json:
            print(json.dumps(row))
        else:
            print(
                f"optical side {side:3d}: {rate / 1e6:.2f} million photons/s "
                f"({scatterings:.2f} scatterings each, a million in "
                f"{row['copies_a_million']:.0f} copies of the grid), "
                f"{row['seconds_to_5_percent']:.2f} s to 5 %"
            )


if __name__ == "__main__":
    main()
