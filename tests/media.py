"""Media with closed forms, as voxel grids."""

from __future__ import annotations

import numpy as np

from volillum_addon.core.grid import Grid
from volillum_addon.core.medium import Medium

# A lateral voxel this many times as long as the slab is deep makes a half space of three voxels:
# rays that leave by the side have cosines below 1e-4 and carry less than exp(-1e4) of the light.
SIDEWAYS = 1e4


# Optical depth below the receiver that is as good as endless for light from below: e^-10 = 5e-5.
ENDLESS = 10.0


def half_space(depth: float, slices: int = 8, below: float = 0.25) -> tuple[Medium, np.ndarray]:
    """A medium of sigma_t = 1 below z = 0, and a voxel centre at optical depth `depth` [3].

    `below` is how much of it lies below that voxel; ENDLESS where light from below matters.

    The trilinear border (1 at the last voxel, 0 one voxel further) has the optical depth of half a
    voxel, so the voxel `slices` below the top is slices + 1/2 voxels deep along any direction.
    """
    step = depth / (slices + 0.5)
    under = int(np.ceil(below / step))
    affine = np.diag([SIDEWAYS, SIDEWAYS, step, 1.0])
    affine[2, 3] = -depth - under * step
    grid = Grid(np.ones((3, 3, slices + 1 + under), np.float32), affine, "half space")
    return Medium(grid, grid), grid.to_world(np.array([1.0, 1.0, float(under)]))


def ball(
    radius_voxels: float, optical_radius: float, margin: int = 1, shift: float = 0.0
) -> Medium:
    """A homogeneous ball about the middle voxel, of world radius 1 and the given optical radius.

    Voxels hold the share of 8 x 8 x 8 points inside the ball, so its surface is blurred by one
    voxel and its volume is right to 1e-3.
    """
    half = int(np.ceil(radius_voxels)) + margin
    fine = (np.arange(-half * 8 - 4, half * 8 + 4) + 0.5) / 8 + shift
    squares = fine**2
    inside = np.zeros((2 * half + 1,) * 3, np.float32)
    for index in range(2 * half + 1):
        part = squares[index * 8 : index * 8 + 8]
        distance = part[:, None, None] + squares[None, :, None] + squares[None, None]
        hit = (distance <= radius_voxels**2).mean(axis=0, dtype=np.float32)
        size = 2 * half + 1
        inside[index] = hit.reshape(size, 8, size, 8).mean(axis=(1, 3))
    affine = np.diag([1 / radius_voxels] * 3 + [1.0])
    affine[:3, 3] = -half / radius_voxels
    grid = Grid(inside * np.float32(optical_radius), affine, "ball")
    return Medium(grid, grid)


def smooth_random(shape: tuple[int, int, int], seed: int, depth: float = 4.0) -> Medium:
    """A smooth positive random field, optical depth about `depth` across, extent about 1."""
    rng = np.random.default_rng(seed)
    spectrum = np.fft.rfftn(rng.normal(size=shape))
    frequencies = np.meshgrid(
        np.fft.fftfreq(shape[0]) * shape[0],
        np.fft.fftfreq(shape[1]) * shape[1],
        np.fft.rfftfreq(shape[2]) * shape[2],
        indexing="ij",
    )
    spectrum *= np.exp(-sum(f**2 for f in frequencies) / 8)
    field = np.fft.irfftn(spectrum, shape, axes=(0, 1, 2))
    field = np.exp(field / field.std())
    edge = np.meshgrid(*(np.sin(np.pi * (np.arange(n) + 0.5) / n) for n in shape), indexing="ij")
    field *= edge[0] * edge[1] * edge[2]
    spacing = 1 / max(shape)
    affine = np.diag([spacing, spacing, spacing, 1.0])
    values = (field / field.mean() * depth).astype(np.float32)
    grid = Grid(values, affine, "random")
    return Medium(grid, grid)


def value_at(grid: Grid, point: np.ndarray) -> np.ndarray:
    """The voxel value whose centre is `point`."""
    index = grid.to_index(point)
    nearest = np.rint(index).astype(int)
    assert np.allclose(index, nearest, atol=1e-3), "not a voxel centre"
    return np.asarray(grid.values[tuple(nearest)])


def coloured(
    shape: tuple[int, int, int], seed: int, albedo: tuple[float, float, float] = (0.9, 0.5, 0.2)
) -> Medium:
    """A smooth medium whose extinction and albedo have colour and vary."""
    sigma_t = np.stack([smooth_random(shape, seed + i).sigma_t.values for i in range(3)], -1)
    blend = smooth_random(shape, seed + 7).sigma_t.values
    blend = (blend / blend.max())[..., None]
    sigma_s = sigma_t * (albedo * (1 - blend) + np.array([0.3, 0.8, 0.9]) * blend)
    grid = smooth_random(shape, seed).sigma_t
    return Medium(grid.with_values(sigma_t), grid.with_values(sigma_s.astype(np.float32)))
