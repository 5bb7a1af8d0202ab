"""A volume's radiance terms as plain nodes."""

from __future__ import annotations

from collections.abc import Iterable

import bpy
import numpy as np

from ..core import harmonics
from ..models.angular import Angular, Phase
from ..models.volume import Factor, IlluminationVolume, RadianceTerm
from .nodes import Term, Tree

CHANNEL = "volillum_"


def in_scattered(tree: Tree, volume: IlluminationVolume) -> Term:
    """The sum of the radiance terms, which may be negative."""
    parts: list[Term] = []
    for angular in dict.fromkeys(term.angular for term in volume.radiance):
        alike = (term for term in volume.radiance if term.angular == angular)
        part = tree.sum(_products(tree, volume, alike))
        if angular is not None:
            part = tree.vector("MULTIPLY", part, _angular(tree, angular))
        parts.append(part)
    return tree.sum(parts)


def _products(tree: Tree, volume: IlluminationVolume, terms: Iterable[RadianceTerm]) -> list[Term]:
    """Weights times channels; terms that pick components of one channel are dot products."""
    by_channel: dict[str, list[RadianceTerm]] = {}
    others = []
    for term in terms:
        if len(term.factors) == 1 and term.factors[0].component is not None:
            by_channel.setdefault(term.factors[0].channel, []).append(term)
        else:
            others.append(term)
    parts: list[Term] = []
    for channel, picks in by_channel.items():
        weights = np.zeros((3, 3))  # [colour, component]
        for term in picks:
            component = term.factors[0].component
            assert component is not None
            # A scalar grid reads as three equal components: only the first one counts.
            wide = volume.channels[channel].channels == 3
            weights[:, component if wide else 0] += term.weight
        grid = tree.attribute(CHANNEL + channel)
        parts.append(
            tree.combine(*(tree.vector("DOT_PRODUCT", grid, tuple(row)) for row in weights))
        )
    for term in others:
        product: Term = term.weight
        for factor in term.factors:
            product = tree.vector("MULTIPLY", _factor(tree, factor, volume), product)
        parts.append(product)
    return parts


def _factor(tree: Tree, factor: Factor, volume: IlluminationVolume) -> bpy.types.NodeSocket:
    grid = tree.attribute(CHANNEL + factor.channel)
    if factor.component is None or volume.channels[factor.channel].channels == 1:
        return grid
    return tree.vector("DOT_PRODUCT", grid, tuple(np.eye(3)[factor.component]))


def _angular(tree: Tree, angular: Angular) -> Term:
    """What the direction toward the eye makes of a term."""
    return _phase(tree, angular) if isinstance(angular, Phase) else _moment(tree, angular.index)


def _phase(tree: Tree, phase: Phase) -> bpy.types.NodeSocket:
    """(1 - g^2) / (1 + g^2 - 2 g cos)^(3/2) with cos = -omega . v."""
    omega: Term
    if phase.position is not None:
        away = tree.vector("SUBTRACT", phase.position, tree.geometry("Position"))
        omega = tree.vector("NORMALIZE", away)
    else:
        assert phase.direction is not None
        omega = phase.direction
    opposite = tree.vector("DOT_PRODUCT", tree.geometry("Incoming"), omega)
    base = tree.math("MULTIPLY_ADD", opposite, 2 * phase.g, 1 + phase.g**2)
    return tree.math("MULTIPLY", tree.math("POWER", base, -1.5), 1 - phase.g**2)


def _moment(tree: Tree, index: int) -> Term:
    """Y_lm(-v): constant, linear, or a sum of squares or of mixed products of v's components."""
    axes = np.eye(3)
    turned = np.roll(axes, -1, axis=0)  # y, z, x
    if index == 0:
        return float(harmonics.evaluate(axes)[0, 0])
    eye = tree.geometry("Incoming")
    if index < harmonics.count(1):
        return tree.vector("DOT_PRODUCT", eye, tuple(harmonics.evaluate(-axes)[:, index]))
    other, factors = eye, harmonics.evaluate(axes)[:, index]
    if not factors.any():
        other = tree.combine(*(tree.vector("DOT_PRODUCT", eye, tuple(axis)) for axis in turned))
        factors = 2 * harmonics.evaluate((axes + turned) / np.sqrt(2))[:, index]
    return tree.vector("DOT_PRODUCT", tree.vector("MULTIPLY", eye, other), tuple(factors))
