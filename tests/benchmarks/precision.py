"""What float32 costs: kernels built for float beside the same ones built for double.

    python tests/benchmarks/precision.py [-o docs/precision.md]

`make double` builds the second core first. Exit status 1 where a difference is beyond its bound.

A bound counts the roundings that a result goes through, each of at most the unit u = 2^-24. What is
summed is not negative, so none is magnified:

    optical depth   relative error k u: interpolations across the lattice and of the result (3
                    roundings each: weight, product, sum), the sums within a slab of 16 slices, one
                    where each slab joins those before it (at most 4 in grids of this size), and the
                    near field's taps, 9 a slice
    transmittance   exp(-q) is off by q exp(-q) k u <= k u / e, and the exponential's own 2e-7
    weighted sums   one rounding for each direction and its weight
    hues            of radiances down to 1e-6 of the light's, ratios: ln(1e6) k u, in both terms
    cone transport  a convex combination from slice to slice: as many times the roundings of a step
                    as the light's lattice has slices
    convolution     a transform of n points rounds log2(n) times, on the way there and back, of
                    which the sums of squares say how large what is lost may be
"""

from __future__ import annotations

import argparse
import math
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import DTypeLike, NDArray

import volillum_native as native
from volillum_addon.core.directions import sphere_rule

DOUBLE = Path("build/double")
SIZE, DIRECTIONS, NEAR = 24, 16, 4
UNIT = 2.0**-24
EXPONENTIAL = 2e-7
# Roundings of an optical depth: four interpolations, a slab's sums, their joining and the length,
# the near field.
DEPTH = 4 * 3 + 2 * 16 + 4 + 9 * NEAR + 2
# Of a step of the cone transport: 2 samples of 4 taps for extinction, two for each of the sources,
# the mean distance's rational function, the exponential (relative to 1), the update.
STEP = 4 * 8 + 30 + 4 + 20

Field = NDArray[np.float64]


@dataclass(frozen=True)
class Case:
    """A kernel in a medium: what it computes for numbers of a type, in units of what its bound is
    relative to, and the bound. `pointwise`: relative to each value itself."""

    kernel: str
    medium: str
    run: Callable[[DTypeLike], Field]
    bound: float
    pointwise: bool = False


