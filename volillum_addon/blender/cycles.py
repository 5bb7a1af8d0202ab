"""Blender as the renderer of references, displays and witnesses.

Every image is rendered in a scene of our own that is gone afterwards: the user's scene is only
looked at. The medium is written from the core's grids, so that core and Cycles see the same one;
lights and world are the user's own (copies of the objects) unless other lights are asked for.
"""

from __future__ import annotations

import hashlib
import json
import time
from pathlib import Path

import bpy

# isort: split
import _cycles  # there once bpy is
import numpy as np

from ..bake.vdb import read_vdb, write_vdb
from ..compare.renderer import WAYS, Way
from ..core.camera import Camera
from ..core.lights import DistantLight, EnvironmentLight, Light
from ..core.scene import Scene
from ..models.illuminate import relight
from ..models.operator import Operator
from ..models.volume import IlluminationVolume
from .display import EEVEE_GRIDS, add_volume, display_material, displayed, medium_material
from .light_builder import add_lights
from .light_reader import light_objects
from .render import Image, add_camera, clip_range, depth_range, render_image, set_cycles, set_eevee
from .sandbox import sandbox
from .witness import witness_scenes

# Raised when a setting of the references changes, so that cached images are not taken for new.
SETTINGS_REVISION = 1
# Steps of the ray march, in voxels. Jittered steps err in the second order: a surface of optical
# depth 0.6 a voxel has a mean error of 3e-4 at a step of 1, of 1e-4 and less at 0.5.
STEP = 0.5
LARGEST_STEPS = 8192


class CyclesRenderer:
    """Images [h, w, 3] (float32, linear, no background, top row first) of one scene.

    `scene` is the core's; `source` the Blender scene that it was read from, whose own lights and
    world light the references. Without `source` the lights are built from the core's.
    """

    def __init__(
        self, scene: Scene, width: int, height: int, source: bpy.types.Scene | None = None
    ) -> None:
        self.scene, self.width, self.height = scene, width, height
        self.source = source
        self.camera: Camera = scene.need_camera()

    def reference(self, bounces: int, samples: int, seed: int, scene: Scene | None = None) -> Image:
        """Full light transport up to `bounces` volume bounces (0: single scattering).

        `scene` replaces medium and lights (their core form), for variants of the scene.
        """
        with sandbox() as (own, folder):
            self._add_medium(own, self._write_medium(scene or self.scene, folder), scene)
            set_cycles(own, samples, seed)
            own.cycles.max_bounces = own.cycles.volume_bounces = bounces
            # Unbiased null scattering has twice the noise for the time, and seconds of set-up a
            # render; the bias of the march is far below the references' noise.
            _march(own)
            return render_image(own, self.width, self.height, folder)[..., :3]

    def ways(self) -> tuple[Way, ...]:
        """All, but without Open Image Denoise those that need it."""
        return tuple(way for way in WAYS if _cycles.with_openimagedenoise or not way.denoised)

    def baseline(self, way: Way, bounces: int, samples: int, seed: int) -> tuple[Image, float]:
        """Cycles as it would otherwise be used: Blender's own steps of the march, Open Image
        Denoise with its defaults. Only the pixel's filter stays the references'."""
        with sandbox() as (own, folder):
            medium = self._write_medium(self.scene, folder)
            begin = time.perf_counter()
            self._add_medium(own, medium, None)
            set_cycles(own, samples, seed)
            own.cycles.max_bounces = own.cycles.volume_bounces = bounces
            own.cycles.volume_biased = way.biased
            if way.denoised:
                own.cycles.use_denoising = True
                own.cycles.denoiser = "OPENIMAGEDENOISE"
            image = render_image(own, self.width, self.height, folder)[..., :3]
            return image, time.perf_counter() - begin

    def display(self, baked: Path, samples: int = 1, seed: int = 0, subpixels: int = 1) -> Image:
        """Cycles' image of a baked file under the scene's lights.

        Detail smaller than a pixel needs several rays. Cycles puts a single sample at the pixel's
        middle and several at random. A render of `subpixels` times the size, averaged down, is a
        midpoint rule, far better for as many rays: on the smoke, 72 pixels across, 1 ray errs by
        2.3 %, 4 at random by 2.1 %, 2 x 2 by 0.4 %.
        """
        with sandbox() as (own, folder):
            self._add_bake(own, baked, None, folder)
            set_cycles(own, samples, seed)
            # Unbiased null scattering makes pure emission noisy and clamps it.
            _march(own)
            own.cycles.max_bounces = own.cycles.volume_bounces = 0
            fine = render_image(own, self.width * subpixels, self.height * subpixels, folder)
        parts = fine[..., :3].reshape(self.height, subpixels, self.width, subpixels, 3)
        return np.asarray(parts.mean(axis=(1, 3)), np.float32)

    def display_eevee(self, baked: Path) -> Image:
        """EEVEE's image of a baked file under the scene's lights."""
        with sandbox() as (own, folder):
            self._add_bake(own, baked, EEVEE_GRIDS, folder)
            set_eevee(own, depth_range(self.camera, self.scene.medium.sigma_t.corners()))
            return render_image(own, self.width, self.height, folder)[..., :3]

    def witness(
        self,
        operator: Operator,
        samples: int,
        seed: int,
        lights: tuple[Light, ...] | None = None,
    ) -> Image | None:
        """Cycles' solution of the operator's own equation, where it has one (witness.py).

        `lights` are those that the model represents; by default those that the operator can.
        """
        if lights is None:
            lights = tuple(light for light in self.scene.lights if _fits(operator, light))
        scenes = witness_scenes(operator, self.scene, lights)
        if scenes is None:
            return None
        total = np.zeros((self.height, self.width, 3), np.float32)
        for index, (weight, scene) in enumerate(scenes):
            # Parts of one witness are independent.
            total += np.float32(weight) * self.reference(
                0, samples, seed * len(scenes) + index, scene
            )
        return total

    def identity(self) -> dict[str, object]:
        """Everything that the images depend on, as plain data."""
        return {
            "renderer": "cycles",
            "revision": SETTINGS_REVISION,
            "versions": self.versions(),
            "size": [self.width, self.height],
            "scene": _digest(self.scene),
            "lights": _light_values(self.source) if self.source is not None else [],
        }

    def versions(self) -> dict[str, str]:
        """Blender's version and build."""
        return {
            "blender": bpy.app.version_string,
            "blender_hash": bpy.app.build_hash.decode(),
        }

    def _clip(self, scene: Scene) -> tuple[float, float]:
        return clip_range(self.camera, scene.medium.sigma_t.corners())

    def _write_medium(self, scene: Scene, folder: Path) -> tuple[Path, IlluminationVolume]:
        path = folder / f"medium-{_digest(scene.medium)}.vdb"
        bare = IlluminationVolume("none", {}, scene.medium, {}, ())
        write_vdb(bare, path)
        return path, bare

    def _add_medium(
        self,
        own: bpy.types.Scene,
        medium: tuple[Path, IlluminationVolume],
        scene: Scene | None,
    ) -> None:
        """The medium that scatters, the camera, and `scene`'s lights or else the user's own."""
        shown = scene or self.scene
        path, bare = medium
        add_volume(own, path, medium_material("medium", bare))
        if scene is None and self.source is not None:
            self._copy_lights(own, self.source)
        else:
            add_lights(own, shown.lights, shown.medium.sigma_t.centre)
        add_camera(own, self.camera, self._clip(shown))

    def _add_bake(self, own: bpy.types.Scene, baked: Path, limit: int | None, folder: Path) -> None:
        volume = relight(read_vdb(baked), self.scene.lights)
        volume, file = displayed(volume, baked, folder, limit)
        add_volume(own, file, display_material("display", volume, limit))
        add_camera(own, self.camera, self._clip(self.scene))
        own.world = None

    def _copy_lights(self, own: bpy.types.Scene, source: bpy.types.Scene) -> None:
        own.frame_current = source.frame_current
        own.world = source.world
        for placed in light_objects(source):
            copy = placed.copy()
            # The camera sees the volume alone.
            copy.visible_camera = False
            own.collection.objects.link(copy)


