"""Photons a second beside a copy of the grid, and the time to a relative error of 5 %.

    python tests/benchmarks/bench_photons.py [--size 128] [--threads 2] [--json]

A cube of smoke (a random field with a steep spectrum), albedo 0.9, mean optical depth 20 and 100
along a side, under a sun. Tracing alone, and with the deposit of track lengths and the error
estimate of every voxel; `scatterings` are the mean number a photon. The time to 5 % is that of
passes alone until the root mean square of the standard error is 5 % of that of the scattered light,
in matter. Beside it the time that Cycles (in its own process) takes to the same noise in an image
of 128 x 128 pixels, RMS over those that show matter: without the scene's start, from two renders.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
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


def cycles(size: int, side: float) -> dict[str, float]:
    """Seconds of Cycles to the wanted noise, by the difference of two seeds. Wants a process of its
    own."""
    from volillum_addon.blender.cycles import CyclesRenderer
    from volillum_addon.core.camera import Camera
    from volillum_addon.core.grid import Grid
    from volillum_addon.core.lights import DistantLight
    from volillum_addon.core.medium import Medium
    from volillum_addon.core.scene import Scene

    grid = Grid(smoke(size)[0], np.diag([1 / size, 1 / size, 1 / size, 1.0]), "density")
    centre = grid.centre
    camera = Camera(centre + np.array([0.0, -3.0, 0.0]), centre, (0, 0, 1), fov=0.4)
    medium = Medium.from_density(grid, float(side), 0.9)
    renderer = CyclesRenderer(Scene(medium, (DistantLight(SUN, 1.0),), camera), 128, 128)
    few, many = 2, 18
    seconds = {}
    for samples in (few, few, many):  # the first also warms up
        begin = time.perf_counter()
        first = renderer.reference(128, samples, 1).astype(np.float64)
        seconds[samples] = time.perf_counter() - begin
    second = renderer.reference(128, many, 2).astype(np.float64)
    mean = (first + second) / 2
    shown = mean.sum(-1) > 0
    noise = float(np.sqrt(((first - second)[shown] ** 2).sum() / 2 / (mean[shown] ** 2).sum()))
    a_sample = (seconds[many] - seconds[few]) / (many - few)
    return {"cycles_seconds_to_5_percent": a_sample * many * (noise / WANTED) ** 2,
            "cycles_noise": noise, "cycles_seconds_a_sample": a_sample}  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description="Time the photon engine.")
    parser.add_argument("--size", type=int, default=128, help="voxels along each axis")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--photons", type=int, default=1_000_000, help="of a pass")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--json", action="store_true", help="one JSON object a line")
    parser.add_argument("--without-cycles", action="store_true")
    parser.add_argument("--cycles-alone", type=float, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.cycles_alone:
        print("\n" + json.dumps(cycles(options.size, options.cycles_alone)))
        return
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
        sums = np.zeros((sigma_t.size, 1), np.float32)
        deviations = np.zeros((sigma_t.size, 1), np.float32)
        seconds, passes, error, scatterings = [], 0, np.inf, 0.0
        matter = sigma_t.reshape(-1) > 0
        while len(seconds) <= options.repeats or error > WANTED:
            begin = time.perf_counter()
            tally = engine.run(source, sums, deviations, seed=1, pass_index=passes, photons=photons,
                               threads=options.threads)  # fmt: skip
            seconds.append(time.perf_counter() - begin)
            passes += 1
            scatterings = float(tally["scatterings"]) / photons
            if passes > 1:
                mean = sums[matter, 0].astype(np.float64) / passes
                variance = deviations[matter, 0] / (passes * (passes - 1.0))
                error = float(np.sqrt(variance.sum() / (mean**2).sum()))
        # The first pass also makes its buffers.
        rate = photons / float(np.median(seconds[1:]))
        alone = []
        for index in range(options.repeats + 1):
            begin = time.perf_counter()
            engine.run(source, sums, deviations, seed=2, pass_index=index, photons=photons,
                       deposits=False, threads=options.threads)  # fmt: skip
            alone.append(time.perf_counter() - begin)
        row = {
            "case": "photons", "size": size, "threads": options.threads, "optical_side": side,
            "photons_a_second": rate, "scatterings": scatterings,
            "tracking_alone_a_second": photons / float(np.median(alone[1:])),
            "copies_a_million": 1e6 / rate / copy, "relative_error": error,
            "seconds_to_5_percent": sum(seconds) * (error / WANTED) ** 2,
        }  # fmt: skip
        if not options.without_cycles:
            command = [sys.executable, __file__, "--size", str(size), "--cycles-alone", str(side)]
            answer = subprocess.run(command, capture_output=True, text=True, check=True)
            found = [line for line in answer.stdout.splitlines() if line.startswith("{")]
            row |= json.loads(found[-1])
        if options.json:
            print(json.dumps(row))
        else:
            print(
                f"optical side {side:3d}: {rate / 1e6:.2f} million photons/s, tracking alone "
                f"{row['tracking_alone_a_second'] / 1e6:.2f} "
                f"({scatterings:.2f} scatterings each, a million in "
                f"{row['copies_a_million']:.0f} copies of the grid), "
                f"{row['seconds_to_5_percent']:.2f} s to 5 %"
                + (
                    ""
                    if options.without_cycles
                    else f"; Cycles {row['cycles_seconds_to_5_percent']:.2f} s to 5 % of an image"
                )
            )


if __name__ == "__main__":
    main()