def media() -> Iterator[tuple[str, NDArray[np.float32]]]:
    """Extinctions [n, n, n] in a cube of side 1, as float32: exact in double, too."""
    axis = np.linspace(-1, 1, SIZE)
    x, y, z = np.meshgrid(axis, axis, axis, indexing="ij")
    yield "smooth", (6 * np.exp(-4 * (x**2 + y**2 + z**2))).astype(np.float32)
    random = np.random.default_rng(1)
    decades = 10 ** random.uniform(-6, 6, (SIZE,) * 3)
    decades[random.random(decades.shape) < 0.7] = 0
    decades[: SIZE // 3] += 1e4
    yield "hard", decades.astype(np.float32)


def cases() -> Iterator[Case]:
    """All kernels that are written for either type, and the transforms, which have both."""
    affine = np.diag([1 / SIZE, 1.3 / SIZE, 0.8 / SIZE, 1.0])
    affine[0, 1] = 0.2 / SIZE
    vectors, weights = sphere_rule(DIRECTIONS)
    vectors, weights = np.ascontiguousarray(vectors), np.asarray(weights / weights.sum())
    count = len(weights)
    sums = count + 1
    transmittance = DEPTH * UNIT / math.e + EXPONENTIAL + sums * UNIT
    toward = np.array([0.36, 0.48, 0.8])
    cone = vectors + 2 * toward
    cone /= np.linalg.norm(cone, axis=1, keepdims=True)
    hue, colours = np.ones(3), np.array([1.0, 0.7, 0.4])
    for name, sigma in media():

        def swept(
            real: DTypeLike, quantity: str = "transmittance", sigma: NDArray[np.float32] = sigma
        ) -> Field:
            rule = np.ascontiguousarray(weights[:, None], real)
            return native.sweep(sigma.astype(real), affine, vectors, rule, near_slices=NEAR,
                                quantity=quantity)  # fmt: skip

        def weighted(real: DTypeLike, sigma: NDArray[np.float32] = sigma) -> Field:
            nodes = math.ceil((SIZE - 1) / 4) + 1
            local = np.broadcast_to(weights[:, None, None, None], (count, nodes, nodes, nodes))
            return native.sweep_weighted(sigma.astype(real), affine, vectors,
                                         np.ascontiguousarray(local, real), 4,
                                         near_slices=NEAR)  # fmt: skip

        def hues(real: DTypeLike, sigma: NDArray[np.float32] = sigma) -> Field:
            extinction = np.ascontiguousarray(np.stack([sigma * c for c in colours]), real)
            source = (extinction * 0.5).astype(real)
            return native.mean_hue(extinction, source, affine, vectors, weights.astype(real), hue,
                                   near_slices=NEAR)  # fmt: skip

        def uniform(real: DTypeLike, sigma: NDArray[np.float32] = sigma) -> Field:
            return native.mean_hue_uniform(sigma.astype(real), affine, vectors,
                                           weights.astype(real), hue, colours, 0.5 * hue,
                                           near_slices=NEAR)  # fmt: skip

        def transported(real: DTypeLike, sigma: NDArray[np.float32] = sigma) -> Field:
            extinction = sigma[None].astype(real)
            return native.cone_transport(extinction, (extinction * 0.75).astype(real), affine,
                                         toward, cone, weights)  # fmt: skip

        def convolved(real: DTypeLike, sigma: NDArray[np.float32] = sigma) -> Field:
            precision = "single" if real == np.float32 else "double"
            return native.convolve(sigma[None], affine, radius=0.25, opacity_length=0.1,
                                   precision=precision)  # fmt: skip

        yield Case("sweep, optical depth", name, lambda real, f=swept: f(real, "optical_depth"),
                   (DEPTH + sums) * UNIT, pointwise=True)  # fmt: skip
        yield Case("sweep, transmittance", name, swept, transmittance)
        # Weights at nodes: three interpolations more.
        yield Case("sweep_weighted", name, weighted, transmittance + 9 * UNIT)
        hue_bound = (2 * math.log(1e6) * DEPTH + sums) * UNIT + 2 * EXPONENTIAL
        yield Case("mean_hue", name, hues, hue_bound)
        yield Case("mean_hue_uniform", name, uniform, hue_bound)
        # The lattice is as long as the grid's diagonal at most, and slices may be twice as close.
        slices = 2 * math.sqrt(3) * (SIZE + 4)
        yield Case("cone_transport", name, transported, slices * STEP * UNIT)
        points = (2 * SIZE) ** 3
        # One transform's relative error in the 2-norm is log2(n) u times a constant below 6 (N. J.
        # Higham, Accuracy and Stability, theorem 24.2); three of them, of values up to 1 at all
        # voxels, in one place at worst.
        off = 3 * 6 * math.log2(points) * UNIT
        yield Case("convolve", name, convolved, off)


def dump(path: Path, real: DTypeLike) -> None:
    """All results of the core that this Python finds."""
    found = {f"{i}": np.asarray(case.run(real), np.float64) for i, case in enumerate(cases())}
    np.savez(path, allow_pickle=False, **found)


def results(double: bool) -> list[Field]:
    """Of a process of its own: two cores do not live in one."""
    with tempfile.TemporaryDirectory(prefix="volillum-") as folder:
        path = Path(folder) / "results.npz"
        environment = {**os.environ, "PYTHONPATH": str(DOUBLE)} if double else {**os.environ}
        call = [sys.executable, __file__, "--dump", str(path)] + (["--double"] if double else [])
        subprocess.run(call, env=environment, check=True)
        with np.load(path, allow_pickle=False) as held:
            return [held[name] for name in held.files]


def difference(case: Case, single: Field, double: Field) -> float:
    """The largest, relative to each value or to the largest one."""
    off = np.abs(single - double)
    if case.pointwise:
        return float(np.max(np.divide(off, double, out=np.zeros_like(off), where=double > 0)))
    return float(off.max() / double.max())


def main() -> int:
    parser = argparse.ArgumentParser(description="Kernels in float beside the same in double.")
    parser.add_argument("-o", "--output", type=Path, help="write the page there")
    parser.add_argument("--dump", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--double", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.dump:
        dump(options.dump, np.float64 if options.double else np.float32)
        return 0
    lines = ["| kernel | medium | largest difference | bound |", "| --- | --- | ---: | ---: |"]
    beyond = 0
    for case, single, double in zip(cases(), results(False), results(True), strict=True):
        found = difference(case, single, double)
        beyond += not found <= case.bound
        mark = "" if found <= case.bound else " **beyond**"
        what = "of the value" if case.pointwise else "of the largest"
        lines.append(
            f"| `{case.kernel}` | {case.medium} | {found:.1e} {what}{mark} | {case.bound:.1e} |"
        )
    print("\n".join(lines))
    if options.output:
        options.output.write_text("\n".join([*HEAD, *lines]) + "\n", encoding="utf-8")
    return min(beyond, 1)


HEAD = [
    "# What float32 costs",
    "",
    "The kernels' number type is one alias, so they can be built for double as well: `make double` "
    "does, runs both on the same float32 volumes, and writes this page. Each bound is the number "
    "of roundings that a result goes through (`tests/benchmarks/precision.py` counts them); none "
    "is fitted. *smooth* is a Gaussian of optical depth 3; *hard* has an opaque wall of 1e4 and "
    "elsewhere extinctions over twelve decades beside zeros.",
    "",
    "Not in the table: photons, published algorithms and line integrals, which are written for "
    "float (photons in vector code with float's own bits). Photons are judged by their noise: "
    "against exact solutions, in units of their standard error (`tests/models`).",
    "",
]

if __name__ == "__main__":
    sys.exit(main())
