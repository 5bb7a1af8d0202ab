"""A Blender scene as the core's Scene."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np

from ..bake.vdb import grid_names, read_grid
from ..core.camera import Camera
from ..core.errors import InputError
from ..core.grid import Grid
from ..core.scene import Scene
from ..readers.source import absent
from .camera_reader import image_size, read_camera
from .light_reader import light_objects, read_lights, rendered_objects
from .medium_reader import MediumSettings, read_medium, volume_material

DENSITY = "density"


@dataclass(frozen=True, eq=False)
class Reading:
    """What was read: the scene, where from, the image's size, and notes in plain words."""

    scene: Scene
    volume_object: str
    stem: str
    width: int
    height: int
    notes: tuple[str, ...] = ()


def read_scene(
    scene: bpy.types.Scene,
    volume_object: bpy.types.Object | None = None,
    density_grid: str | None = None,
    settings: MediumSettings | None = None,
) -> Reading:
    """Read the scene's volume (the given object or the only one), lights, world and camera.

    Raises InputError for what has no counterpart in the core, naming it.
    """
    scene.view_layers[0].update()
    placed = volume_object or _only_volume(scene)
    evaluate(scene, placed)
    path = volume_path(placed)
    matrix = np.array(placed.matrix_world, dtype=np.float64)

    def load(name: str) -> Grid:
        if name not in available:
            raise InputError(
                f"grid {name!r} is not in {path}; expected one of {', '.join(available)}"
            )
        grid = read_grid(path, name)
        return Grid(grid.values, matrix @ grid.index_to_world, name)

    available = grid_names(path)
    medium, notes = read_medium(
        volume_material(placed),
        load,
        density_grid or density_name(available),
        density_factor(placed),
        settings or MediumSettings(),
    )
    width, height = image_size(scene)
    camera = read_scene_camera(scene)
    if camera is not None and scene.camera.data.dof.use_dof:
        notes += ("the camera's depth of field is left out",)
    surfaces = [o for o in rendered_objects(scene) if o.type in ("MESH", "CURVE", "SURFACE")]
    if surfaces:
        notes += (
            f"{len(surfaces)} surface objects (first {surfaces[0].name!r}) neither cast nor "
            "receive baked light",
        )
    return Reading(
        scene=Scene(medium, read_lights(scene), camera),
        volume_object=placed.name,
        stem=_stem(placed, path),
        width=width,
        height=height,
        notes=notes,
    )


def evaluate(scene: bpy.types.Scene, volume: bpy.types.Object) -> None:
    """Bring the volume, lights and camera to the current frame, also where viewports do not show
    them (the volume makes room for its bake): what they hide, Blender does not evaluate."""
    wanted = {volume, *light_objects(scene), *filter(None, [scene.camera])}
    hidden = [each for each in wanted if each.hide_viewport]
    for each in hidden:
        each.hide_viewport = False
        each.update_tag(refresh={"OBJECT", "TIME"})
    try:
        scene.view_layers[0].update()
    finally:
        for each in hidden:
            each.hide_viewport = True


def read_scene_camera(scene: bpy.types.Scene) -> Camera | None:
    """The scene's own camera, if it has one."""
    if scene.camera is None:
        return None
    if scene.render.pixel_aspect_x != scene.render.pixel_aspect_y:
        raise InputError("the scene's pixels are not square; expected a pixel aspect of 1 : 1")
    return read_camera(scene.camera, *image_size(scene))


def volume_path(placed: bpy.types.Object) -> Path:
    """The VDB file of a volume object at the current frame."""
    if placed.type != "VOLUME":
        raise InputError(f"object {placed.name!r} is a {placed.type}; expected a VOLUME")
    data = placed.data
    if not data.filepath:
        raise InputError(f"volume {placed.name!r} has no file; expected a .vdb")
    path = Path(bpy.path.abspath(data.filepath, library=data.library))
    if data.is_sequence:
        if not data.grids.load():
            raise InputError(f"volume {placed.name!r} cannot be read ({data.grids.error_message}); "
                             "expected a whole VDB file at every frame")  # fmt: skip
        if not data.grids.frame_filepath:
            raise InputError(
                f"the sequence of volume {placed.name!r} has no file at frame "
                f"{bpy.context.scene.frame_current}; expected one at every frame that is baked "
                f"(it plays {data.frame_duration} from frame {data.frame_start})"
            )
        path = Path(data.grids.frame_filepath)
    if not path.is_file():
        raise absent(path, f"the file of volume {placed.name!r}")
    return path


def _stem(placed: bpy.types.Object, path: Path) -> str:
    """What the volume is called by: of a sequence, its files' name without the frame's number."""
    stem = path.stem
    return re.sub(r"[._-]?\d+$", "", stem) or stem if placed.data.is_sequence else stem


def density_factor(placed: bpy.types.Object) -> float:
    """What Cycles multiplies a volume's coefficients by.

    In OBJECT space an object that grows keeps its optical depth along its own diagonal (1, 1, 1);
    in WORLD space coefficients are per world unit.
    """
    if placed.data.render.space == "WORLD":
        return 1.0
    diagonal = np.array(placed.matrix_world)[:3, :3] @ np.full(3, 1 / np.sqrt(3))
    return float(1 / np.linalg.norm(diagonal))


def _only_volume(scene: bpy.types.Scene) -> bpy.types.Object:
    volumes = [placed for placed in rendered_objects(scene) if placed.type == "VOLUME"]
    if len(volumes) != 1:
        names = ", ".join(repr(placed.name) for placed in volumes) or "none"
        wanted = (
            "one (choose it in the panel, or hide the others from renders)"
            if volumes
            else "one (import it, or let it be rendered)"
        )
        raise InputError(f"the scene's rendered volumes are {names}; expected {wanted}")
    return volumes[0]


def density_name(available: list[str] | tuple[str, ...]) -> str:
    """The grid that is the density where none is named: `density`, or the only one."""
    if DENSITY in available or len(available) != 1:
        return DENSITY
    return next(iter(available))
