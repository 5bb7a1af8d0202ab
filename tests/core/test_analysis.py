"""What a scene holds, against closed forms."""

import math
from dataclasses import replace

import numpy as np
import pytest
from media import ball, half_space

from volillum_addon.core.analysis import analysis
from volillum_addon.core.camera import Camera
from volillum_addon.core.coarse import block_means, coarsened, refined
from volillum_addon.core.grid import Grid
from volillum_addon.core.lights import DistantLight, EnvironmentLight, PointLight, SpotLight
from volillum_addon.core.medium import Medium
from volillum_addon.core.native import native
from volillum_addon.core.orders import lasting_orders
from volillum_addon.core.scene import Scene

SUN = DistantLight((0, 0, 1), 2.0, 0.5)
SKY = EnvironmentLight((0.1, 0.2, 0.3))


def slab(depth: float = 3.0, albedo: float = 0.8) -> Medium:
    """Wide and flat: rays along z have the optical depth `depth`."""
    size = 1e3
    grid = Grid(np.full((3, 3, 30), depth / 30, np.float32), np.diag([size, size, 1.0, 1.0]))
    return Medium.from_density(grid, 1.0, albedo)


def test_the_terms_of_a_plain_scene() -> None:
    camera = Camera((1000, 1000, 500), (1000, 1000, 0), (0, 1, 0), orthographic=True, height=10)
    found = analysis(Scene(slab(), (SUN, SKY), camera))
    assert (found.shape, found.matter) == ((3, 3, 30), 1.0)
    channels = (found.extinction_channels, found.scattering_channels, found.emission_channels)
    assert channels == (1, 1, 0)
    assert found.albedo == pytest.approx((0.8, 0.8), rel=1e-6)
    assert found.kinds == {"distant", "environment"}
    # Depths toward a sun above: even over the slab, up to the whole; the view goes through all.
    sun = found.lights[0].depths
    assert sun.largest == pytest.approx(3.0, rel=0.05)
    assert sun.median == pytest.approx(1.5, rel=0.1)
    assert found.view is not None
    assert found.view.median == pytest.approx(3.0, rel=1e-3)


def test_light_sizes_and_shares() -> None:
    found = analysis(Scene(slab(), (SUN, SKY)))
    assert found.view is None
    sun, sky = found.lights
    assert sun.solid_angle == pytest.approx(2 * math.pi * (1 - math.cos(0.25)))
    assert sky.solid_angle == pytest.approx(4 * math.pi)
    fluence = np.array([4 / (1 + math.cos(0.25))] * 3), np.array([0.1, 0.2, 0.3]) * 4 * math.pi
    assert sun.share == pytest.approx(fluence[0].sum() / (fluence[0].sum() + fluence[1].sum()))
    assert sun.share + sky.share == pytest.approx(1)
    assert sky.bands == pytest.approx((1, 0, 0, 0, 0), abs=1e-12)
    assert not sun.is_coloured
    assert sky.is_coloured


def test_bands_of_an_image_are_its_harmonics() -> None:
    """1 + z has the energies 4 pi and 4 pi / 3 in the bands 0 and 1."""
    rows, columns = 128, 256
    elevation = np.pi * (0.5 - (np.arange(rows) + 0.5) / rows)
    image = np.broadcast_to((1 + np.sin(elevation))[:, None, None], (rows, columns, 3))
    (sky,) = analysis(Scene(slab(), (EnvironmentLight(image),))).lights
    # Midpoints of rows of pi / 128: relative 1e-4.
    assert sky.bands == pytest.approx((0.75, 0.25, 0, 0, 0), abs=1e-3)


def test_a_lamp_inside_is_as_deep_as_the_matter_up_to_it() -> None:
    body = ball(12, 2.0)
    lamp = PointLight(body.sigma_t.centre, 1.0)
    (found,) = analysis(Scene(body, (lamp,))).lights
    # Points of a ball of optical radius 2: none deeper than its blurred surface.
    assert found.depths.largest < 2.1
    # Even in volume: the median radius is 2^(-1/3).
    assert found.depths.median == pytest.approx(2 * 0.5 ** (1 / 3), rel=0.05)


