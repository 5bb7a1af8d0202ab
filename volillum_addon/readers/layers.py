"""Slabs from layers that are read one by one."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from .source import Slab


def stacked(count: int, layer: Callable[[int], Slab]) -> Callable[[int], Iterator[Slab]]:
    """A `Source.slabs` of `count` layers [i, j], each read when its turn comes."""

    def slabs(depth: int) -> Iterator[Slab]:
        for begin in range(0, count, depth):
            layers = range(begin, min(begin + depth, count))
            yield np.stack([layer(k) for k in layers], axis=-1)

    return slabs


def sliced(values: Slab) -> Callable[[int], Iterator[Slab]]:
    """A `Source.slabs` of an array [i, j, k] (which may be a file mapped into memory)."""

    def slabs(depth: int) -> Iterator[Slab]:
        for begin in range(0, values.shape[2], depth):
            yield values[:, :, begin : begin + depth]

    return slabs
