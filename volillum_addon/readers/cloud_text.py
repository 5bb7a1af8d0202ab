"""Clouds of large-eddy simulations as text: liquid water content and droplet radius by cell, as the
3D radiative transfer codes exchange them (AT3D, SHDOM's "cloud field" tables).

    # a comment
    nx,ny,nz
    dx,dy                    km
    z_1,...,z_nz             km, of the cells' centres
    i,j,k,lwc,reff           this line, then rows: g/m^3, micrometres; cells left out are clear

What is read is the extinction, per metre: 3 LWC / (2 rho_water r_eff), geometric optics.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..core.errors import bad
from .layers import sliced
from .source import Options, Source, check_shape, check_unpacked, file_size, library
from .text_header import numbers

EXPECTED = "a cloud table: sizes, dx,dy, levels and rows of i,j,k,lwc,reff"
# Level heights may differ from even spacing by this share of it (they are rounded text).
EVEN = 1e-3
KM = 1000.0


def read(path: Path, _options: Options) -> Source:
    """The extinction of the cloud on a lattice in metres."""
    with library(path, EXPECTED):
        lines = path.read_text(encoding="utf-8").splitlines()
    if len(lines) < 5:
        raise bad(str(path), f"{len(lines)} lines long", EXPECTED)
    first = [line.split("#")[0] for line in lines[1:4]]
    nx, ny, nz = numbers(first[0], int, 3, "its sizes (line 2)", path)
    check_shape((nx, ny, nz), path)
    check_unpacked(path, 4 * nx * ny * nz, file_size(path))
    dx, dy = (KM * n for n in numbers(first[1], float, 2, "its dx, dy (line 3)", path))
    levels = KM * np.array(numbers(first[2], float, nz, "its levels (line 4)", path))
    steps = np.diff(levels) if nz > 1 else np.ones(1)
    with np.errstate(over="ignore", invalid="ignore"):
        even = np.all(np.abs(steps - steps.mean()) <= EVEN * abs(steps.mean()))
    if not even:
        raise bad(
            "its levels", f"{steps.min():g} to {steps.max():g} m apart", "even ones", str(path)
        )
    with library(path, EXPECTED):
        rows = [line for line in lines[5:] if line.strip() and not line.startswith("#")]
        table = np.array([[float(part) for part in row.split(",")] for row in rows])
        table = table.reshape(len(rows), -1)
    if table.shape[1] != 5:
        raise bad("its rows", f"{table.shape[1]} numbers long", "i,j,k,lwc,reff", str(path))
    index = table[:, :3]
    lwc, radius = table[:, 3], table[:, 4]
    for wrong, what in (
        ((index < 0) | (index >= (nx, ny, nz)) | (index != np.round(index)), "i,j,k in the volume"),
        (~(np.isfinite(lwc) & (lwc >= 0) & (radius > 0))[:, None], "lwc of 0 up, reff above 0"),
    ):
        rows_wrong = np.flatnonzero(wrong.any(axis=1))
        if len(rows_wrong):
            raise bad(f"row {rows_wrong[0] + 1} of its cells", rows[rows_wrong[0]][:80], what,
                      str(path))  # fmt: skip
    values = np.zeros((nx, ny, nz), np.float32)
    # Water of 1e6 g/m^3 and radii in micrometres: the powers of ten cancel.
    with np.errstate(over="ignore"):  # what is infinite is refused with its place
        values[tuple(index.astype(int).T)] = 1.5 * lwc / radius
    matrix = np.diag([dx, dy, float(steps.mean()), 1.0])
    matrix[2, 3] = levels[0]
    return Source(path, "cloud table", (nx, ny, nz), matrix, np.dtype(np.float32), sliced(values),
                  kind="cloud", unit="1/m", length_unit="m")  # fmt: skip
