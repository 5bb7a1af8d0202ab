"""Small volumes and Blender scenes for the tests."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
from mathutils import Matrix
from numpy.typing import ArrayLike, NDArray

from volillum_addon.bake.openvdb_module import openvdb
from volillum_addon.blender.render import render_image, set_cycles
from volillum_addon.core.camera import Camera
from volillum_addon.core.grid import Grid
from volillum_addon.core.medium import Medium
from volillum_addon.models.volume import Factor, IlluminationVolume, RadianceTerm


def centred(voxels: tuple[int, int, int], voxel: ArrayLike) -> NDArray[np.float64]:
    """index_to_world of a lattice about the origin."""
    size = np.broadcast_to(np.asarray(voxel, np.float64), (3,))
    affine = np.diag([*size, 1.0])
    affine[:3, 3] = -(np.array(voxels) - 1) / 2 * size
    return affine


def block(voxels: int | tuple[int, int, int], voxel: ArrayLike, value: float, name: str) -> Grid:
    """A uniform box about the origin."""
    shape = (voxels,) * 3 if isinstance(voxels, int) else voxels
    return Grid(np.full(shape, value, np.float32), centred(shape, voxel), name)


def blob(voxels: int, side: float, peak: float, name: str) -> Grid:
    """A Gaussian blob that has all but vanished at its box's border."""
    affine = centred((voxels,) * 3, side / voxels)
    index = np.stack(np.meshgrid(*[np.arange(voxels)] * 3, indexing="ij"), -1)
    world = index @ affine[:3, :3].T + affine[:3, 3]
    values = peak * np.exp(-(world**2).sum(-1) / (2 * (side / 8) ** 2))
    return Grid(values.astype(np.float32), affine, name)


def orthographic(height: float, side: int = 2, sign: int = 1) -> Camera:
    """A camera that looks along an axis at the origin."""
    return Camera(
        np.eye(3)[side] * sign * 10, (0, 0, 0), np.eye(3)[(side + 1) % 3], orthographic=True,
        height=height,
    )  # fmt: skip


def perspective(distance: float = 3.0, fov: float = 0.5) -> Camera:
    """A camera that looks at the origin from a direction along no axis."""
    return Camera(np.array([0.6, -0.7, 0.4]) * distance, (0, 0, 0), fov=fov)


def lit(
    medium: Medium, *radiance: tuple[str, Grid, tuple[float, float, float], int | None]
) -> IlluminationVolume:
    """A volume whose radiance is a sum of weight * channel: (name, grid, weight, component)."""
    return IlluminationVolume(
        model="spherical_harmonics",
        parameters={},
        medium=medium,
        channels={name: grid for name, grid, _, _ in radiance},
        radiance=tuple(
            RadianceTerm((Factor(name, part),), weight) for name, _, weight, part in radiance
        ),
    )


def write_grids(path: Path, *grids: Grid) -> Path:
    """The grids as a plain VDB file."""
    written = []
    for grid in grids:
        vdb = openvdb().FloatGrid() if grid.channels == 1 else openvdb().Vec3SGrid()
        vdb.copyFromArray(grid.values)
        vdb.transform = openvdb().createLinearTransform(grid.index_to_world.T.tolist())
        vdb.name = grid.name
        written.append(vdb)
    openvdb().write(str(path), grids=written)
    return path


def new_scene(
    path: Path, matrix: ArrayLike | None = None
) -> tuple[bpy.types.Scene, bpy.types.Object]:
    """An empty scene with a volume object of the file (WORLD space, full precision)."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    data = bpy.data.volumes.new("volume")
    data.filepath = str(path)
    data.render.space, data.render.precision = "WORLD", "FULL"
    placed = bpy.data.objects.new("volume", data)
    scene.collection.objects.link(placed)
    if matrix is not None:
        placed.matrix_world = Matrix(np.asarray(matrix).tolist())
    return scene, placed


def add_light(
    scene: bpy.types.Scene, kind: str, energy: float, matrix: ArrayLike | None = None
) -> bpy.types.Object:
    """A light object."""
    data = bpy.data.lights.new(kind, kind)
    data.energy = energy
    placed = bpy.data.objects.new(kind, data)
    scene.collection.objects.link(placed)
    if matrix is not None:
        placed.matrix_world = Matrix(np.asarray(matrix).tolist())
    return placed


def clear() -> bpy.types.Scene:
    """An empty file's scene."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    return bpy.context.scene


def single_scattering(cosine: NDArray[np.float64] | float, depth: float) -> NDArray[np.float64]:
    """Single scattering of a plane layer of optical depth `depth` toward its normal, per source
    function of 1: the integral of exp(-t) times the light's transmittance to the depth t.

    Light from the viewer's side (cosine > 0) or from behind (< 0).
    """
    mu = np.abs(np.asarray(cosine, np.float64))
    mu = np.where(np.abs(mu - 1) < 1e-9, 1 - 1e-9, np.maximum(mu, 1e-9))
    front = (1 - np.exp(-depth * (1 + 1 / mu))) / (1 + 1 / mu)
    behind = (np.exp(-depth) - np.exp(-depth / mu)) / (1 / mu - 1)
    return np.where(np.asarray(cosine) > 0, front, behind)


def render(
    scene: bpy.types.Scene, folder: Path, samples: int, size: int = 16, seed: int = 1
) -> NDArray[np.float64]:
    """Pixels [n, 3] of the scene's single scattering, as Cycles' ray march gives it."""
    set_cycles(scene, samples, seed)
    scene.cycles.volume_biased = True
    scene.cycles.volume_step_rate = 0.5
    scene.cycles.max_bounces = scene.cycles.volume_bounces = 0
    return render_image(scene, size, size, folder)[..., :3].reshape(-1, 3).astype(np.float64)


def assert_mean(pixels: NDArray[np.float64], expected: ArrayLike, relative: float = 2e-3) -> None:
    """The mean over pixels [n, 3] is `expected` within four standard errors, which have to be
    below `relative`, and 3e-4 for the steps of the ray march."""
    mean, error = pixels.mean(0), pixels.std(0, ddof=1) / np.sqrt(len(pixels))
    wanted = np.broadcast_to(np.asarray(expected, np.float64), (3,))
    assert np.all(error <= relative * np.maximum(wanted, wanted.max() * 0.01)), error / wanted
    assert np.all(np.abs(mean - wanted) <= 4 * error + 3e-4 * wanted), (mean / wanted, error)
