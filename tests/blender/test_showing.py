"""One switch between baked light and full scattering, and the way back: nothing is lost."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest

from volillum_addon.blender import showing, work
from volillum_addon.blender.cycles import CyclesRenderer
from volillum_addon.blender.render import render_image, set_cycles
from volillum_addon.compare.bounces import bounce_limit


@pytest.fixture(autouse=True)
def quick(scene: bpy.types.Scene) -> None:
    scene.volillum.model = "multidirectional_occlusion"
    scene.volillum.multidirectional_occlusion.directions = 8


def volume(scene: bpy.types.Scene) -> bpy.types.Object:
    return next(each for each in scene.objects if each.name.startswith("plume"))


def as_found(scene: bpy.types.Scene) -> dict[str, Any]:
    """All that a way of showing may touch: the engine's settings, visibility, every data-block."""
    own = (bpy.types.VectorFont, bpy.types.Image)  # Blender's, from the first text and render on
    blocks = {repr(each) for each in bpy.data.user_map() if not isinstance(each, own)}
    found: dict[str, Any] = {"blocks": blocks}
    for owner in (scene.cycles, scene.render):
        for prop in owner.bl_rna.properties:
            if prop.type in ("BOOLEAN", "INT", "FLOAT", "ENUM", "STRING"):
                value = getattr(owner, prop.identifier)
                found[prop.identifier] = list(value) if getattr(prop, "is_array", 0) else value
    found |= {each.name: (each.hide_render, each.hide_viewport) for each in scene.objects}
    return found


WAYS = {
    "scattering": lambda: bpy.ops.volillum.scatter(),
    "bake": lambda: bpy.ops.volillum.show(),
    "row": lambda: bpy.ops.volillum.side_by_side(),
    "error": lambda: bpy.ops.volillum.show_error(),
}


@pytest.mark.parametrize("material", [True, False], ids=["material", "plain"])
@pytest.mark.parametrize("engine", ["CYCLES", "BLENDER_EEVEE"])
def test_the_scene_comes_out_of_every_way_unchanged(
    scene: bpy.types.Scene, engine: str, material: bool
) -> None:
    settings = scene.volillum
    settings.budget, settings.noise = 1, 50
    for model in ("spherical_harmonics", "half_angle", "ambient_occlusion", "shadow_propagation",
                  "directional_occlusion"):  # fmt: skip
        group = getattr(settings, model)
        if hasattr(group, "directions"):
            group.directions = 8
    scene.render.engine = engine
    scene.cycles.volume_bounces, scene.cycles.max_bounces = 3, 7
    scene.cycles.sample_clamp_indirect = 0.1  # no float32
    if not material:
        volume(scene).data.materials.clear()
    volume(scene).hide_viewport = True  # as the user has it
    bpy.ops.volillum.bake()
    before = as_found(scene)
    for way in WAYS.values():
        assert way() == {"FINISHED"}
        assert as_found(scene) != before
        assert bpy.ops.volillum.show(baked=False) == {"FINISHED"}
        assert as_found(scene) == before
    # And from one to the next, in any order.
    for name in ("bake", "scattering", "row", "bake", "error", "scattering", "error", "row"):
        WAYS[name]()
    bpy.ops.volillum.show(baked=False)
    assert as_found(scene) == before
    assert settings.stage.way == "VOLUME"


def test_the_switch_goes_to_and_fro(scene: bpy.types.Scene) -> None:
    cycles, source = scene.cycles, volume(scene)
    cycles.volume_biased = False
    bpy.ops.volillum.bake()
    bpy.ops.volillum.show()
    for _ in range(2):
        assert cycles.volume_biased
        assert source.hide_render
        assert cycles.volume_bounces == 0
        bpy.ops.volillum.scatter()
        assert scene.volillum.baked.shown is None
        assert not source.hide_render
        assert cycles.volume_bounces == bounce_limit(work.read(scene).scene.medium)
        assert cycles.max_bounces >= cycles.volume_bounces
        bpy.ops.volillum.scatter()
        assert scene.volillum.baked.shown is not None
    # Without a bake to go back to it is the volume.
    bpy.ops.volillum.show(baked=False)
    scene.volillum.baked.path = ""
    bpy.ops.volillum.scatter()
    bpy.ops.volillum.scatter()
    assert scene.volillum.stage.way == "VOLUME"
    assert not source.hide_render


def test_what_the_user_changes_meanwhile_stays(scene: bpy.types.Scene) -> None:
    before = scene.cycles.max_bounces
    bpy.ops.volillum.scatter()
    scene.cycles.volume_bounces = 5
    source = volume(scene)
    source.hide_render = True
    bpy.ops.volillum.show(baked=False)
    assert scene.cycles.volume_bounces == 5
    assert scene.cycles.max_bounces == before
    assert source.hide_render


@pytest.mark.parametrize("material", [True, False], ids=["material", "plain"])
def test_it_renders_as_the_references_do(
    scene: bpy.types.Scene, tmp_path: Path, material: bool
) -> None:
    """Means of 8 independent seeds each: their difference within 5 standard errors (t with 14
    degrees of freedom: 2e-4), and the bias of the march's longer steps."""
    if not material:
        volume(scene).data.materials.clear()
        scene.volillum.density_scale = 4.0
        scene.volillum.albedo = (0.6, 0.5, 0.3)
        volume(scene).scale = (1.5, 1.5, 1.5)
    bpy.ops.volillum.scatter()
    reading = work.read(scene)
    renderer = CyclesRenderer(reading.scene, 8, 8, scene)
    bounces = scene.cycles.volume_bounces
    found, wanted = [], []
    for seed in range(1, 9):
        set_cycles(scene, 4, seed)
        found.append(render_image(scene, 8, 8, tmp_path)[..., :3].mean((0, 1)))
        wanted.append(renderer.reference(bounces, 4, seed + 100).mean((0, 1)))
    error = np.mean(found, 0) - np.mean(wanted, 0)
    spread = np.sqrt((np.var(found, 0, ddof=1) + np.var(wanted, 0, ddof=1)) / len(found))
    assert np.mean(wanted) > 0.01
    assert np.all(np.abs(error) < 5 * spread + 2e-3 * np.mean(wanted, 0))


def test_a_volume_that_is_chosen_anew_leaves_the_first_as_it_was(scene: bpy.types.Scene) -> None:
    first = volume(scene)
    second = first.copy()
    second.data = first.data.copy()
    scene.collection.objects.link(second)
    scene.volillum.volume = first
    bpy.ops.volillum.bake()
    bpy.ops.volillum.show()
    scene.volillum.volume = second
    bpy.ops.volillum.show()
    assert (first.hide_render, second.hide_render) == (False, True)
    showing.hide(scene)
    assert not first.hide_render
    assert not second.hide_render
