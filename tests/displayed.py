"""Baked volumes, and Blender's image of them beside the core's line integral."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from blender_scenes import (
    blob,
    centred,
)
from numpy.typing import NDArray

from volillum_addon.bake.vdb import write_vdb
from volillum_addon.blender.cycles import CyclesRenderer
from volillum_addon.blender.display import add_volume, display_material
from volillum_addon.blender.render import (
    add_camera,
    clip_range,
    depth_range,
    render_image,
    set_cycles,
    set_eevee,
)
from volillum_addon.blender.sandbox import sandbox
from volillum_addon.core import harmonics
from volillum_addon.core.camera import Camera
from volillum_addon.core.grid import Grid
from volillum_addon.core.lights import EnvironmentLight, Light
from volillum_addon.core.medium import Medium
from volillum_addon.core.scene import Scene
from volillum_addon.models.illuminate import relight
from volillum_addon.models.image import line_integral
from volillum_addon.models.registry import get
from volillum_addon.models.volume import IlluminationVolume

SIZE = 64
SKY = EnvironmentLight((0.2, 0.3, 0.5))


def coordinates(grid: Grid) -> NDArray[np.float64]:
    """World positions [i, j, k, 3] of the voxels."""
    index = np.stack(np.meshgrid(*(np.arange(n) for n in grid.shape), indexing="ij"), -1)
    return grid.to_world(index.astype(np.float64))


def expansion(medium: Medium, lights: tuple[Light, ...], order: int = 2) -> IlluminationVolume:
    """A volume as spherical harmonics bake it: smooth fields of both signs for coefficients."""
    where = coordinates(medium.sigma_t)
    values = get("spherical_harmonics").values({"order": order})
    count = harmonics.count(order)
    planes = [
        np.cos((1 + index % 3) * where[..., index % 3] + index) * 3 / (1 + index)
        for index in range(count)
    ]
    planes[0] = planes[0] + 4
    channels = {}
    for first in range(0, count, 3):
        pack = planes[first : first + 3] + [np.zeros(where.shape[:3])] * (3 - count + first)
        name = f"coefficients_{first // 3}"
        channels[name] = medium.sigma_t.with_values(np.stack(pack, -1).astype(np.float32), name)
    model = get("spherical_harmonics")
    return IlluminationVolume(
        "spherical_harmonics", values, medium, channels, model.radiance(lights, medium, values),
        image_emission=True,
    )  # fmt: skip


def smooth() -> Medium:
    """A Gaussian blob of optical depth 5, albedo tinted."""
    return Medium.from_density(blob(64, 2, 8, "density"), 1.0, (0.9, 0.8, 0.6))


def hard() -> Medium:
    """Opaque balls with edges one voxel wide, optical depth 0.6 a voxel, albedo 0.8."""
    rng = np.random.default_rng(1)
    grid = Grid(np.zeros((64,) * 3, np.float32), centred((64,) * 3, 2 / 64), "density")
    where = coordinates(grid)
    for _ in range(12):
        centre, radius = rng.uniform(-0.6, 0.6, 3), rng.uniform(0.1, 0.35)
        grid.values[((where - centre) ** 2).sum(-1) < radius**2] = 20
    return Medium.from_density(grid, 1.0, 0.8)


def compared(
    volume: IlluminationVolume,
    lights: tuple[Light, ...],
    camera: Camera,
    folder: Path,
    samples: int | None,
    size: int = SIZE,
    subpixels: int = 1,
) -> tuple[float, float]:
    """Bias and RMSE of Blender's image (Cycles; EEVEE without samples), shares of the mean."""
    path = folder / "bake.vdb"
    write_vdb(volume, path)
    renderer = CyclesRenderer(Scene(volume.medium, lights, camera), size, size)
    if samples is None:
        image = renderer.display_eevee(path)
    else:
        image = renderer.display(path, samples, subpixels=subpixels)
    wanted, transmittance = line_integral(relight(volume, lights), camera, size, size)
    inside = transmittance.mean(-1) < 0.98
    assert 0.1 < inside.mean() < 0.95
    assert np.abs(image[~inside]).max() < 0.03 * wanted.max(), "no light outside"
    error, mean = (image - wanted)[inside], wanted[inside].mean()
    return abs(float(error.mean() / mean)), float(np.sqrt((error**2).mean()) / mean)


def display_and_integral(
    volume: IlluminationVolume, camera: Camera, folder: Path, eevee: bool = False
) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
    """Cycles' or EEVEE's image by the volume's own radiance terms, and the line integral."""
    with sandbox() as (scene, own):
        path = folder / "product.vdb"
        write_vdb(volume, path)
        add_volume(scene, path, display_material("display", volume))
        add_camera(scene, camera, clip_range(camera, volume.medium.sigma_t.corners()))
        set_cycles(scene, 1, 0)
        scene.cycles.volume_biased = True
        if eevee:
            set_eevee(scene, depth_range(camera, volume.medium.sigma_t.corners()))
        image = render_image(scene, SIZE, SIZE, own)[..., :3]
    return image, line_integral(volume, camera, SIZE, SIZE)[0]
