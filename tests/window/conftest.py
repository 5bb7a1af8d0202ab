"""One system with the extension installed, for all tests of a run."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import numpy as np
import pytest
from project_files import ROOT
from window.system import System, find_system

PICTURES = ROOT / "build" / "window" / "pictures"


@pytest.fixture(scope="session")
def system(tmp_path_factory: pytest.TempPathFactory) -> System:
    """The extension is installed as a user's `blender --command extension install-file` does."""
    work = tmp_path_factory.mktemp("window")
    found = find_system(work)
    (archive,) = (ROOT / "dist").glob("*.zip")
    shutil.copy2(archive, work / "volillum.zip")
    done = found.blender(
        *("--command", "extension", "install-file", "-r", "user_default", "--enable"),
        "/volillum/volillum.zip",
    )
    assert 'Installed "volillum"' in done.stdout, done.stdout + done.stderr
    shutil.copy2(ROOT / "presets" / "volumes" / "smoke.vdb", work)
    write_files(work)
    done = found.blender(
        *("--command", "volillum", "scene", "/volillum/smoke.vdb", "--preset", "smoke"),
        *("-o", "/volillum/smoke.blend"),
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return found


def write_files(folder: Path) -> None:
    """A ball in Hounsfield units in air, a large file, a raw file that says nothing of itself; and
    a scan, where there are third-party volumes."""
    if data := os.environ.get("VOLILLUM_DATA"):
        shutil.copy2(Path(data) / "pelvis_ct" / "example_ct.nii.gz", folder / "scan.nii.gz")
    axes = np.meshgrid(*[np.linspace(-1, 1, 40)] * 3, indexing="ij")
    radius = np.sqrt(sum(axis**2 for axis in axes))
    np.save(folder / "ball.npy", (-1000 + 2500 * np.clip(1 - radius, 0, 1)).astype(np.int16))
    (folder / "ball.json").write_text('{"kind": "ct", "unit": "HU", "length_unit": "mm"}')
    # Noise takes a while to write.
    noise = np.random.default_rng(1).integers(-1000, 2000, (256, 256, 256), np.int16)
    np.save(folder / "large.npy", noise)
    (folder / "plain.raw").write_bytes(bytes(1000))


@pytest.fixture
def pictures() -> Path:
    """Where screenshots are kept to be looked at."""
    PICTURES.mkdir(parents=True, exist_ok=True)
    return PICTURES