def _march(scene: bpy.types.Scene) -> None:
    scene.cycles.volume_biased = True
    scene.cycles.volume_step_rate = STEP
    scene.cycles.volume_max_steps = LARGEST_STEPS


def _fits(operator: Operator, light: Light) -> bool:
    if operator.axis == "light":
        return isinstance(light, DistantLight)
    if operator.basis is not None:
        return isinstance(light, DistantLight | EnvironmentLight)
    return True


def _digest(value: object) -> str:
    """A hash of dataclasses, arrays and plain values, 16 hex digits."""
    state = hashlib.blake2b(digest_size=8)

    def add(part: object) -> None:
        if isinstance(part, np.ndarray):
            state.update(f"{part.dtype.str}{part.shape}".encode())
            state.update(np.ascontiguousarray(part).tobytes())
        elif isinstance(part, tuple | list):
            state.update(f"[{len(part)}".encode())
            for item in part:
                add(item)
        elif hasattr(part, "__dataclass_fields__"):
            state.update(type(part).__name__.encode())
            for name in part.__dataclass_fields__:
                add(getattr(part, name))
        else:
            state.update(repr(part).encode())

    add(value)
    return state.hexdigest()


def _light_values(source: bpy.types.Scene) -> list[object]:
    """The plain properties of the source's lights: Cycles sees more of them than the core."""
    values: list[object] = []
    for placed in light_objects(source):
        for block in (placed.data, placed.data.cycles):
            for prop in block.bl_rna.properties:
                if prop.identifier in ("session_uid", "users", "use_nodes"):  # no light in these
                    continue
                if prop.type in ("FLOAT", "INT", "BOOLEAN", "ENUM"):
                    value = getattr(block, prop.identifier)
                    plain = list(value) if getattr(prop, "is_array", False) else value
                    values.append([placed.name_full, prop.identifier, plain])
        values.append([placed.name_full, "matrix", [list(row) for row in placed.matrix_world]])
    plain_values: list[object] = json.loads(json.dumps(values, default=str))
    return plain_values
