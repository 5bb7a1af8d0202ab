"""References and witnesses against closed forms and the judge; the user's file stays as it was."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from blender_scenes import (
    add_light,
    blob,
    block,
    clear,
    new_scene,
    orthographic,
    perspective,
    write_grids,
)
from numpy.typing import NDArray

from volillum_addon.blender import cycles as cycles_module
from volillum_addon.blender.cycles import CyclesRenderer
from volillum_addon.blender.light_builder import build_world
from volillum_addon.blender.light_reader import read_lights
from volillum_addon.compare.renderer import Way
from volillum_addon.core.camera import Camera
from volillum_addon.core.control import Cancelled
from volillum_addon.core.lights import (
    DistantLight,
    EnvironmentLight,
    Light,
    PointLight,
    SpotLight,
)
from volillum_addon.core.medium import Medium
from volillum_addon.core.scene import Scene
from volillum_addon.models.exact import exact_image
from volillum_addon.models.registry import get

SEEDS = 4
# The steps of Cycles' march, and the judge's replicates are few: below this relative difference of
# means the two agree whatever their noise (measured 1e-4 to 5e-4).
MARCH = 2e-3


def replicated(renderer: CyclesRenderer, model: str, samples: int) -> NDArray[np.float64]:
    """Witness images of the model, [seeds, h, w, 3]."""
    operator = get(model).operator(get(model).values({}))
    images = [renderer.witness(operator, samples, seed) for seed in range(SEEDS)]
    return np.array([image for image in images if image is not None], dtype=np.float64)


def scene_of(camera: Camera, *lights: Light) -> Scene:
    return Scene(
        Medium.from_density(blob(24, 2, 6, "density"), 1.0, (0.9, 0.8, 0.6)), lights, camera
    )


@pytest.mark.parametrize(
    ("model", "camera", "lights"),
    [
        ("multidirectional_occlusion", perspective(), (DistantLight((1, -1, 1), 2.0, 0.1),)),
        ("directional_occlusion", orthographic(2), (PointLight((0, 0, 5), 20.0),)),
        (
            "spherical_harmonics",
            perspective(),
            (DistantLight((1, -2, 1), (2.0, 1.0, 0.5)), EnvironmentLight((0.2, 0.3, 0.5))),
        ),
    ],
)
def test_cycles_solves_the_model_s_own_equation(
    model: str, camera: Camera, lights: tuple[Light, ...]
) -> None:
    scene = scene_of(camera, *lights)
    size = 24
    witness = replicated(CyclesRenderer(scene, size, size), model, 32)
    assert len(witness) == SEEDS
    unclamped = {"order": 3} if model == "spherical_harmonics" else {}
    judge = exact_image(scene, model, size, size, unclamped, points=16, directions=128)
    # Blocks of pixels: their means are normal, and independent between seeds.
    mean, judged = witness.mean(0).mean((0, 1)), judge.value.mean((0, 1))
    spread = witness.mean((1, 2)).std(0, ddof=1) / math.sqrt(SEEDS)
    error = np.hypot(spread, np.sqrt((judge.standard_error**2).sum((0, 1))) / size**2)
    assert np.all(error < 0.01 * judged)
    assert np.all(np.abs(mean - judged) < 4 * error + MARCH * judged), (mean / judged, error)
    # And in shape: the squared difference is that of noise. Its standard error counts the pixels
    # that carry the noise, a third for colours that share theirs, and that the noise itself is
    # estimated from few seeds; the march may add its own difference.
    noise = (witness.var(0, ddof=1) / SEEDS + judge.standard_error**2).ravel()
    march = (MARCH * judge.value.ravel()) ** 2
    squared = ((witness.mean(0) - judge.value) ** 2).ravel()
    count = noise.sum() ** 2 / (noise**2).sum() / 3
    limit = 1 + 4 * math.sqrt(2 / count * (1 + 1 / (SEEDS - 1)))
    assert squared.sum() < limit * noise.sum() + march.sum(), squared.sum() / noise.sum()


def test_a_perspective_cone_about_the_eye_has_no_witness() -> None:
    scene = scene_of(perspective(), DistantLight((0, 0, 1), 1.0))
    operator = get("directional_occlusion").operator(get("directional_occlusion").values({}))
    assert CyclesRenderer(scene, 8, 8).witness(operator, 1, 0) is None


def test_the_reference_has_the_back_scatter_of_a_layer() -> None:
    # J2: (1 - exp(-2 b)) / (8 pi) for an irradiance of 1 along the view.
    b, voxel = 1.5, 1 / 16
    grid = block((40, 40, 8), (0.1, 0.1, voxel), b / (8 * voxel), "density")
    scene = Scene(Medium.from_density(grid, 1.0, 1.0), (DistantLight((0, 0, 1), 1.0),),
                  orthographic(0.2))  # fmt: skip
    renderer = CyclesRenderer(scene, 24, 24)
    image = renderer.reference(0, 64, 3)
    wanted = (1 - math.exp(-2 * b)) / (8 * math.pi)
    pixels = image.reshape(-1, 3)
    error = pixels.std() / math.sqrt(len(pixels))
    assert error < 2e-3 * wanted
    assert abs(pixels.mean() - wanted) < 4 * error + 5e-4 * wanted
    # More bounces bring more light, the same seed the same image.
    assert renderer.reference(8, 16, 3).mean() > 1.2 * wanted
    assert np.array_equal(renderer.reference(0, 4, 5), renderer.reference(0, 4, 5))
    assert not np.array_equal(renderer.reference(0, 4, 5), renderer.reference(0, 4, 6))


def test_every_way_of_path_tracing_has_the_reference_s_mean() -> None:
    scene = scene_of(perspective(), DistantLight((1, -1, 1), 2.0, 0.3))
    renderer = CyclesRenderer(scene, 32, 32)
    truth = np.array([renderer.reference(8, 64, seed) for seed in (1, 2)], np.float64)
    mean = truth.mean()
    spread = {}
    for way in renderer.ways():
        drawn = [renderer.baseline(way, 8, 16, seed) for seed in (3, 4)]
        images = np.array([image for image, _ in drawn], np.float64)
        assert all(seconds > 0 for _, seconds in drawn)
        spread[way] = float(np.std(images - truth.mean(0)) / mean)
        # The error of the mean of 2 x 1,024 independent pixels, their noise being at most as large
        # as the spread of those that are not denoised; the denoiser shifts means by up to 0.6 %
        # of bright and dark places alike.
        plain = spread[Way(way.biased, False)]
        error = 4 * plain / math.sqrt(images.size / 3) + (0.02 if way.denoised else MARCH)
        assert images.mean() == pytest.approx(mean, rel=error), way
    for way in renderer.ways():
        if way.denoised:
            assert spread[way] < 0.7 * spread[Way(way.biased, False)], way
    assert len(spread) == 4


def dump(value: Any, seen: set[int], path: str, lines: list[str]) -> None:
    """Every property below a data-block, pointers to others by name."""
    for prop in value.bl_rna.properties:
        name = prop.identifier
        # Evaluated copies, and what only warns that it will go.
        if name in ("rna_type", "is_evaluated", "original", "use_nodes", "depsgraph"):
            continue
        content = getattr(value, name)
        where = f"{path}.{name}"
        if prop.type == "POINTER" and content is not None:
            if isinstance(content, bpy.types.ID) and not content.is_embedded_data:
                lines.append(f"{where} -> {content.name_full}")
            elif content.as_pointer() not in seen:
                seen.add(content.as_pointer())
                dump(content, seen, where, lines)
        elif prop.type == "COLLECTION":
            lines.append(f"{where} has {len(content)}")
            for index, item in enumerate(content):
                if isinstance(item, bpy.types.ID):
                    lines.append(f"{where}[{index}] -> {item.name_full}")
                elif item.as_pointer() not in seen:
                    seen.add(item.as_pointer())
                    dump(item, seen, f"{where}[{index}]", lines)
        elif getattr(prop, "is_array", False):
            lines.append(f"{where} = {np.array(content).tolist()}")
        elif prop.type != "POINTER":
            lines.append(f"{where} = {content!r}")


def whole_file() -> list[str]:
    """Every property of every data-block."""
    lines: list[str] = []
    for prop in bpy.data.bl_rna.properties:
        if prop.type != "COLLECTION" or prop.identifier == "all_ids":
            continue
        for block_ in getattr(bpy.data, prop.identifier):
            dump(block_, set(), f"{prop.identifier}[{block_.name_full!r}]", lines)
    lines.append(f"window scene {bpy.context.scene.name}")
    return lines


@pytest.fixture
def users_scene(tmp_path: Path) -> bpy.types.Scene:
    """A scene with a volume, lights of all kinds with parents and animation, and a world."""
    grid = blob(12, 2, 4, "density")
    scene, _ = new_scene(write_grids(tmp_path / "user.vdb", grid))
    sun = add_light(scene, "SUN", 3.0)
    parent = bpy.data.objects.new("parent", None)
    scene.collection.objects.link(parent)
    sun.parent = parent
    parent.rotation_euler = (0.4, 0.2, 0)
    sun.data.keyframe_insert("energy", frame=1)
    sun.data.energy = 5.0
    sun.data.keyframe_insert("energy", frame=11)
    scene.frame_set(6)
    add_light(scene, "AREA", 30.0, [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 3], [0, 0, 0, 1]])
    hidden = add_light(scene, "POINT", 1e6)
    hidden.hide_render = True
    image = np.random.default_rng(0).random((4, 8, 3))
    scene.world = build_world((EnvironmentLight(image),))
    scene.render.resolution_x = 123
    scene.cycles.samples = 77
    scene.view_layers[0].update()
    return scene


def renderer_of(scene: bpy.types.Scene, size: int = 8) -> CyclesRenderer:
    medium = Medium.from_density(blob(12, 2, 4, "density"), 1.0, 0.8)
    return CyclesRenderer(Scene(medium, read_lights(scene), perspective()), size, size, scene)


def test_the_user_s_scene_comes_out_unchanged(users_scene: bpy.types.Scene, tmp_path: Path) -> None:
    before = whole_file()
    assert len(before) > 1000
    renderer = renderer_of(users_scene)
    renderer.reference(1, 1, 0)
    renderer.reference(0, 1, 0, renderer.scene)
    operator = get("spherical_harmonics").operator(get("spherical_harmonics").values({}))
    distant = tuple(k for k in renderer.scene.lights if k.kind in ("distant", "environment"))
    assert len(distant) == 2
    renderer.witness(operator, 1, 0, distant)
    assert whole_file() == before


@pytest.mark.parametrize(
    "failure", [Cancelled("cancelled"), RuntimeError("no"), KeyboardInterrupt()]
)
def test_the_user_s_scene_survives_a_failure_in_the_middle(
    users_scene: bpy.types.Scene, monkeypatch: pytest.MonkeyPatch, failure: BaseException
) -> None:
    before = whole_file()

    def fails(scene: bpy.types.Scene, *_: object) -> None:
        assert len(scene.objects) > 3, "everything is set up by now"
        raise failure

    monkeypatch.setattr(cycles_module, "render_image", fails)
    with pytest.raises(type(failure)):
        renderer_of(users_scene).reference(1, 1, 0)
    assert whole_file() == before


def test_the_user_s_own_lights_are_the_lights_that_were_read(users_scene: bpy.types.Scene) -> None:
    renderer = renderer_of(users_scene, 16)
    own = np.array([renderer.reference(0, 64, seed) for seed in range(4)], np.float64)
    rebuilt = np.array(
        [renderer.reference(0, 64, 10 + seed, renderer.scene) for seed in range(4)], np.float64
    )
    means, others = own.mean((1, 2)), rebuilt.mean((1, 2))
    error = np.sqrt((means.var(0, ddof=1) + others.var(0, ddof=1)) / 4)
    assert np.all(np.abs(means.mean(0) - others.mean(0)) < 5 * error + 2e-3 * means.mean(0))
    assert np.all(error < 0.01 * means.mean(0))


def test_the_identity_names_everything_that_an_image_depends_on(
    users_scene: bpy.types.Scene,
) -> None:
    def identity() -> dict[str, object]:
        return renderer_of(users_scene).identity()

    first = identity()
    assert first == identity()
    users_scene.objects["AREA"].data.size = 0.5
    second = identity()
    assert second != first
    users_scene.objects["AREA"].location.x += 0.1
    users_scene.view_layers[0].update()
    assert identity() != second
    assert renderer_of(users_scene, 9).identity() != identity()


def test_lights_without_a_blender_scene_are_rebuilt() -> None:
    clear()
    lights = (SpotLight((0, 0, 4), (0, 0, -1), 30.0, 1.5, 0.2), EnvironmentLight(0.1))
    image = CyclesRenderer(scene_of(orthographic(2), *lights), 8, 8).reference(0, 32, 0)
    assert image[3:5, 3:5].min() > 0.01
    assert np.isfinite(image).all()
