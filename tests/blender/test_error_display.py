"""Errors as colours: known errors have known colours, in the volume and in the legend."""

from __future__ import annotations

import os
from pathlib import Path

import bpy
import numpy as np
import pytest
from blender_scenes import block, lit

from volillum_addon.bake.error_file import FieldError, write_error
from volillum_addon.blender import error_display
from volillum_addon.blender.error_display import colours, error_object
from volillum_addon.blender.placing import Place
from volillum_addon.blender.render import (
    add_camera,
    clip_range,
    depth_range,
    render_image,
    set_cycles,
    set_eevee,
)
from volillum_addon.blender.sandbox import sandbox
from volillum_addon.core.camera import Camera
from volillum_addon.core.medium import Medium
from volillum_addon.models.registry import MODELS

# Slabs of opaque medium from left to right, each of one error; the limit is 0.5.
ERRORS = np.array([-0.8, -0.5, -0.375, -0.25, -0.1, 0.0, 0.05, 0.25, 0.4, 0.5, 3.0])
LIMIT, THICK = 0.5, 8


def slabs() -> tuple[np.ndarray, Medium]:
    shape = (THICK * len(ERRORS), 12, 12)
    density = block(shape, 1 / shape[0], 4000.0, "density")
    # As in a bake's lattice there is void around the matter, which has errors, too.
    density.values[:, :2], density.values[:, -2:] = 0, 0
    density.values[:, :, :2], density.values[:, :, -2:] = 0, 0
    error = np.broadcast_to(np.repeat(ERRORS, THICK)[:, None, None], shape)
    return error.astype(np.float32), Medium(density, density)


