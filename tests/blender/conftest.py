"""The extension in this process's Blender, and a scene to use it on."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import bpy
import pytest
from command_line import session
from plumes import plume_scene, write_plume

import volillum_addon
from volillum_addon.blender.jobs import Job, Work
from volillum_addon.models.registry import MODELS


@pytest.fixture(scope="module")
def extension() -> Iterator[None]:
    volillum_addon.register()
    yield
    volillum_addon.unregister()


@pytest.fixture
def scene(extension: None, tmp_path: Path) -> Iterator[bpy.types.Scene]:
    with plume_scene(tmp_path / "plume.vdb") as made:
        made.volillum.directory = str(tmp_path / "out")
        with bpy.context.temp_override(scene=made):
            yield made


@pytest.fixture
def quick_models(scene: bpy.types.Scene) -> bpy.types.Scene:
    """The scene, with settings that let every model bake, and its error be known, in an instant."""
    settings = scene.volillum
    settings.noise, settings.budget = 10, 5
    for model in MODELS:
        group = getattr(settings, model)
        if "directions" in group.bl_rna.properties:
            group.directions = 8
    settings.photon_mapping.passes = 2
    settings.model = "multidirectional_occlusion"
    return scene


@pytest.fixture
def start_job() -> Iterator[Callable[[Work[Any]], Job[Any]]]:
    """Starts jobs that are over when the test is."""
    jobs: list[Job[Any]] = []

    def start(work: Work[Any]) -> Job[Any]:
        jobs.append(Job("Test", work))
        return jobs[-1]

    yield start
    for job in jobs:
        job.cancel()
        with contextlib.suppress(Exception):
            job.result()


@pytest.fixture
def no_file_left_open() -> Iterator[None]:
    """For tests that open files: paths would be relative to the last of them in others."""
    yield
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with plume.vdb and plume.blend."""
    folder = tmp_path_factory.mktemp("made")
    write_plume(folder / "plume.vdb")
    (result,) = session(folder, ["scene", "plume.vdb", "-o", "plume.blend"])
    assert (result.status, result.out, result.err) == (0, "plume.blend\n", "")
    assert sorted(path.suffix for path in folder.iterdir()) == [".blend", ".json", ".json", ".vdb"]
    return folder
