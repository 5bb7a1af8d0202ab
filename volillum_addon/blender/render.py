"""Settings of the two engines and the way from a render to an array."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import OpenEXR
from mathutils import Matrix
from numpy.typing import NDArray

from ..core.camera import Camera

Image = NDArray[np.float32]
# Jittered froxels average over this many samples.
EEVEE_SAMPLES = 16
# The near clipping distance as a share of the far one: float32 depths still tell them apart.
NEAREST = 1e-5


def render_image(scene: bpy.types.Scene, width: int, height: int, folder: Path) -> Image:
    """Render the scene; linear float32 RGBA [h, w, 4], top row first, premultiplied."""
    render = scene.render
    render.resolution_x, render.resolution_y = width, height
    render.resolution_percentage = 100
    render.pixel_aspect_x = render.pixel_aspect_y = 1
    render.film_transparent = True
    render.use_compositing = render.use_sequencer = False
    render.use_persistent_data = False
    render.dither_intensity = 0
    render.image_settings.file_format = "OPEN_EXR"
    render.image_settings.color_mode = "RGBA"
    render.image_settings.color_depth = "32"
    render.use_file_extension = False
    path = folder / "image.exr"
    render.filepath = str(path)
    bpy.ops.render.render(scene=scene.name, write_still=True)
    with OpenEXR.File(str(path)) as file:
        channels = file.channels()
        whole = next(iter(channels.values())).pixels
        if whole.ndim == 3:
            return np.ascontiguousarray(whole, dtype=np.float32)
        return np.stack([channels[name].pixels for name in "RGBA"], axis=-1).astype(np.float32)


def set_cycles(scene: bpy.types.Scene, samples: int, seed: int) -> None:
    """Cycles on the processor without anything that bends the mean: no clamp, no denoiser, no
    adaptive sampling, box filter (a pixel is the mean over its area)."""
    scene.render.engine = "CYCLES"
    cycles = scene.cycles
    cycles.device = "CPU"
    cycles.samples = samples
    cycles.seed = seed
    cycles.use_adaptive_sampling = False
    cycles.use_denoising = False
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0
    cycles.light_sampling_threshold = 0
    cycles.pixel_filter_type = "BOX"
    cycles.film_exposure = 1
    cycles.use_fast_gi = False
    cycles.use_guiding = False
    cycles.blur_glossy = 0


def add_camera(scene: bpy.types.Scene, camera: Camera, clip: tuple[float, float]) -> None:
    """The core's camera as the scene's camera; `clip` holds all that is to be seen."""
    data = bpy.data.cameras.new("volillum")
    data.sensor_fit = "VERTICAL"
    # With this fit scale and shifts are shares of the height, as the core has them.
    data.shift_x, data.shift_y = camera.shift
    data.clip_start, data.clip_end = clip
    if camera.orthographic:
        data.type = "ORTHO"
        data.ortho_scale = camera.height
    else:
        data.angle = camera.fov
    placed = bpy.data.objects.new("volillum", data)
    scene.collection.objects.link(placed)
    forward = camera.forward
    right = np.cross(forward, np.asarray(camera.up))
    right /= np.linalg.norm(right)
    matrix = np.eye(4)
    matrix[:3, 0], matrix[:3, 1], matrix[:3, 2] = right, np.cross(right, forward), -forward
    matrix[:3, 3] = camera.eye
    placed.matrix_world = Matrix(matrix.tolist())
    scene.camera = placed


def clip_range(camera: Camera, corners: NDArray[np.float64]) -> tuple[float, float]:
    """Clipping distances well outside the corners [n, 3].

    The near one is next to the eye: Blender's mesh around a volume is padded, and a ray that is
    clipped to start inside it finds no volume at all.
    """
    _, far = depth_range(camera, corners)
    return far * NEAREST, far * 2


def depth_range(camera: Camera, corners: NDArray[np.float64]) -> tuple[float, float]:
    """Depths along the view that hold all corners [n, 3] in front of the eye."""
    depth = (corners - camera.eye) @ camera.forward
    far = max(float(depth.max()), 1e-6)
    return max(float(depth.min()), far * NEAREST), far


def set_eevee(scene: bpy.types.Scene, depths: tuple[float, float]) -> None:
    """EEVEE with the finest froxels, spread evenly over the volume's depths."""
    scene.render.engine = "BLENDER_EEVEE"
    eevee = scene.eevee
    eevee.taa_render_samples = EEVEE_SAMPLES
    eevee.volumetric_tile_size = "1"
    eevee.volumetric_samples = 256
    eevee.volumetric_sample_distribution = 0
    eevee.use_volume_custom_range = True
    eevee.volumetric_start, eevee.volumetric_end = depths
    eevee.use_raytracing = False
    scene.render.filter_size = 0
