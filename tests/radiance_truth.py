"""Radiance along rays through the trilinear medium, in numpy: truth for shadow propagation."""

from __future__ import annotations

import numpy as np
from trilinear import Array, Ray, interpolate

REC_709 = np.array([0.2126, 0.7152, 0.0722])


def radiance(
    sigma_t: np.ndarray,
    source: np.ndarray,
    index_to_world: Array,
    origin: Array,
    direction: Array,
    light: Array,
    halvings: int = 1,
) -> Array:
    """L [3] = light exp(-od) + int exp(-od(s)) source ds of channels [1 or 3, ...] and [3, ...].

    Every piece of the ray inside a cell is halved `halvings` times; four Gauss points integrate
    the source on each, and three the optical depth up to each of them, which is exact.
    """
    ray = Ray(sigma_t.shape[1:], index_to_world, origin, direction)
    starts, t, weight = ray.nodes(4, halvings)
    if len(starts) == 0:
        return np.array(light, float)
    inner, inner_weight = np.polynomial.legendre.leggauss(3)
    ends = np.append(ray_ends(ray, halvings)[1:, None], np.zeros((0, 1)), axis=0)
    begin = ray_ends(ray, halvings)[:-1, None]
    targets = np.concatenate([t, ends], axis=1)
    length = targets - begin
    places = begin[..., None] + length[..., None] * (inner + 1) / 2
    sampled = interpolate(sigma_t, ray.at(places))
    depth = (sampled * inner_weight).sum(-1) * length / 2
    before = np.concatenate([np.zeros((len(depth), 1)), np.cumsum(depth[:, :, -1], axis=1)], axis=1)
    attenuation = np.exp(-(before[:, :-1, None] + depth[:, :, :-1]))
    emitted = (weight * attenuation * interpolate(source, ray.at(t))).sum((1, 2))
    return np.asarray(light * np.exp(-before[:, -1]) + emitted)


def ray_ends(ray: Ray, halvings: int) -> Array:
    """Ends of the halved pieces."""
    steps = np.linspace(0, 1, 2**halvings, endpoint=False)
    fine = ray.cuts[:-1, None] + steps * np.diff(ray.cuts)[:, None]
    return np.append(fine.ravel(), ray.cuts[-1])


def hue(light: Array, dark: float, fallback: Array) -> Array:
    """gamma: L / luminance(L), `fallback` where the luminance is below `dark`."""
    luminance = float(REC_709 @ light)
    return np.asarray(light / luminance if luminance >= dark else fallback)
