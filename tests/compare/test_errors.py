"""Which voxels are judged, and the error of a baked field with a planted fault."""

from dataclasses import replace

import numpy as np
import pytest
from comparisons import synthetic_scene

from volillum_addon.compare.errors import (
    coefficient_errors,
    field_error,
    field_truth,
    visible_voxels,
)
from volillum_addon.core.camera import Camera
from volillum_addon.core.errors import InputError
from volillum_addon.core.grid import Grid
from volillum_addon.core.medium import Medium
from volillum_addon.models.exact import exact
from volillum_addon.models.illuminate import VOID_MARGIN, bake
from volillum_addon.models.volume import Factor, IlluminationVolume, RadianceTerm

DRAWS = 20_000


def column(sigma_t: list[float]) -> Medium:
    """One voxel wide and high, along x; voxel size 1."""
    grid = Grid(np.array(sigma_t, np.float32)[:, None, None], np.eye(4), "column")
    return Medium(grid, grid)


@pytest.mark.parametrize("orthographic", [True, False])
def test_voxels_are_drawn_by_their_visibility(orthographic: bool) -> None:
    sigma_t = np.array([0.5, 1.5, 0.0, 1.0])
    camera = Camera((-50.0, 0.0, 0.0), (0.0, 0.0, 0.0), orthographic=orthographic)
    index = visible_voxels(column(list(sigma_t)), camera, DRAWS, 1)
    share = np.bincount(index[:, 0], minlength=4) / DRAWS
    # Trapezoids along the axis: the interpolant falls to 0 one voxel before the first.
    depth = np.concatenate([[0.25], 0.25 + np.cumsum((sigma_t[1:] + sigma_t[:-1]) / 2)])
    expected = sigma_t * np.exp(-depth)
    expected /= expected.sum()
    # Binomial standard errors, and those of the 20 x as many candidates on top (5 % more).
    deviation = np.sqrt(expected * (1 - expected) / DRAWS) * 1.05
    assert np.all(np.abs(share - expected) <= 4 * deviation)
    assert share[2] == 0


def test_matter_behind_an_eye_inside_the_volume_hides_nothing() -> None:
    medium = column([3.0, 3.0, 0.0, 0.0, 1.0, 1.0])
    eye = Camera((2.5, 0.0, 0.0), (5.0, 0.0, 0.0))
    index = visible_voxels(medium, eye, DRAWS, 2)
    share = np.bincount(index[:, 0], minlength=6) / DRAWS
    # From 2.5 to the voxels: the slopes 3 -> 0 (1 to 2) and 0 -> 1 (3 to 4), then constant.
    depth = np.array([1.5 + 3.0, 1.5, 0, 0, 0.5, 1.5])
    expected = np.array([3.0, 3.0, 0, 0, 1.0, 1.0]) * np.exp(-depth)
    expected /= expected.sum()
    deviation = np.sqrt(expected * (1 - expected) / DRAWS) * 1.05
    assert np.all(np.abs(share - expected) <= 4 * deviation)