@pytest.mark.parametrize("engine", ["cycles", "eevee"])
def test_known_errors_have_known_colours(tmp_path: Path, engine: str) -> None:
    error, medium = slabs()
    path = tmp_path / "slabs.error.vdb"
    write_error(path, lit(medium), error, {"rms": 0.0, "mean": 0.0, "noise": 0.0})
    camera = Camera((0, 0, 10), (0, 0, 0), (0, 1, 0), orthographic=True, height=1 / len(ERRORS))
    across = THICK * len(ERRORS)
    with sandbox() as (scene, own):
        shown = error_object(FieldError(path, "half_angle", 0, 0, 0), LIMIT)
        scene.collection.objects.link(shown)
        corners = medium.sigma_t.corners()
        add_camera(scene, camera, clip_range(camera, corners))
        set_cycles(scene, 1, 0)
        scene.cycles.volume_biased, scene.cycles.volume_step_rate = True, 0.25
        if engine == "eevee":
            set_eevee(scene, depth_range(camera, corners))
        image = render_image(scene, across, 8, own)
    found = image[3:5, THICK // 2 - 1 :: THICK, :3].mean(0)
    found = (found + image[3:5, THICK // 2 :: THICK, :3].mean(0)) / 2
    # 4000 over the depth of 8 / 88 is opaque.
    wanted = colours(ERRORS, LIMIT)
    np.testing.assert_allclose(found, wanted, atol=0.015 if engine == "eevee" else 2e-3)


def test_the_scheme_says_sign_and_size() -> None:
    """Blue is too dark, red too bright, alike on both sides; more is never lighter."""
    steps = np.linspace(0, 1, 41)
    dark, bright = colours(-steps, 1.0), colours(steps, 1.0)
    assert np.all(dark[1:, 2] > dark[1:, 0])
    assert np.all(bright[1:, 0] > bright[1:, 2])
    np.testing.assert_array_equal(dark[0], bright[0])
    assert np.ptp(dark[0]) < 0.02  # no hue
    for side in (dark, bright):
        assert np.all(np.diff(side.sum(-1)) < 0)
    np.testing.assert_array_equal(colours([-9, 9], 1.0), colours([-1, 1], 1.0))


def test_the_legend_has_the_volumes_colours(tmp_path: Path) -> None:
    place = Place(np.eye(3), np.zeros(3), 1.0, 0.4)
    with sandbox() as (scene, own):
        for each in error_display.legend(place, LIMIT, 0.021):
            scene.collection.objects.link(each)
        texts = [each.data.body for each in scene.objects if each.type == "FONT"]
        bar = next(each for each in scene.objects if each.type == "MESH")
        corners = np.array([bar.matrix_world @ vertex.co for vertex in bar.data.vertices])
        middle = corners.mean(0)
        eye = middle + np.array([0, 0, 10])
        bar_high = error_display.BAR
        camera = Camera(eye, middle, (0, 1, 0), orthographic=True, height=bar_high)
        add_camera(scene, camera, (0.1, 100))
        set_cycles(scene, 4, 0)
        scene.view_layers[0].update()
        image = render_image(scene, 160, 8, own)[..., :3].mean(0)
    assert np.ptp(corners[:, 0]) == pytest.approx(1.0)
    wanted = colours((np.arange(160) + 0.5) / 160 * 2 - 1, 1.0)
    np.testing.assert_allclose(image, wanted, atol=5e-3)
    assert texts[:3] == ["-50 %", "0", "+50 %"]
    assert "noise 2.1 %" in texts[3]


def test_the_chosen_models_error_is_shown(quick_models: bpy.types.Scene) -> None:
    scene, settings = quick_models, quick_models.volillum
    assert bpy.ops.volillum.show_error() == {"FINISHED"}
    assert settings.stage.way == "ERROR"
    shown = [each for each in settings.exhibit.objects if each.type == "VOLUME"]
    (path,) = (Path(bpy.path.abspath(each.data.filepath)) for each in shown)
    assert path.name.startswith("plume.multidirectional_occlusion.")
    assert ".error." in path.name
    assert settings.errors.startswith("Multidirectional occlusion: error ")
    assert scene.objects["plume"].hide_render
    first = path
    # The same is found; another light is another error.
    bpy.ops.volillum.show_error()
    light = next(each for each in scene.objects if each.type == "LIGHT")
    light.data.energy *= 3
    bpy.ops.volillum.show_error()
    (shown_now,) = (each for each in settings.exhibit.objects if each.type == "VOLUME")
    assert Path(bpy.path.abspath(shown_now.data.filepath)) != first
    assert first.is_file()


def test_all_errors_stand_in_a_row_on_one_scale(
    quick_models: bpy.types.Scene, tmp_path: Path
) -> None:
    scene, settings = quick_models, quick_models.volillum
    settings.composition = "sun=multidirectional_occlusion,sky=spherical_harmonics"
    settings.error_limit = 80
    assert bpy.ops.volillum.error_row() == {"FINISHED"}
    exhibit = settings.exhibit
    shown = [each for each in exhibit.objects if each.type == "VOLUME"]
    assert len(shown) == len(MODELS) + 1
    assert len(settings.errors.split("\n")) == len(shown)
    scales = {
        tuple(node.inputs[1].default_value for node in each.data.materials[0].node_tree.nodes
              if node.bl_idname == "ShaderNodeMath")
        for each in shown
    }  # fmt: skip
    ((scale,),) = scales
    assert scale == pytest.approx(0.5 / 0.8)
    assert len([each for each in exhibit.objects if each.type == "MESH"]) == 1
    folder = os.environ.get("VOLILLUM_KEEP_PICTURES")
    if folder:
        scene.camera.location = (
            np.array(scene.camera.location) + 45 * np.array(scene.camera.matrix_world)[:3, 2]
        )
        scene.camera.data.clip_end = 1e4
        set_cycles(scene, 4, 1)
        render_image(scene, 1500, 500, Path(folder))
    assert bpy.ops.volillum.clear_row() == {"FINISHED"}
    assert settings.exhibit is None
    assert not scene.objects["plume"].hide_render
