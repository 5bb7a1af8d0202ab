"""Lights as photon mapping sees them: a source of photons, a strength, and unscattered light.

Each light's channels hold the answer of the medium to the light at unit strength; its brightness
is a weight (`strength`), so that a brighter lamp needs no new bake. The unit of a light is chosen
so that a channel is near 1 where nothing occludes:

    distant              fluence 4 pi
    environment          radiance 1; an image, its own radiance over its mean
    point, spot, area    intensity d0^2 (on the axis), d0 = max(distance to the medium's centre,
                         radius of the medium's bounds)
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ..core import harmonics
from ..core.control import Control
from ..core.directions import about, cone_rule, sphere_rule
from ..core.grid import Grid
from ..core.lights import (
    AreaLight,
    DistantLight,
    EnvironmentLight,
    Light,
    PointLight,
    SpotLight,
)
from ..core.medium import Medium
from ..core.native import native
from .angular import MOMENTS, Phase
from .engines import sweep

Rgb = NDArray[np.float64]
# A sun's disc takes its share of the sphere's directions, and an area light's surface of points,
# but at least these: its edge is smooth.
LEAST_DISC_DIRECTIONS = 16
# Half of an image's directions go where the light is, half where the solid angle is.
SPREAD_SHARE = 0.5
# Pixels for each direction, at least: rectangles of few can only be halved unevenly.
PIXELS = 4


def source(light: Light) -> native.PhotonSource:
    """Where the light's photons come from."""
    make = native.PhotonSource
    if isinstance(light, DistantLight):
        return make.distant(np.asarray(light.direction), math.cos(light.angle / 2))
    if isinstance(light, EnvironmentLight):
        if not _is_lit_image(light):
            return make.environment()
        rotation = np.eye(3) if light.rotation is None else np.asarray(light.rotation)
        return make.image(
            np.ascontiguousarray(light.radiance, np.float64),
            np.ascontiguousarray(rotation, np.float64),
        )
    if isinstance(light, PointLight):
        return make.point(np.asarray(light.position))
    if isinstance(light, SpotLight):
        edge = math.cos(light.angle / 2)
        return make.spot(np.asarray(light.position), np.asarray(light.direction), edge, light.blend)
    assert isinstance(light, AreaLight)
    return make.area(
        np.asarray(light.position), np.asarray(light.direction), light.half_axes, light.ellipse
    )


def emission_source(emission: Grid) -> native.PhotonSource:
    """Photons from the medium's own emission."""
    return native.PhotonSource.emission(emission.planes())


def unit(light: Light, lattice: Grid) -> float:
    """The light's unit, in that of `source`: fluence, radiance, or intensity."""
    if isinstance(light, DistantLight):
        return 4 * math.pi
    if isinstance(light, EnvironmentLight):
        return 1 / _mean_radiance(light) if _is_lit_image(light) else 1.0
    return _reference_distance(light, lattice) ** 2


def strength(light: Light, lattice: Grid) -> Rgb:
    """RGB in-scattered radiance for one unit of the light's channels."""
    if isinstance(light, DistantLight):
        return light.fluence(lattice.centre) / (4 * math.pi)
    if isinstance(light, EnvironmentLight):
        if not _is_lit_image(light):
            return np.asarray(light.radiance).reshape(-1, 3).mean(axis=0)
        return np.full(3, _mean_radiance(light))
    assert isinstance(light, PointLight | SpotLight | AreaLight)
    return np.asarray(light.intensity) / _reference_distance(light, lattice) ** 2


def has_direction(light: Light) -> bool:
    """Whether the light comes to each point from one direction, or nearly."""
    return not isinstance(light, EnvironmentLight)


def is_coloured(light: Light) -> bool:
    """Whether the light's channels need three colours in a grey medium."""
    if not isinstance(light, EnvironmentLight) or not _is_lit_image(light):
        return False
    return bool(np.ptp(np.asarray(light.radiance), axis=-1).any())


def phase_of(light: Light, g: float, centre: NDArray[np.float64]) -> Phase:
    """The phase function of the light that comes straight from it; `centre` is the medium's.

    A sun's disc blurs the phase function: band 1 of it by the disc's mean cosine. Henyey and
    Greenstein's function with that product for its g has the same band 1. An area light is taken
    as spread as the centre sees it.
    """
    if isinstance(light, DistantLight):
        blurred = g * (1 + math.cos(light.angle / 2)) / 2
        return Phase(blurred, direction=tuple(np.asarray(light.direction).tolist()))
    position = np.asarray(light.position)  # type: ignore[attr-defined]
    if isinstance(light, AreaLight) and light.area:
        points, shares = light.points(256)
        away = centre - points
        distance = np.linalg.norm(away, axis=-1, keepdims=True)
        shares = shares[:, None] * light.shape(away @ np.asarray(light.direction))[:, None]
        shares = shares / np.maximum(distance, 1e-300) ** 3
        if shares.sum() > 0:
            mean = (shares * away / distance).sum(axis=0) / shares.sum()
            g = g * float(np.linalg.norm(mean))
    return Phase(g, position=tuple(position.tolist()))


