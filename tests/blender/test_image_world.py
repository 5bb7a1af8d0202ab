"""Bakes under a world with an image: fresh when made, stale when the image's light changes."""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from volillum_addon.blender import outline, staleness, work
from volillum_addon.blender.light_builder import build_world
from volillum_addon.core.lights import EnvironmentLight


def image_world(seed: int = 0) -> bpy.types.World:
    pixels = np.random.default_rng(seed).random((16, 32, 3))
    return build_world((EnvironmentLight(pixels),))


@pytest.fixture
def under_image(quick_models: bpy.types.Scene) -> bpy.types.Scene:
    quick_models.world = image_world()
    return quick_models


def changes(scene: bpy.types.Scene) -> tuple[str, ...]:
    scene.view_layers[0].update()
    return staleness.changes(scene, work.chosen_volume(scene))


def node(scene: bpy.types.Scene, kind: str) -> bpy.types.Node:
    return next(each for each in scene.world.node_tree.nodes if each.bl_idname == kind)


def test_a_bake_is_fresh_until_the_image_turns(under_image: bpy.types.Scene) -> None:
    scene = under_image
    scene.volillum.model = "photon_mapping"
    bpy.ops.volillum.bake()
    assert changes(scene) == ()
    node(scene, "ShaderNodeMapping").inputs["Rotation"].default_value[2] += 0.5
    assert changes(scene) == ("the light shape has changed",)


def test_another_image_makes_it_stale(under_image: bpy.types.Scene) -> None:
    scene = under_image
    scene.volillum.model = "photon_mapping"
    bpy.ops.volillum.bake()
    scene.world = image_world(seed=1)
    assert changes(scene) == ("the light shape has changed",)


def test_only_another_highest_lit_band_makes_it_stale(under_image: bpy.types.Scene) -> None:
    scene = under_image
    scene.volillum.model = "spherical_harmonics"
    scene.volillum.spherical_harmonics.bands = "lit"
    for light in [each for each in scene.objects if each.type == "LIGHT"]:
        bpy.data.objects.remove(light)
    bpy.ops.volillum.bake()
    scene.world = image_world(seed=1)
    assert changes(scene) == ()
    scene.world = build_world((EnvironmentLight(1.0),))
    assert changes(scene) == ("the highest lit band has changed",)


def test_redraws_read_no_pixels(
    under_image: bpy.types.Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The panel asks at every redraw; an image of 8 million numbers takes a second."""
    scene, reads = under_image, []
    read = outline.read_world
    monkeypatch.setattr(outline, "read_world", lambda world: reads.append(world) or read(world))
    scene.volillum.model = "photon_mapping"
    bpy.ops.volillum.bake()
    outline.lights(scene)
    reads.clear()
    assert changes(scene) == changes(scene) == ()
    assert reads == []
    node(scene, "ShaderNodeBackground").inputs["Strength"].default_value = 2
    changes(scene)
    assert len(reads) == 1
