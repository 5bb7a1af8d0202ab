"""What several models' bakes share."""

from __future__ import annotations

import numpy as np
import pytest

from volillum_addon.models.engines import interleaved


@pytest.mark.parametrize("count", [1, 2, 3])
def test_planes_are_interleaved_in_place(count: int) -> None:
    planes = np.random.default_rng(count).random((count, 40, 31, 30), dtype=np.float32)
    expected = np.moveaxis(planes, 0, -1).copy()
    found = interleaved(planes)
    assert np.shares_memory(found, planes)
    assert np.array_equal(found, expected)
