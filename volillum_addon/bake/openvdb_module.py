"""The one place that finds OpenVDB's Python module."""

from __future__ import annotations

import importlib
import importlib.machinery
import importlib.util
import sys
from functools import cache
from pathlib import Path
from typing import Any


@cache
def openvdb() -> Any:
    """The module `openvdb`: Blender's own inside Blender, else the one bundled with `bpy`.

    bpy itself is not imported, and sys.path stays as it is. Raises ImportError.
    """
    try:
        return importlib.import_module("openvdb")
    except ModuleNotFoundError:
        pass
    found = _bundled_with_bpy()
    if found is None:
        raise ImportError(
            "OpenVDB's Python module (openvdb) is not there; expected Blender's Python, or the "
            "bpy package in this one (pip install bpy)"
        )
    spec = importlib.util.spec_from_file_location("openvdb", found)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    # Known by its name from now on: a second copy would not know the first one's types.
    sys.modules["openvdb"] = module
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules["openvdb"]
        raise
    return module


def _bundled_with_bpy() -> Path | None:
    """bpy/<version>/python/lib/[python3.x/]site-packages/openvdb.<suffix>, the newest."""
    bpy = importlib.util.find_spec("bpy")
    for folder in (bpy.submodule_search_locations or ()) if bpy else ():
        for suffix in importlib.machinery.EXTENSION_SUFFIXES:
            for packages in ("lib/python*/site-packages", "lib/site-packages"):
                files = sorted(Path(folder).glob(f"*/python/{packages}/openvdb{suffix}"))
                if files:
                    return files[-1]
    return None