def unscattered(
    light: Light, medium: Medium, directions: int, near: int, control: Control
) -> NDArray[np.float32]:
    """Exact mean over directions of the radiance that has not been scattered, in the light's unit,
    [1 or 3, i, j, k]."""
    sigma_t = medium.sigma_t
    if isinstance(light, DistantLight):
        share = (1 - math.cos(light.angle / 2)) / 2
        count = max(LEAST_DISC_DIRECTIONS, round(directions * share)) if light.angle else 1
        vectors, weights = cone_rule(light.angle / 2, count)
        vectors = about(vectors, np.asarray(light.direction))
        return np.asarray(sweep(sigma_t, vectors, weights[:, None], near, control)[:, 0])
    if isinstance(light, EnvironmentLight):
        vectors, weights = _rule_of(light, directions)
        found = sweep(sigma_t, vectors, weights, near, control)
        if sigma_t.channels == 3:
            # Each colour of the light through its own extinction.
            return np.stack([found[c, min(c, found.shape[1] - 1)] for c in range(3)])
        mean: NDArray[np.float32] = found[0]
        return mean
    assert isinstance(light, PointLight | SpotLight | AreaLight)
    positions, shares = np.asarray(light.position)[None], np.ones(1)
    if isinstance(light, AreaLight) and light.area:
        part = light.fluence(sigma_t.centre).mean() * light.area / (4 * math.pi)
        part = part / max(float(np.asarray(light.intensity).mean()), 1e-300)
        positions, shares = light.points(max(LEAST_DISC_DIRECTIONS, round(directions * part)))
    total: NDArray[np.float32] | None = None
    for number, (position, share) in enumerate(zip(positions, shares, strict=True)):
        with control.stage(number / len(shares), (number + 1) / len(shares), "visibility"):
            planes: NDArray[np.float32] = native.transmittance_to(
                sigma_t.planes(), sigma_t.index_to_world, position, control=control.native
            )
        for i, points in enumerate(_slices(sigma_t)):
            planes[:, i] *= share * _falloff(light, position, share, points, sigma_t)
        total = planes if total is None else total + planes
    assert total is not None
    return total