def test_draws_depend_on_the_seed_alone() -> None:
    scene = synthetic_scene()
    one, same, other = (
        visible_voxels(scene.medium, scene.need_camera(), 500, seed) for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(one, same)
    assert not np.array_equal(one, other)


def test_a_planted_error_of_two_percent_is_found() -> None:
    scene = synthetic_scene()
    medium = scene.trimmed(VOID_MARGIN).medium
    grid = medium.sigma_t
    index = np.stack(np.indices(grid.shape), axis=-1).reshape(-1, 3).astype(np.float64)
    model, parameters = "multidirectional_occlusion", {"theta": 0.5}
    # A field from the judge itself, with other random directions, 2 % too bright.
    values = exact(scene, model, grid.to_world(index), 128, seed=99, **parameters).value
    field = Grid((1.02 * values).reshape(*grid.shape, 3).astype(np.float32), grid.index_to_world)
    volume = IlluminationVolume(
        model, parameters, medium, {"field": field}, (RadianceTerm((Factor("field"),), (1, 1, 1)),)
    )
    found = field_error(scene, volume, voxels=800, samples=256)
    assert not found.is_bound
    assert found.bias == pytest.approx(0.02, abs=4 * found.bias_noise)
    assert found.bias_noise < 0.002
    # The field's own noise adds to the 2 %, so only from above.
    assert 0.02 - 4 * found.noise < found.relative_rmse < 0.03


def test_a_field_of_another_albedo_is_no_error_of_the_field() -> None:
    # In-scattered radiance does not contain sigma_s: an albedo error must not show here, which is
    # why the image's errors are reported beside it.
    scene = synthetic_scene()
    medium = scene.medium
    dark = replace(
        scene, medium=replace(medium, sigma_s=medium.sigma_s.with_values(medium.sigma_s.values / 2))
    )
    points = medium.sigma_t.to_world(np.array([[9.0, 10, 11], [3, 10, 11]]))
    bright, dimmed = (exact(s, "spherical_harmonics", points, 256).value for s in (scene, dark))
    np.testing.assert_allclose(bright, dimmed, rtol=1e-12)


def test_radiance_below_zero_is_compared_where_it_is_not_clamped() -> None:
    """Matter so dense that the linear law of ambient occlusion is negative wherever it is seen."""
    scene = synthetic_scene()
    grid = scene.medium.sigma_t
    dense = grid.with_values(grid.values * np.float32(100))
    scene = replace(scene, medium=Medium(dense, dense))
    volume = bake(scene, "ambient_occlusion", opacity="linear")
    with pytest.raises(InputError, match="all dark"):
        field_error(scene, volume, voxels=400, samples=2048)
    clean = field_error(scene, volume, voxels=400, samples=2048, clamped=False)
    term = volume.radiance[0]
    brighter = replace(term, weight=tuple(1.02 * each for each in term.weight))
    planted = field_error(
        scene, volume.with_radiance((brighter,)), voxels=400, samples=2048, clamped=False
    )
    assert clean.relative_rmse < 0.005
    # Below zero 2 % more is darker. The field's own error, below 0.5 %, adds in squares.
    assert planted.relative_rmse == pytest.approx(0.02, abs=4 * planted.noise + 6e-4)
    assert planted.bias == pytest.approx(-0.02, abs=4 * planted.bias_noise)


def test_one_truth_serves_every_setting_of_an_equation() -> None:
    scene = synthetic_scene()
    volume = bake(scene, "directional_occlusion", directions=16)
    truth = field_truth(scene, volume, voxels=200, samples=256)
    other = bake(scene, "directional_occlusion", directions=32)
    for each in (volume, other):
        found = field_error(scene, each, truth=truth)
        assert found == field_error(scene, each, voxels=200, samples=256)


@pytest.mark.parametrize("colours", [1, 3])
def test_a_planted_error_shows_in_each_coefficient(colours: int) -> None:
    scene = synthetic_scene()
    grid = scene.medium.sigma_t
    if colours == 3:
        grid = grid.with_values(grid.values[..., None] * np.array([0.5, 1.0, 2.0], np.float32))
        scene = replace(scene, medium=Medium(grid, grid))
    volume = bake(scene, "spherical_harmonics", directions=512, near=4)
    clean, _ = coefficient_errors(scene, volume, voxels=300, samples=4096)
    assert clean.relative_rmse < 0.01  # with 512 directions, on a smooth field
    planted = {
        name: channel.with_values(channel.values * np.float32(1.2), name)
        for name, channel in volume.channels.items()
    }
    wrong = replace(volume, channels=planted)
    together, each = coefficient_errors(scene, wrong, voxels=300, samples=4096)
    assert together.relative_rmse == pytest.approx(0.2, abs=0.01)
    assert len(each) == 16
    # Faint ones have larger errors of their own, which add up in squares.
    for figure in each:
        assert 0.15 < figure.relative_rmse < 0.35
