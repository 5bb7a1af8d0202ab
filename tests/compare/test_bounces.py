"""The bounce limit against what a random walk really does."""

import numpy as np
import pytest

from volillum_addon.compare.bounces import FEWEST, MOST, TAIL, bounce_limit
from volillum_addon.core.grid import Grid
from volillum_addon.core.medium import Medium


def medium(thickness: float, albedo: float, g: float = 0.0) -> Medium:
    """A cube of the given optical thickness along its axes (16 voxels; the sum times the size)."""
    density = Grid(np.ones((16, 16, 16), np.float32), np.diag([0.5, 0.5, 0.5, 1.0]))
    made = Medium.from_density(density, thickness / 8, albedo)
    return Medium(made.sigma_t, made.sigma_s, g=g)


def walk(thickness: float, albedo: float, bounces: int, count: int = 20_000) -> float:
    """The share of a slab's scattered light that has scattered more than `bounces` times.

    The slab is wider than any cube of this thickness, so more light stays in it. Isotropic walk
    from points spread evenly, weight albedo at each scattering.
    """
    random = np.random.default_rng(3)
    depth = random.random(count) * thickness
    light = late = 0.0
    for order in range(4 * bounces):
        step = random.exponential(size=len(depth)) * random.uniform(-1, 1, len(depth))
        depth = depth + step
        depth = depth[(depth > 0) & (depth < thickness)]
        scattered = albedo ** (order + 1) * len(depth)
        light += scattered
        late += scattered if order >= bounces else 0.0
    return late / light


@pytest.mark.parametrize(
    ("thickness", "albedo"), [(2.0, 0.99), (8.0, 0.9), (8.0, 1.0), (20.0, 1.0)]
)
def test_little_light_is_left_beyond_the_limit(thickness: float, albedo: float) -> None:
    limit = bounce_limit(medium(thickness, albedo))
    # A share of TAIL is carried by 20 of the 20,000 walks: known to 22 %, two of which are allowed.
    assert walk(thickness, albedo, limit) < 1.44 * TAIL


def test_the_limit_grows_with_albedo_and_thickness_and_stays_in_its_range() -> None:
    by_albedo = [bounce_limit(medium(20, albedo)) for albedo in (0.1, 0.9, 0.99, 1.0)]
    by_thickness = [bounce_limit(medium(thickness, 1.0)) for thickness in (0.1, 5, 20, 500)]
    for limits in (by_albedo, by_thickness):
        assert limits == sorted(limits)
        assert limits[0] == FEWEST
        assert limits[-1] <= MOST
    assert by_thickness[-1] == MOST
    assert bounce_limit(medium(20, 1.0, g=0.9)) < bounce_limit(medium(20, 1.0))
    # 0.9^66 = 1e-3: without any escape 128 is the next power of two.
    assert bounce_limit(medium(1e4, 0.9)) == 128
