"""From a Source to a Grid: slab by slab, at a level of detail, watched and cancellable."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..bake.grids import MOST_VOXELS
from ..bake.memory import available_bytes
from ..core.control import Control
from ..core.errors import InputError, bad, number
from ..core.grid import Grid
from .source import Source

# A slab of about this many voxels at a time: a cancel is noticed after so much work.
SLAB_VOXELS = 1 << 22
# Bytes a voxel of the result needs at most while it becomes a VDB file: the values, their copy in
# OpenVDB's tree, the file's buffer.
BYTES_PER_VOXEL = 12
# Coarser than this no volume is worth a look.
MOST_LEVEL = 8


def coarse_shape(shape: tuple[int, int, int], level: int) -> tuple[int, int, int]:
    """Voxels at a level: each is the mean of (2^level)^3, or of what is there at the far ends."""
    nx, ny, nz = (-(-n // (1 << level)) for n in shape)
    return nx, ny, nz


def gather(source: Source, level: int = 0, control: Control | None = None) -> Grid:
    """The source's voxels as float32, averaged over blocks of 2^level voxels along each axis.

    Raises InputError for damaged data, NaN or infinity, or more than fits into the memory (it
    names the level that does), Cancelled.
    """
    level = round(number("the level of detail", level, 0, MOST_LEVEL))
    shape = coarse_shape(source.shape, level)
    _check_memory(source, level)
    watch = control or Control()
    values = np.empty(shape, np.float32)
    block = 1 << level
    depth = max(1, SLAB_VOXELS // (source.shape[0] * source.shape[1]) // block) * block
    layer = 0
    for slab in source.slabs(depth):
        thick = (slab.shape[2] + block - 1) // block
        values[:, :, layer : layer + thick] = _coarse(_float32(slab, source), block)
        layer += thick
        watch.report(layer / shape[2])
        watch.check()
    if layer != shape[2]:
        raise bad("its data", f"{layer * block} layers", f"{source.shape[2]}", str(source.path))
    matrix = source.index_to_world.copy()
    # The middle of the first block, in voxels.
    matrix[:3, 3] += matrix[:3, :3] @ np.full(3, (block - 1) / 2)
    matrix[:3, :3] *= block
    try:
        return Grid(values, matrix, source.path.stem)
    except InputError as error:
        raise InputError(f"{error} (in {source.path})") from None


def _float32(slab: NDArray[np.generic], source: Source) -> NDArray[np.float32]:
    if slab.dtype == np.float32:
        return slab  # type: ignore[return-value]
    with np.errstate(over="ignore"):
        values = slab.astype(np.float32)
    if slab.dtype.itemsize > 4 and np.any(np.isinf(values) & np.isfinite(slab.astype(np.float64))):
        raise bad("its largest value", f"beyond {np.finfo(np.float32).max:g}", "a float32",
                  str(source.path))  # fmt: skip
    return values


def _coarse(values: NDArray[np.float32], block: int) -> NDArray[np.float32]:
    """Means over blocks; a block that reaches over the end is the mean of what there is of it."""
    if block == 1:
        return values
    result = values.astype(np.float64)
    for axis in range(3):
        starts = np.arange(0, result.shape[axis], block)
        counts = np.minimum(block, result.shape[axis] - starts)
        sums = np.add.reduceat(result, starts, axis=axis)
        result = sums / counts.reshape([-1 if a == axis else 1 for a in range(3)])
    return result.astype(np.float32)


def _check_memory(source: Source, level: int) -> None:
    def voxels(at: int) -> int:
        nx, ny, nz = coarse_shape(source.shape, at)
        return nx * ny * nz

    room = available_bytes() or MOST_VOXELS * BYTES_PER_VOXEL
    most = min(MOST_VOXELS, room // BYTES_PER_VOXEL)
    if voxels(level) <= most:
        return
    fits = next((at for at in range(level, MOST_LEVEL + 1) if voxels(at) <= most), None)
    size = " x ".join(map(str, coarse_shape(source.shape, level)))
    advice = "a smaller volume" if fits is None else f"level {fits} (--level {fits}) or coarser"
    raise bad(source.path.name, f"{size} voxels at level {level}",
              f"at most {most} with {room / 1e9:.1f} GB of free memory: {advice}")  # fmt: skip
