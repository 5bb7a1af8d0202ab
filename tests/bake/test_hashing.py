"""The hash changes exactly when the bake's file would."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bake.conftest import blob, random_values

from volillum_addon.bake import hashing, run
from volillum_addon.core.camera import Camera
from volillum_addon.core.lights import DistantLight, EnvironmentLight
from volillum_addon.core.medium import Medium
from volillum_addon.core.scene import Scene
from volillum_addon.models.registry import MODELS

SUN = DistantLight((0.3, 0.4, 0.9), (3.0, 2.0, 1.0), 0.2)
LAMP = DistantLight((-0.5, 0.1, 0.2), 1.0)
SKY = EnvironmentLight((0.1, 0.2, 0.3))
GRID = blob()
BASE = Scene(Medium.from_density(GRID, 2.0, 0.9), (SUN, SKY), Camera((1, -9, 3), (5, 6, 8)))
ORTHOGRAPHIC = replace(BASE, camera=replace(BASE.camera, orthographic=True))
TWO_SUNS = replace(BASE, lights=(SUN, LAMP, SKY))


def lights(*some: object) -> Scene:
    return replace(BASE, lights=some)


def brighter(light: DistantLight) -> DistantLight:
    return replace(light, irradiance=2 * np.asarray(light.irradiance))


def camera(base: Scene = BASE, **changes: object) -> Scene:
    assert base.camera is not None
    return replace(base, camera=replace(base.camera, **changes))


def medium(**changes: object) -> Scene:
    return replace(BASE, medium=replace(BASE.medium, **changes))


def changed_voxel() -> Scene:
    values = GRID.values.copy()
    values[2, 3, 4] = np.nextafter(values[2, 3, 4], np.float32(1))
    return replace(BASE, medium=Medium.from_density(GRID.with_values(values), 2.0, 0.9))


def moved() -> Scene:
    matrix = GRID.index_to_world.copy()
    matrix[0, 3] += 1e-6
    return replace(BASE, medium=Medium.from_density(replace(GRID, index_to_world=matrix), 2, 0.9))


def padded() -> Scene:
    wide = GRID.crop((0, 0, 0), (20, 15, 18))
    return replace(BASE, medium=Medium.from_density(wide, 2.0, 0.9))


def negative_zeros() -> Scene:
    values = np.where(GRID.values == 0, np.float32(-0.0), GRID.values)
    assert np.signbit(values).any()
    return replace(BASE, medium=Medium.from_density(GRID.with_values(values), 2.0, 0.9))


def along(distance: float) -> Scene:
    """The orthographic view from elsewhere on its axis and beside it."""
    view = ORTHOGRAPHIC.need_camera()
    shift = view.forward * distance + np.array([3.7, -1.1, 0.3]) * distance
    return camera(ORTHOGRAPHIC, position=view.position + shift, look_at=view.look_at + shift)


# With one albedo, scattering follows extinction.
MATTER = ("extinction", "scattering")
SHAPE = ("light", "light shape")
PLACES = ("light", "light direction", "light shape")
# change: (before, after, the parts that change)
CHANGES = {
    "one voxel by one bit": (BASE, changed_voxel(), MATTER),
    "transform": (BASE, moved(), MATTER),
    "empty border": (BASE, padded(), ()),
    "negative zeros": (BASE, negative_zeros(), ()),
    "grid name": (BASE, medium(sigma_t=replace(BASE.medium.sigma_t, name="x")), ()),
    "albedo": (BASE, medium(sigma_s=blob().with_values(GRID.values)), ("scattering",)),
    "emission": (BASE, medium(emission=GRID), ("emission", "light hue")),
    "no emission": (BASE, medium(emission=GRID.with_values(GRID.values * 0)), ()),
    "anisotropy": (BASE, medium(g=0.5), ("phase function",)),
    "sun's colour": (BASE, lights(replace(SUN, irradiance=(1, 1, 9)), SKY), ("light", "light hue")),
    "sun's brightness": (BASE, lights(brighter(SUN), SKY), ("light",)),
    "sun's brightness beside a glow": (
        medium(emission=GRID),
        replace(medium(emission=GRID), lights=(brighter(SUN), SKY)),
        ("light", "light hue"),
    ),
    "sun's size": (BASE, lights(replace(SUN, angle=0.4), SKY), SHAPE),
    "sky": (BASE, lights(SUN, EnvironmentLight(random_values(4, 8, 3))), SHAPE),
    "sky before sun": (BASE, lights(SKY, SUN), PLACES),
    "sun's direction": (BASE, lights(replace(SUN, direction=(0, 0, 1)), SKY), PLACES),
    "another sun": (BASE, TWO_SUNS, (*PLACES, "light hue")),
    "suns' order": (TWO_SUNS, lights(LAMP, SUN, SKY), (*PLACES, "light hue")),
    "eye": (BASE, camera(position=(1, -9.001, 3)), ("camera",)),
    "where it looks": (BASE, camera(look_at=(0, 1, 2)), ()),
    "lens": (BASE, camera(fov=0.3, shift=(0.1, 0.2)), ()),
    "projection": (BASE, ORTHOGRAPHIC, ("camera",)),
    "orthographic, moved": (ORTHOGRAPHIC, along(123.4), ()),
    "orthographic, turned": (ORTHOGRAPHIC, camera(ORTHOGRAPHIC, look_at=(0, 1, 2)), ("camera",)),
    "orthographic, rolled": (ORTHOGRAPHIC, camera(ORTHOGRAPHIC, up=(1, 0, 0.5)), ()),
    "orthographic, scale": (ORTHOGRAPHIC, camera(ORTHOGRAPHIC, height=7.0), ()),
}  # fmt: skip
# What every bake's file holds.
ALWAYS = {"extinction", "scattering", "emission"}


def plan(scene: Scene, model: str, parameters: dict[str, object] | None = None, **more: object):  # noqa: ANN201
    return run.plan_bake(scene, model, Path("nowhere"), "name", parameters, **more)


@pytest.mark.parametrize("change", CHANGES)
@pytest.mark.parametrize("model", MODELS)
def test_hash_changes_exactly_when_it_must(model: str, change: str) -> None:
    before, after, parts = CHANGES[change]
    first, second = plan(before, model), plan(after, model)
    expected = set(parts) & (ALWAYS | MODELS[model].rebake_on)
    if change.startswith("sky") and "environment" not in MODELS[model].lights:
        expected -= set(PLACES)  # a light that the model does not have
    changed = {name for name in first.digests if first.digests[name] != second.digests[name]}
    assert changed == expected
    assert (first.hash != second.hash) == bool(expected)
    assert (first.path != second.path) == bool(expected)


@pytest.mark.parametrize("model", MODELS)
def test_every_parameter_and_the_precision_count(model: str) -> None:
    hashes = {plan(BASE, model).hash, plan(BASE, model, half=True).hash}
    for parameter in MODELS[model].parameters:
        for value in parameter.choices or (parameter.minimum, parameter.maximum):
            if value != parameter.default:
                hashes.add(plan(BASE, model, {parameter.name: value}).hash)
    others = sum(
        len(set(parameter.choices or (parameter.minimum, parameter.maximum)) - {parameter.default})
        for parameter in MODELS[model].parameters
    )
    assert len(hashes) == 2 + others
    default = {p.name: p.default for p in MODELS[model].parameters}
    assert plan(BASE, model, default).hash == plan(BASE, model).hash


def test_every_model_has_its_own_and_every_part_is_known() -> None:
    assert len({plan(BASE, model).hash for model in MODELS}) == len(MODELS)
    for model in MODELS.values():
        assert model.rebake_on <= ALWAYS | hashing.PARTS.keys()


def test_a_new_kernel_revision_makes_old_bakes_stale(monkeypatch: pytest.MonkeyPatch) -> None:
    before = plan(BASE, next(iter(MODELS))).hash
    monkeypatch.setattr(hashing, "KERNEL_REVISION", hashing.KERNEL_REVISION + 1)
    assert plan(BASE, next(iter(MODELS))).hash != before


def test_hash_is_stable_across_processes() -> None:
    """16 hex digits of blake2b; a change of this value makes every user's bakes stale."""
    digest = hashing.combined({"b": "2", "a": "1"})
    assert digest == hashing.combined({"a": "1", "b": "2"})
    # b2sum -l 64 of "a=1\nb=2".
    assert digest == "c85287bec4617b41"
