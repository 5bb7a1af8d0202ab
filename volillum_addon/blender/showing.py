"""What stands in the volume's place: its bake, full scattering, an error, a row of models."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy

from ..compare.bounces import bounce_limit
from ..core.errors import InputError
from . import framing, stage, staleness, work
from .display import show_bake
from .display_frames import show_frames
from .medium_builder import plain_material
from .medium_reader import volume_material
from .places import keep_found, relative
from .scene_reader import density_name

# Marched in steps, a bake, which only emits and absorbs, has next to no noise, and scattering has
# half of it for the time, without seconds of set-up.
NO_NOISE = {"cycles.volume_biased": True}
EXHIBIT = "Volillum exhibit"


def show(scene: bpy.types.Scene, path: Path) -> bpy.types.Object:
    """Show a bake in place of its volume, under the scene's lights as they are now; a sequence
    under those of each frame."""
    settings = scene.volillum
    keep_found(scene)
    volume = work.chosen_volume(scene)
    before = settings.baked.shown
    if settings.baked.frames:
        shown = show_frames(path, scene, scene.collection)
    else:
        shown = show_bake(path, scene, scene.collection, settings.as_radiance)
    shown.data.filepath = relative(Path(shown.data.filepath))
    if before is not None and before != shown:
        discard(before)
    settings.baked.shown = shown
    settings.baked.lighting = staleness.noted_lighting(scene, volume)
    step_aside(scene, volume, "BAKE", NO_NOISE)
    return shown


def step_aside(
    scene: bpy.types.Scene,
    volume: bpy.types.Object | None,
    way: str,
    engine: dict[str, Any],
) -> None:
    """The volume makes room for one of stage.WAYS; an exhibit goes where a bake comes."""
    if way == "BAKE":
        clear(scene)
    if volume is not None:
        scene.volillum.volume = volume
        stage.step_aside(scene, volume)
    stage.set_way(scene, way, engine)


def hide(scene: bpy.types.Scene) -> None:
    """Show the volume itself again, as it was, and nothing in its place."""
    shown = scene.volillum.baked.shown
    keep_found(scene)
    if shown is not None:
        discard(shown)
    clear(scene)
    stage.come_back(scene)
    stage.set_way(scene, "VOLUME", {})


def scatter(scene: bpy.types.Scene) -> str:
    """Show the volume in full scattering, by Cycles with as many bounces as its light lasts; the
    line to say about it. Raises InputError."""
    if not hasattr(scene, "cycles"):
        raise InputError("Cycles is disabled; expected it for full scattering (Preferences)")
    reading = work.read(scene)
    volume = bpy.data.objects[reading.volume_object]
    bounces = bounce_limit(reading.scene.medium)
    hide(scene)
    scene.volillum.volume = volume
    engine = {
        **NO_NOISE,
        "render.engine": "CYCLES",
        "cycles.volume_bounces": bounces,
        "cycles.max_bounces": max(bounces, scene.cycles.max_bounces),
        "cycles.sample_clamp_indirect": 0.0,  # or long paths lose light
    }
    if volume_material(volume) is None:
        open_exhibit(scene).objects.link(_scattering(scene, volume))
        stage.step_aside(scene, volume)
    stage.set_way(scene, "SCATTERING", engine)
    return f"full scattering, {bounces} bounces"


def _scattering(scene: bpy.types.Scene, volume: bpy.types.Object) -> bpy.types.Object:
    """A copy of a volume without a material, of the medium that the settings make of it."""
    settings = scene.volillum
    grid = settings.density_grid or density_name(work.grids_of(volume))
    data = volume.data.copy()
    # The settings are extinctions by unit of the world, whatever the object's scale.
    data.render.space = "WORLD"
    material = plain_material(volume.name, grid, settings.density_scale, tuple(settings.albedo))
    data.materials.append(material)
    copy = volume.copy()
    copy.data = data
    copy.hide_render = copy.hide_viewport = False
    return copy


def open_exhibit(scene: bpy.types.Scene) -> bpy.types.Collection:
    """An empty collection for several things in the volume's place; an older one goes."""
    clear(scene)
    exhibit = bpy.data.collections.new(EXHIBIT)
    scene.collection.children.link(exhibit)
    scene.volillum.exhibit = exhibit
    return exhibit


def clear(scene: bpy.types.Scene) -> None:
    """Remove the exhibit, with all that it brought."""
    exhibit = scene.volillum.exhibit
    if exhibit is None:
        return
    for each in list(exhibit.objects):
        discard(each)
    framing.unframe(scene, exhibit)
    bpy.data.collections.remove(exhibit)


def discard(shown: bpy.types.Object) -> None:
    """Remove what was shown with its data and materials, where nothing else uses them."""
    data = shown.data
    bpy.data.objects.remove(shown)
    discard_data(data)


def discard_data(data: Any) -> None:
    """Remove data that was shown and its materials, where nothing else uses them."""
    materials = [material for material in data.materials if material is not None]
    for block in (data, *materials):
        if block.users == 0:
            bpy.data.batch_remove([block])
