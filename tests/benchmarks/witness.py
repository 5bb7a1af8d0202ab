"""Photon mapping against Cycles at full scattering on real volumes, by z-test.

    python tests/benchmarks/witness.py [--seeds 6] [--volumes NAME,NAME] [-o docs/witness.md]

One medium and two renderers that share nothing: photon mapping through the core's line integral,
and Cycles' path tracing. Both are drawn with independent seeds, so that standard errors are those
of whole runs, whatever voxels and pixels share. What is compared are means over blocks of the
image; the largest of their deviations is judged by Bonferroni's rule, which holds for blocks that
are correlated, too.

Photon mapping tells means over voxels, which the display interpolates: by second order, of the
same field on half the spacing a quarter of it is left (core/coarse.py). So the test is of the limit
(4 I(h / 2) - I(h)) / 3, and the page has all three. Exit status 1 where the limit disagrees. Needs
VOLILLUM_DATA and some 5 minutes.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import bpy  # noqa: F401 - cycles.py finds Cycles' own module through it
import numpy as np
import volumes
from numpy.typing import NDArray
from scipy import stats

from volillum_addon.blender.cycles import CyclesRenderer
from volillum_addon.compare.bounces import MOST, bounce_limit
from volillum_addon.core.coarse import coarsened, refined
from volillum_addon.core.lights import DistantLight, EnvironmentLight, Light, PointLight
from volillum_addon.core.scene import Scene
from volillum_addon.models.illuminate import illuminate
from volillum_addon.models.image import line_integral

# At most so many voxels before the spacing is halved.
VOXELS = 600_000
PIXELS, BLOCKS = 48, 4
SAMPLES, PHOTONS, PASSES = 64, 200_000, 8
# Blocks darker than this share of the mean show next to nothing.
DARK = 0.1
# A test that is right fails once in a thousand runs of the page.
LEVEL = 1e-3

Images = NDArray[np.float64]  # [seeds, blocks], the first block is the whole image


@dataclass(frozen=True)
class Row:
    """Photon mapping over Cycles less 1, for the whole image: (value, standard error) at the
    spacing, at half of it, and in the limit; the blocks' largest |z| and how probable it is."""

    volume: str
    lights: str
    at: tuple[tuple[float, float], ...]
    largest: float
    blocks: int
    probability: float


def set_ups(scene: Scene) -> dict[str, tuple[Light, ...]]:
    """A soft sun; a sky with a lamp above the volume, about as bright in its middle."""
    sun, sky = scene.lights
    assert isinstance(sun, DistantLight)
    assert isinstance(sky, EnvironmentLight)
    grid, camera = scene.medium.sigma_t, scene.need_camera()
    radius = float(np.linalg.norm(np.ptp(grid.corners(), axis=0))) / 2
    away = 1.3 * radius * (0.8 * np.asarray(camera.up) - 0.6 * camera.forward)
    fluence = float(sky.fluence(grid.centre).mean())
    lamp = PointLight(grid.centre + away, fluence * float(away @ away))
    return {"sun": (sun,), "sky and lamp": (sky, lamp)}


def blocks(image: NDArray[np.floating]) -> NDArray[np.float64]:
    """Means over colours and over the whole image, then over each of its blocks."""
    grey = image.astype(np.float64).mean(axis=-1)
    parts = [part for band in np.array_split(grey, BLOCKS) for part in
             np.array_split(band, BLOCKS, axis=1)]  # fmt: skip
    return np.array([grey.mean(), *(part.mean() for part in parts)])


def photons(scene: Scene, size: tuple[int, int], seeds: int) -> Images:
    """Photon mapping's images, by blocks."""
    found = []
    for seed in range(seeds):
        given = {"noise_seed": seed, "photons": PHOTONS, "passes": PASSES}
        volume = illuminate(scene, "photon_mapping", given)
        found.append(blocks(line_integral(volume, scene.need_camera(), *size)[0]))
    return np.array(found)


def cycles(scene: Scene, size: tuple[int, int], seeds: int) -> Images:
    """Cycles' images, by blocks."""
    renderer = CyclesRenderer(scene, *size)
    # The limit leaves up to 1e-3 of the light; the test sees less.
    bounces = min(MOST, 2 * bounce_limit(scene.medium))
    return np.array(
        [blocks(renderer.reference(bounces, SAMPLES, seed)) for seed in range(seeds)]
    )  # fmt: skip


