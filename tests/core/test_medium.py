"""The medium: coefficients, trimming to what a scene needs, and what it refuses."""

from __future__ import annotations

import numpy as np
import pytest

from volillum_addon.core.errors import InputError
from volillum_addon.core.grid import Grid
from volillum_addon.core.medium import Medium


def grid(values: np.ndarray) -> Grid:
    return Grid(values.astype(np.float32), np.eye(4), "density")


def test_density_becomes_coefficients() -> None:
    density = grid(np.random.default_rng(3).random((3, 4, 5)))
    medium = Medium.from_density(density, 2.0, (0.9, 0.5, 0.1))
    assert medium.channels == 1
    assert np.allclose(medium.sigma_t.values, 2 * density.values)
    assert medium.sigma_s.channels == 3
    albedo = medium.constant_albedo
    assert albedo is not None
    # float32 products: a few times 2^-24.
    assert np.allclose(albedo, (0.9, 0.5, 0.1), rtol=1e-6)
    # Live asks for it again and again: every voxel is looked at once.
    assert medium.constant_albedo is albedo
    assert not albedo.flags.writeable


def test_a_varying_albedo_is_not_constant() -> None:
    sigma_t = grid(np.ones((2, 2, 2)))
    sigma_s = np.full((2, 2, 2), 0.5)
    sigma_s[1, 1, 1] = 0.4
    assert Medium(sigma_t, grid(sigma_s)).constant_albedo is None


def test_colour_of_extinction() -> None:
    density = grid(np.random.default_rng(4).random((3, 4, 5)))
    assert np.array_equal(Medium.from_density(density).extinction_colour, np.ones(3))
    coloured = Medium.from_density(density, (1.0, 4.0, 0.0))
    assert np.allclose(coloured.extinction_colour, (0.25, 1.0, 0.0), rtol=1e-6)
    values = coloured.sigma_t.values.copy()
    values[1, 2, 3, 0] *= 1.001
    assert Medium(density.with_values(values), coloured.sigma_s).extinction_colour is None
    empty = density.with_values(np.zeros((3, 4, 5, 3), np.float32))
    assert np.array_equal(Medium(empty, empty).extinction_colour, np.ones(3))


def test_trimming_keeps_matter_and_drops_equal_channels() -> None:
    values = np.zeros((9, 9, 9))
    values[4, 5, 6] = 2.0
    wide = grid(np.repeat(values[..., None], 3, -1))
    trimmed = Medium(wide, wide).trimmed(2)
    assert trimmed.channels == 1
    assert trimmed.sigma_t.shape == (5, 5, 5)
    assert trimmed.sigma_t.values[2, 2, 2] == 2.0
    assert np.allclose(trimmed.sigma_t.centre, (4, 5, 6))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Medium(grid(-np.ones((2, 2, 2))), grid(np.zeros((2, 2, 2)))), "negative voxels"),
        (lambda: Medium(grid(np.ones((2, 2, 2))), grid(np.full((2, 2, 2), 1.1))), "above sigma_t"),
        (lambda: Medium(grid(np.ones((2, 2, 2))), grid(np.ones((2, 2, 3)))), "lattice"),
        (lambda: Medium(grid(np.ones((2, 2, 2))), grid(np.ones((2, 2, 2))), g=1.0), "g is 1"),
        (lambda: Medium.from_density(grid(np.ones((2, 2, 2))), 1.0, 1.5), "albedo"),
        (lambda: Medium.from_density(grid(np.ones((2, 2, 2))), -1.0), "density scale"),
        (lambda: Medium.from_density(grid(np.zeros((2, 2, 2)))).trimmed(1), "only zeros"),
    ],
)
def test_what_cannot_be_a_medium_is_refused(make: object, message: str) -> None:
    with pytest.raises(InputError, match=message):
        make()  # type: ignore[operator]
