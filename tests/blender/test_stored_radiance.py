"""More grids than a renderer reads: refused, or shown as the radiance that is stored instead."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import pytest
from blender_scenes import (
    add_light,
    blob,
    clear,
    lit,
    perspective,
)
from displayed import (
    SIZE,
    SKY,
    compared,
    coordinates,
    display_and_integral,
    smooth,
)

from volillum_addon.bake.vdb import write_vdb
from volillum_addon.blender.display import display_material, show_bake
from volillum_addon.core import harmonics
from volillum_addon.core.errors import InputError
from volillum_addon.core.lights import DistantLight, Light
from volillum_addon.core.medium import Medium
from volillum_addon.models.image import line_integral
from volillum_addon.models.registry import get
from volillum_addon.models.volume import IlluminationVolume


def test_more_grids_than_eevee_reads_are_refused() -> None:
    clear()
    medium = smooth()
    channels = [(f"c{i}", medium.sigma_t, (1.0, 1.0, 1.0), None) for i in range(15)]
    with pytest.raises(InputError, match="needs 16 grids in one material; EEVEE reads at most 15"):
        display_material("many", lit(medium, *channels))
    assert "many" not in bpy.data.materials
    display_material("many", lit(medium, *channels), None)
    display_material("fewer", lit(medium, *channels[:14]))


def chromatic(lights: tuple[Light, ...]) -> IlluminationVolume:
    """A third-order bake of coloured extinction: 16 grids beside the density."""
    density = blob(32, 2, 8, "density")
    sigma_t = density.values[..., None] * np.array([1, 0.7, 0.4], np.float32)
    medium = Medium(density.with_values(sigma_t), density.with_values(0.8 * sigma_t))
    where = coordinates(density)
    model = get("spherical_harmonics")
    values = model.values({"order": 3})
    channels = {}
    for index in range(harmonics.count(3)):
        name = f"coefficient_{index}"
        wave = np.cos((1 + index % 3) * where + index) * 2 / (1 + index) + 3 * (index == 0)
        channels[name] = density.with_values(wave.astype(np.float32), name)
    return IlluminationVolume(
        "spherical_harmonics", values, medium, channels, model.radiance(lights, medium, values)
    )


def test_too_many_grids_are_shown_as_stored_radiance(tmp_path: Path) -> None:
    scene = clear()
    add_light(scene, "SUN", 5.0).rotation_euler = (0.6, 0.4, 0.2)
    scene.view_layers[0].update()
    path = tmp_path / "shown.vdb"
    write_vdb(chromatic((DistantLight((1, 2, 3), 1.0),)), path)

    def shown_grids() -> set[str]:
        shown = show_bake(path, scene, scene.collection)
        assert shown.data.grids.load()
        nodes = shown.data.materials[0].node_tree.nodes
        used = {n.attribute_name for n in nodes if n.bl_idname == "ShaderNodeAttribute"}
        assert used <= {grid.name for grid in shown.data.grids}
        return used

    scene.render.engine = "CYCLES"
    assert len(shown_grids()) == 17
    scene.render.engine = "BLENDER_EEVEE"
    assert shown_grids() == {"density", "volillum_radiance"}
    assert len(list(tmp_path.glob("shown.radiance.*.vdb"))) == 1
    scene.objects["SUN"].data.energy = 2.5
    shown_grids()
    assert len(list(tmp_path.glob("shown.radiance.*.vdb"))) == 2
    scene.render.engine = "CYCLES"
    stored = show_bake(path, scene, scene.collection, as_radiance=True)
    assert ".radiance." in stored.data.filepath


def test_stored_radiance_is_the_same_image(tmp_path: Path) -> None:
    lights = (DistantLight((1, 2, 3), 3.0), SKY)
    volume = chromatic(lights)
    camera = perspective()
    image, _ = display_and_integral(volume.as_radiance(), camera, tmp_path)
    wanted, transmittance = line_integral(volume, camera, SIZE, SIZE)
    inside = transmittance.mean(-1) < 0.98
    error, mean = (image - wanted)[inside], wanted[inside].mean()
    assert abs(error.mean()) < 0.002 * mean
    assert np.sqrt((error**2).mean()) < 0.01 * mean


def test_eevee_renders_more_grids_than_it_reads(tmp_path: Path) -> None:
    lights = (DistantLight((1, 2, 3), 3.0), SKY)
    bias, rmse = compared(chromatic(lights), lights, perspective(), tmp_path, None, 32)
    # As test_a_smooth_volume_in_eevee.
    assert bias < 0.02
    assert rmse < 0.03