def test_dark_lights_are_not_there() -> None:
    """Nor is a spot that shines away from the medium."""
    away = SpotLight((0, 0, 1e4), (0, 0, 1), 1.0)
    dark = DistantLight((0, 0, 1), 0.0)
    found = analysis(Scene(slab(), (SUN, away, dark, EnvironmentLight(0.0))))
    assert found.kinds == {"distant"}
    assert len(found.lights) == 1
    assert found.of_kinds(frozenset({"environment"})).lights == ()


def test_colour_emission_and_anisotropy_are_seen() -> None:
    grid = slab().sigma_t
    coloured = Medium.from_density(grid, (1.0, 0.5, 0.2), 0.5)
    glowing = replace(coloured, emission=grid, g=0.6)
    found = analysis(Scene(glowing, (SUN,)))
    assert (found.extinction_channels, found.emission_channels, found.g) == (3, 1, 0.6)
    black = replace(coloured, emission=grid.with_values(np.zeros_like(grid.values)))
    assert analysis(Scene(black, (SUN,))).emission_channels == 0


def test_orders_end_where_light_is_absorbed_or_leaves() -> None:
    thin, thick = slab(0.1, 1.0), slab(50.0, 1.0)
    assert lasting_orders(thin, 0.01) < lasting_orders(thick, 0.01)
    # Half is absorbed each time: at most ln(100) / ln(2) orders.
    assert lasting_orders(slab(50.0, 0.5), 0.01) <= math.log(100) / math.log(2) + 1e-3
    assert lasting_orders(half_space(1.0)[0], 0.5) < math.inf


def test_coarser_grids_keep_the_optical_depth() -> None:
    values = np.random.default_rng(0).random((20, 13, 17), dtype=np.float32)
    affine = np.diag([0.3, 0.2, 0.5, 1.0])
    affine[:3, 3] = (1, 2, 3)
    grid = Grid(values, affine)
    coarse = block_means(grid, 4)
    assert coarse.shape == (5, 4, 5)
    # The integral is the same: blocks beyond the end are filled with zeros.
    assert coarse.values.sum() * 64 == pytest.approx(values.sum(), rel=1e-5)

    # Of even matter the middle stays, so nothing moves.
    even = Grid(np.ones((20, 12, 16), np.float32), affine)
    assert block_means(even, 4).centre == pytest.approx(even.centre)


def test_a_finer_grid_holds_the_same_medium() -> None:
    """Optical depths along random rays, to float32."""
    random = np.random.default_rng(4)
    affine = np.diag([0.3, 0.2, 0.5, 1.0])
    grid = Grid(random.random((5, 6, 4), dtype=np.float32), affine)
    coarse = Scene(Medium.from_density(grid), (SUN,))
    fine = refined(coarse)
    assert fine.medium.sigma_t.voxel_size == pytest.approx(grid.voxel_size / 2)
    points = grid.to_world(random.random((40, 3)) * 6 - 1)
    toward = random.normal(size=(40, 3))
    toward /= np.linalg.norm(toward, axis=-1, keepdims=True)
    depths = [
        native.exact_optical_depth(g.planes(), g.index_to_world, points, toward)
        for g in (grid, fine.medium.sigma_t)
    ]
    np.testing.assert_allclose(depths[1], depths[0], rtol=1e-5, atol=1e-6)


def test_a_scene_is_coarsened_to_about_so_many_voxels() -> None:
    body = ball(20, 2.0)
    scene = Scene(body, (SUN,))
    coarse = coarsened(scene, 4000)
    assert 500 < math.prod(coarse.medium.sigma_t.shape) <= 6000
    assert coarsened(scene, 10**6).medium.sigma_t.shape == scene.trimmed(0).medium.sigma_t.shape