def compared(name: str, lights: str, coarse: Images, fine: Images, truth: Images) -> Row:
    """The test of one scene."""

    def mean(images: Images) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        return images.mean(0), images.var(0, ddof=1) / len(images)

    (a, var_a), (b, var_b), (c, var_c) = mean(coarse), mean(fine), mean(truth)
    limit, var_limit = (4 * b - a) / 3, (16 * var_b + var_a) / 9
    at = tuple(
        (float(x[0] / c[0]) - 1, float(np.sqrt(var[0] + var_c[0]) / c[0]))
        for x, var in ((a, var_a), (b, var_b), (limit, var_limit))
    )
    shown = c > DARK * c[0]
    var_a, var_b, var_c = var_a[shown] / 9, var_b[shown] * 16 / 9, var_c[shown]
    z = np.abs(limit - c)[shown] / np.sqrt(var_a + var_b + var_c)
    # Welch and Satterthwaite.
    freedom = (var_a + var_b + var_c) ** 2 / (
        var_a**2 / (len(coarse) - 1) + var_b**2 / (len(fine) - 1) + var_c**2 / (len(truth) - 1)
    )
    least = float((2 * stats.t.sf(z, freedom)).min())
    return Row(name, lights, at, float(z.max()), len(z), min(1.0, len(z) * least))


def rows(names: list[str], seeds: int) -> Iterator[Row]:
    """All scenes, one by one."""
    for name in names:
        whole = volumes.scene(name)
        for label, lights in set_ups(whole).items():
            scene = coarsened(replace(whole, lights=lights), VOXELS)
            size = (PIXELS, PIXELS)
            yield compared(
                name, label, photons(scene, size, seeds), photons(refined(scene), size, seeds),
                cycles(scene, size, seeds),
            )  # fmt: skip


HEAD = """# Photon mapping and Cycles

Full scattering by two renderers that share nothing: photon mapping, through the core's line
integral, over Cycles less 1, in percent, +- its standard error from {seeds} independent seeds of
each; images of {pixels} x {pixels} pixels, volumes of at most {voxels:,} voxels at the
spacing h. `make witness` writes this page and fails where the two
disagree.

Photons are counted in voxels and what they bring is interpolated between voxels: both are means
over about a voxel and err by h^2 / 8 of the second derivative of the light. On half the spacing h,
the medium being the same trilinear field, a quarter of that is left; the limit has none. The test
is of the limit: the largest |z| of the means over the image and {blocks} x {blocks} blocks of it,
as far as they show the volume, and the probability of one as large (Bonferroni, so that blocks may
be correlated; Student's t with Welch's degrees of freedom).

| volume | lights | spacing h | h / 2 | limit | largest z | of | probability |
| --- | --- | ---: | ---: | ---: | ---: | ---: | ---: |
"""


def line(row: Row) -> str:
    """A row of the table."""
    figures = " | ".join(f"{100 * value:+.2f} +- {100 * noise:.2f}" for value, noise in row.at)
    return (
        f"| {row.volume} | {row.lights} | {figures} | {row.largest:.1f} | {row.blocks} | "
        f"{row.probability:.2g} |"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description="Photon mapping against Cycles, by z-test.")
    parser.add_argument("--seeds", type=int, default=6)
    parser.add_argument("--volumes", default=",".join(volumes.SMOOTH))
    parser.add_argument("-o", "--output", type=Path)
    options = parser.parse_args()
    found = []
    for row in rows(options.volumes.split(","), options.seeds):
        found.append(row)
        print(line(row), flush=True)
    if options.output:
        head = HEAD.format(seeds=options.seeds, pixels=PIXELS, voxels=VOXELS, blocks=BLOCKS)
        options.output.write_text(head + "\n".join(map(line, found)) + "\n", encoding="utf-8")
    if min(row.probability for row in found) < LEVEL / len(found):
        sys.exit("photon mapping and Cycles disagree")


if __name__ == "__main__":
    main()