def add_moments(
    light: EnvironmentLight,
    medium: Medium,
    directions: int,
    near: int,
    planes: NDArray[np.float32],
    control: Control,
) -> None:
    """Adds the moments, means of radiance times sqrt(4 pi) Y_lm, of the light that has not been
    scattered to `planes` [9 moments * 1 or 3 colours, i, j, k]."""
    vectors, weights = _rule_of(light, directions)
    basis = math.sqrt(4 * math.pi) * harmonics.evaluate(vectors)[:, :MOMENTS]
    weights = np.broadcast_to(weights, (len(weights), len(planes) // MOMENTS))
    extinctions = medium.sigma_t.channels
    for index, sigma_t in enumerate(medium.sigma_t.planes()):
        own = weights[:, index::extinctions]  # all colours at once where they share the extinction
        columns = (basis[:, :, None] * own[:, None]).reshape(len(vectors), -1)
        with control.stage(index / extinctions, (index + 1) / extinctions, "unscattered light"):
            native.sweep(
                sigma_t,
                medium.sigma_t.index_to_world,
                vectors,
                np.ascontiguousarray(columns, dtype=np.float32),
                near_slices=near,
                control=control.native,
                out=planes[index::extinctions],
                add=True,
            )


def _rule_of(
    light: EnvironmentLight, directions: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Directions [d, 3] and the weights of radiances in them, [d, 1 or 3]."""
    if _is_lit_image(light):
        vectors, weights = image_rule(light, directions)
        weights = weights / (4 * math.pi * _mean_radiance(light))
    else:
        vectors, weights = sphere_rule(directions)
        weights = weights[:, None]
    return np.ascontiguousarray(vectors), weights if is_coloured(light) else weights[:, :1]


def image_rule(
    light: EnvironmentLight, count: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """About `count` outward directions [d, 3] of an image and the RGB radiance times solid angle
    that each stands for [d, 3]; their sum is the image's.

    Median cut (Debevec 2005): the rectangle of pixels with most of a mixture of light and solid
    angle is halved until there are enough. A sun in a pixel ends with a direction of its own.
    """
    directions, solid, radiance = light.pixels(PIXELS * count)
    height, width = solid.shape
    power = radiance * solid[..., None]
    bright = power.mean(axis=-1)
    importance = (1 - SPREAD_SHARE) * bright / bright.sum() + SPREAD_SHARE * solid / (4 * math.pi)

    # Ties are broken by place, so that the rule does not depend on the heap's history.
    heap: list[tuple[float, int, int, int, int]] = [(-1.0, 0, height, 0, width)]
    whole: list[tuple[int, int, int, int]] = []
    while heap and len(heap) + len(whole) < count:
        _, top, bottom, left, right = heapq.heappop(heap)
        if bottom - top == 1 and right - left == 1:
            whole.append((top, bottom, left, right))
            continue
        part = importance[top:bottom, left:right]
        middle = math.pi * (0.5 - (top + bottom) / (2 * height))
        tall = (bottom - top) / height * math.pi
        wide = (right - left) / width * 2 * math.pi * math.cos(middle)
        rows = bottom - top > 1 and (tall >= wide or right - left == 1)
        sums = np.cumsum(part.sum(axis=1 if rows else 0))
        cut = int(np.clip(np.searchsorted(sums, sums[-1] / 2) + 1, 1, len(sums) - 1))
        halves = (
            ((top, top + cut, left, right), (top + cut, bottom, left, right))
            if rows
            else ((top, bottom, left, left + cut), (top, bottom, left + cut, right))
        )
        for a, b, c, d in halves:
            heapq.heappush(heap, (-float(importance[a:b, c:d].sum()), a, b, c, d))
    vectors, weights = [], []
    for a, b, c, d in sorted(whole + [entry[1:] for entry in heap]):
        total = power[a:b, c:d].sum(axis=(0, 1))
        if not total.any():
            continue
        mean = (directions[a:b, c:d] * bright[a:b, c:d, None]).sum(axis=(0, 1))
        vectors.append(mean / np.linalg.norm(mean))
        weights.append(total)
    return np.array(vectors), np.array(weights)


def _is_lit_image(light: EnvironmentLight) -> bool:
    """Whether the radiance varies with direction (a black image is a black constant)."""
    return light.is_image and bool(np.any(light.radiance))


def _mean_radiance(light: EnvironmentLight) -> float:
    """Mean of an image over directions and colours."""
    return float(light.fluence(np.zeros(3)).mean()) / (4 * math.pi)


def _reference_distance(light: Light, lattice: Grid) -> float:
    position = np.asarray(light.position)  # type: ignore[attr-defined]
    radius = float(np.linalg.norm(lattice.corners() - lattice.centre, axis=1).max())
    return max(float(np.linalg.norm(position - lattice.centre)), radius)


def _falloff(
    light: PointLight | SpotLight | AreaLight,
    position: NDArray[np.float64],
    share: float,
    points: NDArray[np.float64],
    lattice: Grid,
) -> NDArray[np.float64]:
    """F / (4 pi) of the light's unit at world points [..., 3], were all of it at `position`.

    In the voxel that holds the light 1 / d^2 is cut to its mean over a ball of the voxel's volume;
    a share of an area light's surface fills at most half of all directions.
    """
    volume = abs(float(np.linalg.det(lattice.index_to_world[:3, :3])))
    closest = (3 * volume / (4 * math.pi)) ** (2 / 3) / 3
    away = points - position
    squared = (away**2).sum(axis=-1)
    shape: NDArray[np.float64] | float = 1.0
    if not isinstance(light, PointLight):
        cosine = away @ np.asarray(light.direction) / np.sqrt(np.maximum(squared, 1e-300))
        shape = light.shape(cosine)
    if isinstance(light, AreaLight):
        closest = max(closest, share * light.area / (2 * math.pi))
    bounded = np.maximum(squared, closest)
    unit = _reference_distance(light, lattice) ** 2
    return np.asarray(shape * unit / (4 * math.pi * bounded), np.float64)


def _slices(lattice: Grid) -> Iterator[NDArray[np.float64]]:
    """World positions [j, k, 3] of the voxels, one i after the other."""
    _, nj, nk = lattice.shape
    jk = np.stack(np.meshgrid(np.arange(nj), np.arange(nk), indexing="ij"), -1)
    for i in range(lattice.shape[0]):
        index = np.concatenate([np.full((nj, nk, 1), i), jk], axis=-1)
        yield lattice.to_world(index.astype(np.float64))
