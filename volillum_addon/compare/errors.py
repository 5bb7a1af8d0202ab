"""The errors of one model in one scene: signed images that add up, and the field's own.

    display   = D - G    Blender's image of the grids against our line integral of the same grids
    numerical = G - X    that line integral against the model's exact image
    model     = X - F    the exact image against full scattering
    total     = D - F    = display + numerical + model, pixel by pixel

Each is also summed up as a figure against its own truth (metrics.py).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..core.camera import Camera
from ..core.control import Control
from ..core.errors import bad
from ..core.medium import Medium
from ..core.native import native
from ..core.scene import Scene
from ..models.exact import REPLICATES, Estimate, exact, exact_coefficients
from ..models.spherical_harmonics import coefficients
from ..models.volume import IlluminationVolume
from .metrics import Exposure, Figure, Image, Mask, best_exposure, figure, sampled_figure

# Voxels that are weighed for their visibility, for each one that is judged.
CANDIDATES = 20


@dataclass(frozen=True, eq=False)
class ErrorImages:
    """The four images of one model; each error is the difference of two of them."""

    displayed: Image  # D
    integrated: Image  # G
    exact: Image  # X
    full: Image  # F

    @property
    def display(self) -> NDArray[np.float64]:
        """D - G, [h, w, 3]."""
        return self.displayed.value - self.integrated.value

    @property
    def numerical(self) -> NDArray[np.float64]:
        """G - X, [h, w, 3]."""
        return self.integrated.value - self.exact.value

    @property
    def model(self) -> NDArray[np.float64]:
        """X - F, [h, w, 3]."""
        return self.exact.value - self.full.value

    @property
    def total(self) -> NDArray[np.float64]:
        """D - F, [h, w, 3]."""
        return self.displayed.value - self.full.value

    def figures(self, mask: Mask) -> dict[str, Figure]:
        """Each error against its own truth, inside the silhouette."""
        return {
            "display": figure(self.displayed, self.integrated, mask),
            "numerical": figure(self.integrated, self.exact, mask),
            "model": figure(self.exact, self.full, mask),
            "total": figure(self.displayed, self.full, mask),
        }

    def exposed(self, mask: Mask) -> tuple[Exposure, Figure]:
        """The best-fitting exposure, and the total error after it."""
        exposure = best_exposure(self.displayed, self.full, mask)
        return exposure, figure(self.displayed.scaled(exposure.factor), self.full, mask)


def image_of(estimate: Estimate) -> Image:
    """An estimate of the exact evaluator with its degrees of freedom."""
    return Image(estimate.value, estimate.standard_error**2, REPLICATES - 1)


def visible_voxels(medium: Medium, camera: Camera, count: int, seed: int) -> NDArray[np.int64]:
    """Index positions [n, 3] of `count` draws of voxels that the camera sees.

    A voxel's probability is proportional to tau sigma_t: its extinction (the mean of the colours)
    times its transmittance to the eye. Draws are independent, so a voxel may come twice.
    """
    grid = medium.sigma_t
    planes = grid.planes()
    random = np.random.default_rng(seed)
    cumulative = np.cumsum(planes.mean(axis=0, dtype=np.float64).ravel())
    drawn = random.random(count * CANDIDATES) * cumulative[-1]
    candidates = np.minimum(np.searchsorted(cumulative, drawn, side="right"), len(cumulative) - 1)
    index = np.stack(np.unravel_index(candidates, grid.shape), axis=-1)
    points = grid.to_world(index.astype(np.float64))
    if camera.orthographic:
        toward = np.tile(-camera.forward, (len(points), 1))
    else:
        toward = camera.eye - points
        toward /= np.maximum(np.linalg.norm(toward, axis=-1, keepdims=True), 1e-30)
    depth = native.exact_optical_depth(planes, grid.index_to_world, points, toward)
    eye = grid.to_index(camera.eye)
    if not camera.orthographic and np.all(eye > -1) and np.all(eye < np.array(grid.shape)):
        # Beyond an eye inside the volume the ray goes on: take that part away again.
        eyes = np.tile(camera.eye, (len(points), 1))
        depth = depth - native.exact_optical_depth(planes, grid.index_to_world, eyes, toward)
    seen = np.exp(-np.maximum(depth, 0.0)).mean(axis=-1)
    if not seen.sum() > 0:
        raise bad("the volume's visibility from the camera", 0, "some visible voxel")
    return np.asarray(index[random.choice(len(index), count, p=seen / seen.sum())], np.int64)


@dataclass(frozen=True, eq=False)
class FieldTruth:
    """A model's exact solution at visible voxels: index positions [n, 3], how often each one was
    drawn [n], and the radiance [n, 3]. It serves every setting that leaves the equation alone."""

    index: NDArray[np.int64]
    counts: NDArray[np.integer]
    radiance: Image


def field_truth(
    scene: Scene,
    volume: IlluminationVolume,
    voxels: int = 2000,
    samples: int = 2048,
    seed: int = 0,
    control: Control | None = None,
    clamped: bool = True,
) -> FieldTruth:
    """The exact solution of the baked model at `voxels` draws of visible voxels, `samples`
    directions each. `clamped` False: before negative radiance is cut to 0."""
    index = visible_voxels(volume.medium, scene.need_camera(), voxels, seed)
    unique, counts = np.unique(index, axis=0, return_counts=True)
    points = volume.medium.sigma_t.to_world(unique.astype(np.float64))
    given = volume.parameters
    estimate = exact(scene, volume.model, points, samples, seed, control, clamped=clamped, **given)
    return FieldTruth(unique, counts, image_of(estimate))


def field_error(
    scene: Scene,
    volume: IlluminationVolume,
    voxels: int = 2000,
    samples: int = 2048,
    seed: int = 0,
    control: Control | None = None,
    clamped: bool = True,
    truth: FieldTruth | None = None,
) -> Figure:
    """Baked in-scattered radiance against the model's exact solution at visible voxels' centres.

    `scene` is the scene that was baked; `samples` directions a voxel. `clamped` False compares what
    is there before negative radiance is cut to 0, which would hide errors. `truth` is what
    `field_truth` gave for this equation, None: it is made.
    """
    if truth is None:
        truth = field_truth(scene, volume, voxels, samples, seed, control, clamped)
    seen = volume.in_scattered(view=scene.need_camera(), clamped=clamped)
    baked = seen.values[tuple(truth.index.T)].astype(np.float64)
    return sampled_figure(Image.noiseless(baked), truth.radiance, truth.counts)


def coefficient_errors(
    scene: Scene,
    volume: IlluminationVolume,
    voxels: int = 2000,
    samples: int = 2048,
    seed: int = 0,
    control: Control | None = None,
) -> tuple[Figure, list[Figure]]:
    """Baked coefficients V_lm of the visibility against exact ones, at visible voxels' centres.

    Of all coefficients together, relative to all of them, and of each one relative to itself. The
    truncation to a few bands is no part of it: it is the model's error, not the numbers'.
    """
    index = visible_voxels(volume.medium, scene.need_camera(), voxels, seed)
    unique, counts = np.unique(index, axis=0, return_counts=True)
    points = volume.medium.sigma_t.to_world(unique.astype(np.float64))
    truth = exact_coefficients(
        scene, volume.model, points, samples, seed, control, **volume.parameters
    )
    baked = np.moveaxis(coefficients(volume)[:, *unique.T], 0, 1).astype(np.float64)

    def error_of(part: slice) -> Figure:
        return sampled_figure(
            _in_colours(baked[:, part], np.zeros_like(baked[:, part]), np.inf),
            _in_colours(truth.value[:, part], truth.standard_error[:, part] ** 2, REPLICATES - 1),
            counts,
        )

    each = [error_of(slice(n, n + 1)) for n in range(baked.shape[1])]
    return error_of(slice(None)), each


def _in_colours(value: NDArray[np.float64], variance: NDArray[np.float64], degrees: float) -> Image:
    """Coefficients [n, count, 1 or 3] as an image [n, count, 3]; one colour stands for three."""
    shape = (*value.shape[:-1], 3)
    return Image(np.broadcast_to(value, shape), np.broadcast_to(variance, shape), degrees)
