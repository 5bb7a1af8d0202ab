"""A row of models in one view, and two bakes in turn."""

from __future__ import annotations

import os
from pathlib import Path
from types import SimpleNamespace

import bpy
import numpy as np
import pytest
from recording_layout import RecordingLayout

from volillum_addon.bake.vdb import read_metadata
from volillum_addon.blender import panels, side_by_side, work
from volillum_addon.blender.placing import lattice_corners
from volillum_addon.blender.render import render_image, set_cycles
from volillum_addon.models.registry import MODELS


@pytest.fixture(autouse=True)
def quick(scene: bpy.types.Scene) -> None:
    for model in MODELS:
        group = getattr(scene.volillum, model)
        if "directions" in group.bl_rna.properties:
            group.directions = 8
    scene.volillum.photon_mapping.passes = 2
    scene.volillum.model = "multidirectional_occlusion"


def volumes(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    return [each for each in scene.objects if each.type == "VOLUME" and not each.hide_render]


def blocks() -> set[str]:
    """All data-blocks but Blender's own, which come with the first text and render, and stay."""
    found = bpy.data.user_map()
    own = (bpy.types.VectorFont, bpy.types.Image)
    return {repr(each) for each in found if not isinstance(each, own)}


def test_all_models_stand_in_a_row_with_their_names(scene: bpy.types.Scene, tmp_path: Path) -> None:
    source = volumes(scene)[0]
    before = blocks()
    assert bpy.ops.volillum.side_by_side() == {"FINISHED"}
    row = scene.volillum.exhibit
    assert row is not None
    shown = [each for each in row.objects if each.type == "VOLUME"]
    names = [each.data.body for each in row.objects if each.type == "FONT"]
    assert [" ".join(name.split()) for name in names] == [each.label for each in MODELS.values()]
    assert max(len(line) for name in names for line in name.split("\n")) <= side_by_side.LETTERS
    assert volumes(scene) == shown
    assert source.hide_render
    right = np.array(scene.camera.matrix_world)[:3, 0]
    along = np.array([np.array(each.location) @ right for each in shown])
    steps = np.diff(along)
    # Evenly from left to right about the volume's place, no two over each other.
    np.testing.assert_allclose(steps, steps[0], rtol=1e-5)
    assert abs(along.mean()) < 1e-5 * steps[0]
    corners = lattice_corners(read_metadata(Path(bpy.path.abspath(shown[0].data.filepath))))
    assert steps[0] > np.ptp(corners @ right)
    # Each is seen where it should be: light in every seventh of the picture.
    scene.camera.location = (
        np.array(scene.camera.location) + 14 * steps[0] * np.array(scene.camera.matrix_world)[:3, 2]
    )
    scene.camera.data.clip_end = 1e4
    set_cycles(scene, 4, 1)
    scene.cycles.volume_biased = True
    pixels = render_image(scene, 420, 60, tmp_path)
    if os.environ.get("VOLILLUM_KEEP_PICTURES"):
        render_image(scene, 1400, 260, Path(os.environ["VOLILLUM_KEEP_PICTURES"]))
    light = pixels[..., :3].sum((0, 2))
    lit = np.flatnonzero(light > 0.02 * light.max())
    parts = np.split(lit, np.flatnonzero(np.diff(lit) > 4) + 1)
    assert len(parts) >= len(shown)
    assert bpy.ops.volillum.clear_row() == {"FINISHED"}
    assert volumes(scene) == [source]
    assert blocks() == before


def test_a_model_that_cannot_serve_the_scene_is_named(scene: bpy.types.Scene) -> None:
    reading = work.read(scene)
    chosen = work.chosen_models(scene, ("multidirectional_occlusion", "spherical_harmonics"))
    sky_only = type(reading.scene)(reading.scene.medium, reading.scene.lights[1:])
    from dataclasses import replace

    from volillum_addon.core.control import Control

    directory = Path(scene.volillum.directory)
    bakes = work.bake_all(replace(reading, scene=sky_only), chosen, directory, Control())
    assert [each.model for each in bakes.done] == ["spherical_harmonics"]
    assert "knows only lights of the kinds" in bakes.refused[0]


def test_two_bakes_in_turn(scene: bpy.types.Scene) -> None:
    assert not bpy.ops.volillum.swap.poll()
    bpy.ops.volillum.bake()
    first = scene.volillum.baked.path
    assert not bpy.ops.volillum.swap.poll()
    bpy.ops.volillum.bake()  # found: still the one
    assert not bpy.ops.volillum.swap.poll()
    scene.volillum.model = "ambient_occlusion"
    bpy.ops.volillum.bake()
    second = scene.volillum.baked.path
    layout = RecordingLayout()
    panels.VOLILLUM_PT_bake.draw(SimpleNamespace(layout=layout), SimpleNamespace(scene=scene))
    assert f"A/B: {MODELS['multidirectional_occlusion'].label}" in layout.labels()
    for path, model in ((first, "multidirectional_occlusion"), (second, "ambient_occlusion")) * 2:
        assert bpy.ops.volillum.swap() == {"FINISHED"}
        assert (scene.volillum.baked.path, scene.volillum.baked.model) == (path, model)
        shown = scene.volillum.baked.shown
        assert bpy.path.abspath(shown.data.filepath) == path
        assert len(volumes(scene)) == 1
    Path(first).unlink()
    with pytest.raises(RuntimeError, match=r"VDB|read|there"):
        bpy.ops.volillum.swap()
    # Nothing was lost.
    assert scene.volillum.baked.path == second
    assert len(volumes(scene)) == 1
