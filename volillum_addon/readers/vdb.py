"""OpenVDB files through Blender's own OpenVDB: a scalar grid, dense over its active box, or over
the whole volume where an import of ours wrote it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..core.errors import bad
from .imported import is_imported, read_imported
from .layers import sliced
from .source import Options, Source, choose_channel


def read(path: Path, options: Options) -> Source:
    """A grid of the file: the one asked for, the only one, or `density`."""
    from ..bake.grids import read_grid

    if is_imported(path) and options.grid is None:
        grid, about = read_imported(path)
        return Source(
            path,
            "VDB",
            grid.shape,
            grid.index_to_world,
            np.dtype(np.float32),
            sliced(grid.values),
            about.kind,
            about.unit,
            about.length_unit,
            about.space,
            about.notes,
        )
    grid = read_grid(path, options.grid)
    values = grid.values
    if grid.channels == 3:
        values = values[..., choose_channel(3, options, path)]
    if not np.all(np.isfinite(values)):
        raise bad(str(path), "not finite", "numbers")
    return Source(path, "VDB", grid.shape, grid.index_to_world, np.dtype(np.float32),
                  sliced(values))  # fmt: skip
