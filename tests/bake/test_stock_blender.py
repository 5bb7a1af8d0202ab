"""Stock Blender reads the files: names, types and places of the grids."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
from bake.conftest import TRANSFORMS, blob, volume

from volillum_addon.bake.cold import child_environment
from volillum_addon.bake.vdb import write_vdb
from volillum_addon.core.medium import Medium

READER = """
import json, sys
from pathlib import Path
import bpy
found = {}
for path in sorted(Path(sys.argv[1]).glob("*.vdb")):
    data = bpy.data.volumes.new(path.stem)
    data.filepath = str(path)
    loaded = data.grids.load()
    found[path.stem] = {
        "loaded": loaded, "error": data.grids.error_message,
        "grids": {g.name: [g.data_type, [list(r) for r in g.matrix_object]] for g in data.grids},
    }
print("found " + json.dumps(found))
"""


def test_blender_reads_names_types_and_places(tmp_path: Path) -> None:
    for name, transform in TRANSFORMS.items():
        for half in (False, True):
            given = volume(Medium.from_density(blob(transform), 2.0, 0.9))
            write_vdb(given, tmp_path / f"{name} {half}.vdb", half=half)
    done = subprocess.run(
        [sys.executable, "-c", READER, str(tmp_path)],
        capture_output=True, text=True, timeout=100, check=False,
        env=child_environment(),
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    line = next(line for line in done.stdout.splitlines() if line.startswith("found "))
    found = json.loads(line.removeprefix("found "))
    assert len(found) == 2 * len(TRANSFORMS)
    for stem, file in found.items():
        assert file["loaded"], file["error"]
        kinds = {name: kind for name, (kind, _) in file["grids"].items()}
        assert kinds == {
            "density": "FLOAT",
            "volillum_visibility": "FLOAT",
            "volillum_colour": "VECTOR_FLOAT",
        }
        expected = TRANSFORMS[stem.split()[0]]
        for _, matrix in file["grids"].values():
            # Blender's matrices are float32: half an epsilon of the largest element.
            np.testing.assert_allclose(
                matrix, expected, rtol=0, atol=2.0**-24 * np.abs(expected).max()
            )


def test_openvdb_is_found_without_importing_bpy() -> None:
    code = (
        "import sys; from volillum_addon.bake.openvdb_module import openvdb; "
        "before = list(sys.path); openvdb().FloatGrid(); "
        "assert 'bpy' not in sys.modules; assert sys.path == before; "
        "import bpy; bpy.utils.expose_bundled_modules(); import openvdb as again; "
        "assert again is openvdb()"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=100, check=False,
        env=child_environment(),
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
