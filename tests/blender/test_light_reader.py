"""Each kind of light: what the reader makes of it against what Cycles renders with it.

A plate of optical depth 1, wide enough to be a plane layer for its middle, has single scattering in
closed form for light of any direction. Local lights stand so far away that they are of one
direction over the part that is seen (0.2 of 100).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import bpy
import numpy as np
import pytest
from blender_scenes import (
    add_light,
    assert_mean,
    block,
    new_scene,
    orthographic,
    render,
    single_scattering,
    write_grids,
)
from mathutils import Euler, Matrix, Vector

from volillum_addon.blender.light_builder import build_world
from volillum_addon.blender.light_reader import read_lights
from volillum_addon.blender.nodes import Tree
from volillum_addon.blender.render import add_camera
from volillum_addon.core import harmonics
from volillum_addon.core.errors import InputError
from volillum_addon.core.lights import EnvironmentLight, Light, SpotLight, latitude_longitude

ORIGIN = np.zeros(3)
DEPTH = 1.0
FAR = 100.0


@pytest.fixture
def plate(tmp_path: Path) -> Callable[..., bpy.types.Scene]:
    """Makes a scene with the plate across an axis, seen from one side."""

    def make(side: int = 2, sign: int = 1) -> bpy.types.Scene:
        shape, voxel = np.full(3, 40), np.full(3, 0.1)
        shape[side], voxel[side] = 12, 1 / 256
        sigma = DEPTH / (12 / 256)
        grid = block((int(shape[0]), int(shape[1]), int(shape[2])), voxel, sigma, "density")
        scene, placed = new_scene(write_grids(tmp_path / f"plate{side}{sign}.vdb", grid))
        material = bpy.data.materials.new("plate")
        tree = Tree(material.node_tree)
        node = tree.node("ShaderNodeVolumeCoefficients")
        tree.feed(node.inputs["Scatter Coefficients"], tree.attribute("density"))
        node.inputs["Absorption Coefficients"].default_value = (0, 0, 0)
        output = tree.node("ShaderNodeOutputMaterial")
        tree.feed(output.inputs["Volume"], node.outputs[0])
        placed.data.materials.append(material)
        add_camera(scene, orthographic(0.2, side, sign), (1, 20))
        return scene

    return make


def toward(direction: Vector, distance: float = FAR) -> Matrix:
    """A light at that place that shines at the origin."""
    turn = direction.to_track_quat("Z", "Y").to_matrix().to_4x4()
    return Matrix.Translation(direction.normalized() * distance) @ turn


def tilted(angle: float) -> Vector:
    """A direction at the angle from z, along no axis."""
    return Vector((math.sin(angle) * 0.8, math.sin(angle) * 0.6, math.cos(angle)))


def expected(light: Light, cosine: float) -> np.ndarray:
    """Radiance of the plate by the light as it was read."""
    return light.fluence(ORIGIN) / (4 * math.pi) * single_scattering(cosine, DEPTH)


@pytest.mark.parametrize("angle", [0.5, 2.2])
def test_a_sun(plate: Callable[..., bpy.types.Scene], tmp_path: Path, angle: float) -> None:
    scene = plate()
    sun = add_light(scene, "SUN", 3.0, toward(tilted(angle)))
    sun.data.angle = 0
    sun.data.color = (1.0, 0.5, 0.25)
    sun.data.exposure = 1.5
    sun.data.use_temperature, sun.data.temperature = True, 4000
    (light,) = read_lights(scene)
    assert np.ptp(light.fluence(ORIGIN)) > 1
    assert_mean(render(scene, tmp_path, 64), expected(light, math.cos(angle)), 4e-3)


def test_a_sun_with_a_size_has_the_mean_over_its_disc(
    plate: Callable[..., bpy.types.Scene], tmp_path: Path
) -> None:
    scene = plate()
    sun = add_light(scene, "SUN", 3.0, toward(tilted(0)))
    sun.data.angle = 2.0
    (light,) = read_lights(scene)
    # The mean over the cap of the layer's response, by Gauss's rule in the cosine.
    node, weight = np.polynomial.legendre.leggauss(32)
    edge = math.cos(1.0)
    response = (single_scattering((1 + edge) / 2 + (1 - edge) / 2 * node, DEPTH) * weight).sum() / 2
    wanted = light.fluence(ORIGIN) / (4 * math.pi) * response
    assert_mean(render(scene, tmp_path, 128), wanted)


@pytest.mark.parametrize("soft", [0.0, 0.5])
def test_a_point_light(plate: Callable[..., bpy.types.Scene], tmp_path: Path, soft: float) -> None:
    scene = plate()
    point = add_light(scene, "POINT", 1e5, toward(tilted(0.6)))
    point.data.shadow_soft_size = soft
    (light,) = read_lights(scene)
    assert_mean(render(scene, tmp_path, 256), expected(light, math.cos(0.6)))


@pytest.mark.parametrize(("off", "blend"), [(0.1, 0.5), (0.33, 0.5), (0.37, 0.15), (0.38, 0.9)])
def test_a_spot_light_and_its_blend(
    plate: Callable[..., bpy.types.Scene], tmp_path: Path, off: float, blend: float
) -> None:
    scene = plate()
    straight = Matrix.Translation(tilted(0.4) * FAR)
    turn = (tilted(0.4)).to_track_quat("Z", "Y").to_matrix().to_4x4()
    spot = add_light(scene, "SPOT", 1e5, straight @ turn @ Euler((off, 0, 0)).to_matrix().to_4x4())
    spot.data.spot_size, spot.data.spot_blend = 0.8, blend
    spot.data.shadow_soft_size = 0
    (light,) = read_lights(scene)
    assert isinstance(light, SpotLight)
    share = light.fluence(ORIGIN) / (light.intensity / FAR**2)
    assert np.all(share < 0.999) == (off > 0.1), "the ramp is tested, and the plain inside"
    assert_mean(render(scene, tmp_path, 256), expected(light, math.cos(0.4)), 4e-3)


def test_outside_a_spot_there_is_no_light(plate: Callable[..., bpy.types.Scene]) -> None:
    scene = plate()
    spot = add_light(scene, "SPOT", 1e5, Matrix.Translation((0, 0, FAR)))
    spot.data.spot_size = 0.4
    (light,) = read_lights(scene)
    away = FAR * math.tan(0.21)
    assert np.all(light.fluence(np.array([away, 0, 0])) == 0)
    assert np.all(light.fluence(ORIGIN) > 0)


@pytest.mark.parametrize("shape", ["SQUARE", "RECTANGLE", "DISK", "ELLIPSE"])
def test_an_area_light(plate: Callable[..., bpy.types.Scene], tmp_path: Path, shape: str) -> None:
    scene = plate()
    turned = toward(tilted(0.4)) @ Euler((0.7, 0, 0)).to_matrix().to_4x4()
    area = add_light(scene, "AREA", 1e5, turned @ Matrix.Diagonal((1.5, 0.7, 1, 1)))
    area.data.shape, area.data.size, area.data.size_y = shape, 1.0, 0.5
    (light,) = read_lights(scene)
    # Of side 1.5 at the distance 100 its finite size changes the fluence by less than 1e-4.
    assert_mean(render(scene, tmp_path, 256), expected(light, math.cos(0.4)))


@pytest.mark.parametrize("shape", ["SQUARE", "ELLIPSE"])
def test_a_near_area_light_has_a_size(
    plate: Callable[..., bpy.types.Scene], tmp_path: Path, shape: str
) -> None:
    """15 x 7 at a distance of 10: the sum of single scattering over its surface."""
    scene = plate()
    turned = toward(tilted(0.4), 10) @ Euler((0.7, 0, 0.3)).to_matrix().to_4x4()
    area = add_light(scene, "AREA", 1e3, turned @ Matrix.Diagonal((1.5, 0.7, 1, 1)))
    area.data.shape, area.data.size, area.data.size_y = shape, 10.0, 8.0
    (light,) = read_lights(scene)
    points, shares = light.points(1024)
    distance = np.linalg.norm(points, axis=-1)
    lit = light.shape(-points @ np.asarray(light.direction) / distance) / distance**2
    scattered = single_scattering(points[:, 2] / distance, DEPTH)
    wanted = np.asarray(light.intensity) * (shares * lit * scattered).sum() / (4 * math.pi)
    alike = light.intensity * (shares * lit).sum()
    assert np.allclose(alike, light.fluence(ORIGIN), rtol=1e-3)
    assert np.all(abs(light.intensity / 100 - alike) > 0.1 * alike), "the size matters here"
    assert_mean(render(scene, tmp_path, 256), wanted)


def test_a_constant_world(plate: Callable[..., bpy.types.Scene], tmp_path: Path) -> None:
    scene = plate()
    scene.world = build_world((EnvironmentLight((0.5, 1.0, 2.0)),))
    background = scene.world.node_tree.nodes["Background"]
    background.inputs["Strength"].default_value = 1.5
    (light,) = read_lights(scene)
    assert np.allclose(light.radiance, (0.75, 1.5, 3.0))
    node, weight = np.polynomial.legendre.leggauss(200)
    response = (single_scattering(node, DEPTH) * weight).sum() / 2
    wanted = light.fluence(ORIGIN) / (4 * math.pi) * response
    assert_mean(render(scene, tmp_path, 512), wanted, 4e-3)


@pytest.mark.parametrize(("side", "sign"), [(0, 1), (0, -1), (1, 1), (2, -1)])
def test_an_environment_image_has_its_directions(
    plate: Callable[..., bpy.types.Scene], tmp_path: Path, side: int, sign: int
) -> None:
    # Smooth and of no symmetry: 1 + band 1 and 2 terms, different in each colour.
    directions, solid_angles = latitude_longitude(64, 128)
    basis = harmonics.evaluate(directions.reshape(-1, 3)).reshape(64, 128, 16)
    coefficients = np.zeros((16, 3))
    coefficients[0] = 3.0
    coefficients[1:9] = np.random.default_rng(3).uniform(-0.6, 0.6, (8, 3))
    image = basis @ coefficients
    assert image.min() > 0
    turn = np.array(Euler((0.4, -0.8, 1.9)).to_matrix())
    scene = plate(side, sign)
    scene.world = build_world((EnvironmentLight(image, turn),))
    (light,) = read_lights(scene)
    assert np.allclose(light.rotation, turn, atol=1e-6)
    assert np.allclose(light.radiance, image, rtol=1e-6)
    world = directions @ np.asarray(light.rotation)  # rotation.T takes image to world directions
    response = single_scattering(world[..., side] * sign, DEPTH)
    wanted = np.einsum("hw,hwc->c", response * solid_angles, image) / (4 * math.pi)
    # A pixel is 0.05 across: bilinear interpolation and the quadrature err below 1e-3 of band 2.
    assert_mean(render(scene, tmp_path, 512), wanted, 5e-3)


def test_lights_that_do_not_shine_are_not_read(plate: Callable[..., bpy.types.Scene]) -> None:
    scene = plate()
    add_light(scene, "SUN", 1.0).hide_render = True
    add_light(scene, "POINT", 1.0).visible_volume_scatter = False
    add_light(scene, "AREA", 1.0).data.cycles.is_portal = True
    hidden = bpy.data.collections.new("hidden")
    scene.collection.children.link(hidden)
    hidden.objects.link(bpy.data.objects.new("inside", bpy.data.lights.new("l", "SUN")))
    hidden.hide_render = True
    assert read_lights(scene) == ()


def test_what_has_no_counterpart_is_refused_by_name(
    plate: Callable[..., bpy.types.Scene],
) -> None:
    scene = plate()
    area = add_light(scene, "AREA", 1.0)
    area.data.spread = 1.0
    with pytest.raises(InputError, match=r"'AREA' has a spread of 57\.3 degrees; expected 180"):
        read_lights(scene)
    area.data.spread = math.pi
    area.data.normalize = False
    with pytest.raises(InputError, match="'AREA' has Normalize switched off"):
        read_lights(scene)
    bpy.data.objects.remove(area)
    scene.world = bpy.data.worlds.new("world")
    tree = scene.world.node_tree
    sky = tree.nodes.new("ShaderNodeTexSky")
    tree.links.new(sky.outputs[0], tree.nodes["Background"].inputs["Color"])
    with pytest.raises(InputError, match=r"'Sky Texture'.* in .*cannot be read; supported"):
        read_lights(scene)
