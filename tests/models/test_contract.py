"""The laws that every model keeps, whatever its equation: tested over all of MODELS.

Deterministic models keep them to rounding or to the order of their discretisation; a stochastic
one, whose volume has a channel `standard_error`, within that.
"""

from __future__ import annotations

import math
import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from expected_skips import skip
from media import half_space, smooth_random
from numpy.typing import NDArray

from volillum_addon.compare.errors import field_error
from volillum_addon.core import harmonics
from volillum_addon.core.camera import Camera
from volillum_addon.core.errors import InputError
from volillum_addon.core.grid import Grid
from volillum_addon.core.lights import DistantLight, EnvironmentLight, Light
from volillum_addon.core.medium import Medium
from volillum_addon.core.scene import Scene
from volillum_addon.models.exact import exact
from volillum_addon.models.illuminate import illuminate, relight
from volillum_addon.models.model import Model, Values
from volillum_addon.models.registry import models
from volillum_addon.models.volume import IlluminationVolume

every_model = pytest.mark.parametrize("model", models(), ids=lambda model: model.id)

SUN = DistantLight((0.3, -0.5, 0.8), (2.0, 1.5, 1.0), 0.1)
SKY = EnvironmentLight((0.2, 0.3, 0.5))
LIGHTS = (SUN, SKY)
CENTRE = np.array([0.5, 0.5, 0.5])
CAMERA = Camera((2.5, -6.5, 3.5), CENTRE)
# float32 sums of a few hundred terms.
ROUNDING = 2e-5
SMOOTH = smooth_random((20, 18, 22), 5, depth=3.0)
# A scattering medium: albedo 0.8.
MEDIUM = replace(
    SMOOTH, sigma_s=SMOOTH.sigma_t.with_values(SMOOTH.sigma_t.values * np.float32(0.8))
)


def solved(
    model: Model,
    medium: Medium = MEDIUM,
    lights: tuple[Light, ...] = LIGHTS,
    camera: Camera = CAMERA,
    given: Values | None = None,
) -> IlluminationVolume:
    return illuminate(Scene(medium, lights, camera), model.id, given)


def values(volume: IlluminationVolume) -> NDArray[np.float64]:
    return volume.in_scattered().values.astype(np.float64)


def noise(volume: IlluminationVolume) -> NDArray[np.float64] | float:
    """Standard error of the in-scattered radiance, [i, j, k, 3]; 0 for a deterministic model."""
    if "standard_error" not in volume.channels:
        return 0.0
    error = volume.channels["standard_error"].values.astype(np.float64)
    return error if error.ndim == 4 else error[..., None]


def agree(
    first: IlluminationVolume,
    second: IlluminationVolume,
    tolerance: float,
    view: NDArray[np.float64] | None = None,
) -> None:
    """Both are one field: RMS difference below `tolerance` of its RMS beyond their noise.

    `view` takes the place of the second's values (where they are stored in another order).
    """
    a, b = values(first), values(second) if view is None else view
    # Apart: the second's may be stored in another order.
    sigma2 = np.mean(np.square(noise(first))) + np.mean(np.square(noise(second)))
    # Deviations of the mean square of noise from its expectation are far below it: voxels are many.
    assert np.mean((a - b) ** 2) <= (tolerance**2) * np.mean(a**2) + 2 * sigma2


def unoccluded(model: Model, lights: tuple[Light, ...] = LIGHTS) -> NDArray[np.float64]:
    """Sum of F / (4 pi) over the lights that the model represents."""
    scene = Scene(MEDIUM, lights, CAMERA)
    return np.sum([light.fluence(CENTRE) for light in model.represented(scene)], axis=0) / (
        4 * math.pi
    )


@every_model
def test_in_a_vacuum_every_light_arrives_in_full(model: Model) -> None:
    """Optical depth below 1e-6: L_i = sum of F / (4 pi) at every voxel, whatever the model."""
    thin = Medium.from_density(MEDIUM.sigma_t, 1e-6 / 3, 0.8)
    # A finite sun is cut to the bands of a truncated expansion, but in a vacuum only band 0 counts;
    # directions' quadrature of the other bands leaves 1e-3 with few directions.
    found = values(solved(model, thin))
    assert np.allclose(found, unoccluded(model), rtol=1e-3)


@every_model
def test_radiance_stays_within_its_bounds(model: Model) -> None:
    """Finite, not negative, and no brighter than the lights allow."""
    operator = model.operator(model.values({}))
    for strength in (1.0, 30.0):
        medium = Medium.from_density(MEDIUM.sigma_t, strength, 0.8)
        volume = solved(model, medium)
        found = values(volume)
        assert np.all(np.isfinite(found))
        assert np.all(found >= 0)
        most = unoccluded(model)
        if operator.basis is not None:
            # |V_n(omega_L)| <= sum of w_l (2 l + 1), as 0 <= V <= 1 and |P_l| <= 1.
            order, window = operator.basis
            weights = harmonics.window(window, order)
            most = most * float(np.sum(weights[: harmonics.count(order)]))
        elif operator.rescatter == "phase":
            continue  # scattered light may add up: its own bound is the next test's
        assert (found / most).max() <= 1 + ROUNDING


@every_model
def test_under_an_even_sky_nothing_is_brighter_than_the_sky(model: Model) -> None:
    """The maximum principle: albedo <= 1, no emission, one radiance all around."""
    if "environment" not in model.lights:
        with pytest.raises(InputError, match="knows only lights of the kinds"):
            solved(model, lights=(SKY,))
        return
    volume = solved(model, lights=(SKY,))
    found, sigma = values(volume), np.asarray(noise(volume))
    # 5 standard errors: one in 3 million voxels by chance.
    assert np.all(found <= np.array([0.2, 0.3, 0.5]) * (1 + ROUNDING) + 5 * sigma)


@every_model
def test_an_odd_grid_has_finite_light(model: Model) -> None:
    for shape in ((1, 1, 1), (1, 1, 40), (2, 3, 5), (7, 1, 6)):
        grid = Grid(np.full(shape, 2.0, np.float32), np.diag([0.1, 0.1, 0.1, 1.0]), "odd")
        found = values(solved(model, Medium.from_density(grid, 1.0, 0.9)))
        assert np.all(np.isfinite(found))
        assert found.min() >= 0
        assert found.max() > 0


@every_model
def test_an_empty_medium_is_refused_in_plain_words(model: Model) -> None:
    empty = Grid(np.zeros((3, 4, 5), np.float32), np.eye(4), "density")
    with pytest.raises(InputError, match="density holds only zeros; expected some voxel"):
        solved(model, Medium(empty, empty))


@every_model
@pytest.mark.parametrize(
    ("axes", "flips"),
    [((1, 2, 0), (False, False, False)), ((2, 1, 0), (True, True, False))],
    ids=["turned", "mirrored lattice"],
)
def test_one_world_stored_in_another_order_has_the_same_light(
    model: Model, axes: tuple[int, int, int], flips: tuple[bool, bool, bool]
) -> None:
    """Index axes permuted and flipped, the world unchanged: an axis taken for another would show.

    Directions and field are the same. Only the nodes between which the weights of a cone that turns
    from voxel to voxel are interpolated lie elsewhere: 0.03 % (docs/mathematics.md), squares added.
    """
    grids = (reordered(MEDIUM.sigma_t, axes, flips), reordered(MEDIUM.sigma_s, axes, flips))
    other = solved(model, Medium(*grids))
    flipped = [axis for axis in range(3) if flips[axis]]
    back = np.transpose(np.flip(values(other), flipped), (*np.argsort(axes), 3))
    agree(solved(model), other, 1e-3, back)


def reordered(grid: Grid, axes: tuple[int, int, int], flips: tuple[bool, bool, bool]) -> Grid:
    """The same field in the world with index axis a the former axes[a], reversed where flips[a]."""
    affine = grid.index_to_world.copy()
    for axis in range(3):
        column = grid.index_to_world[:3, axes[axis]]
        affine[:3, axis] = -column if flips[axis] else column
        if flips[axis]:
            affine[:3, 3] += column * (grid.shape[axes[axis]] - 1)
    stored = np.flip(np.transpose(grid.values, axes), [a for a in range(3) if flips[a]])
    return Grid(np.ascontiguousarray(stored), affine, grid.name)


TURN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
MIRROR = np.diag([-1.0, 1.0, 1.0])


@every_model
@pytest.mark.parametrize("matrix", [TURN, MIRROR, TURN @ MIRROR], ids=["turn", "mirror", "both"])
def test_a_turned_or_mirrored_world_has_turned_or_mirrored_light(
    model: Model, matrix: NDArray[np.float64]
) -> None:
    """Medium, lights and camera mapped by an orthogonal matrix; the medium stored alike.

    Rules of directions are not turned with the world, so the two differ by what their quadrature
    errs on this smooth medium: below 1 % at default settings (docs/accuracy.md).
    """
    transform = np.eye(4)
    transform[:3, :3] = matrix
    medium = Medium(
        *(replace(grid, index_to_world=transform @ grid.index_to_world)
          for grid in (MEDIUM.sigma_t, MEDIUM.sigma_s))
    )  # fmt: skip
    sun = replace(SUN, direction=matrix @ SUN.direction)
    camera = Camera(matrix @ np.asarray(CAMERA.position), matrix @ CENTRE)
    agree(solved(model), solved(model, medium, (sun, SKY), camera), 1e-2)


@every_model
def test_the_unit_of_length_does_not_matter(model: Model) -> None:
    """Lengths in a unit 1024 times smaller (a power of 2: no rounding of its own)."""
    unit = 1024.0
    scale = np.diag([unit, unit, unit, 1.0])
    medium = Medium(
        *(Grid(grid.values / np.float32(unit), scale @ grid.index_to_world, grid.name)
          for grid in (MEDIUM.sigma_t, MEDIUM.sigma_s))
    )  # fmt: skip
    camera = Camera(unit * np.asarray(CAMERA.position), unit * CENTRE)
    agree(solved(model), solved(model, medium, camera=camera), ROUNDING)


@every_model
def test_place_in_the_world_does_not_matter(model: Model) -> None:
    shift = np.array([3.0, -2.0, 0.7])
    moved = np.eye(4)
    moved[:3, 3] = shift
    medium = Medium(
        *(replace(grid, index_to_world=moved @ grid.index_to_world)
          for grid in (MEDIUM.sigma_t, MEDIUM.sigma_s))
    )  # fmt: skip
    camera = Camera(np.asarray(CAMERA.position) + shift, CENTRE + shift)
    agree(solved(model), solved(model, medium, camera=camera), 1e-4)


@every_model
def test_brighter_lights_need_no_new_bake(model: Model) -> None:
    """Twice the light is twice the radiance, and the baked channels serve both."""
    double = (replace(SUN, irradiance=2 * np.asarray(SUN.irradiance)),
              EnvironmentLight(2 * np.asarray(SKY.radiance)))  # fmt: skip
    volume = solved(model)
    agree(solved(model, lights=double).with_radiance(volume.radiance), volume, ROUNDING)
    if "light" not in model.rebake_on:
        relit = values(relight(volume, double))
        assert np.allclose(relit, 2 * values(volume), rtol=1e-6)


@every_model
def test_lights_add_up(model: Model) -> None:
    """Sun and sky, or two suns where a model has no sky; before what is below 0 counts as 0."""
    other = SKY if "environment" in model.lights else DistantLight((-0.6, 0.2, 0.5), 1.0)

    first, second, both = (solved(model, lights=some) for some in ((SUN,), (other,), (SUN, other)))
    parts, whole = (
        sum(each.in_scattered(clamped=False).values.astype(np.float64) for each in volumes)
        for volumes in ((first, second), (both,))
    )
    sigma2 = np.mean([np.mean(np.square(noise(each))) for each in (first, second, both)])
    # Three independent bakes: their variances add; twice that is beyond chance here.
    assert np.mean((parts - whole) ** 2) <= ROUNDING**2 * np.mean(whole**2) + 6 * sigma2


@every_model
def test_the_order_of_convergence_is_two(model: Model) -> None:
    """A smooth blob at 9, 17 and 33 voxels an edge: halving the voxel quarters the difference."""
    fields = []
    given: Values | None = None
    for half in (8, 16, 32):
        axis = np.linspace(-1, 1, half + 1)
        squares = axis[:, None, None] ** 2 + 1.3 * axis[:, None] ** 2 + 0.8 * axis**2
        density = np.exp(-6 * squares).astype(np.float32) * np.float32(2)
        affine = np.diag([2 / half] * 3 + [1.0])
        affine[:3, 3] = -1
        grid = Grid(density, affine, "blob")
        medium, camera = Medium.from_density(grid, 1.0, 0.8), Camera((0.5, -9.0, 3.0), (0, 0, 0))
        # Lengths that follow the grid by default stay those of the first one: one equation.
        given = given or model.resolved(Scene(medium, LIGHTS, camera), model.values({}))
        volume = solved(model, medium, camera=camera, given=given)
        if isinstance(noise(volume), np.ndarray):
            return  # its error is noise: the z-tests of its own file judge it
        step = half // 8
        offset = np.rint(volume.medium.sigma_t.to_index(np.array([-1.0, -1, -1]))).astype(int)
        inner = tuple(slice(o, o + half + 1, step) for o in offset)
        fields.append(values(volume)[inner])
    coarse = np.sqrt(np.mean((fields[1] - fields[0]) ** 2))
    fine = np.sqrt(np.mean((fields[2] - fields[1]) ** 2))
    # 4 for a second order; between orders 1.6 and 2 the coarse grids are not yet asymptotic.
    assert coarse / fine > 3.0


@every_model
def test_a_uniform_slab_has_the_light_of_its_own_equation(model: Model) -> None:
    medium, point = half_space(1.0, slices=12, below=3.0)
    lights = (DistantLight((0.0, 0.0, 1.0), 4 * math.pi), EnvironmentLight(0.3))
    above = Camera(point + np.array([0, 0, 50.0]), point, (0, 1, 0), orthographic=True)
    scene = Scene(medium, lights, above)
    volume = illuminate(scene, model.id)
    index = tuple(np.rint(volume.medium.sigma_t.to_index(point)).astype(int))
    truth = exact(scene, model.id, point[None], samples=65536)
    sigma = np.asarray(noise(volume))
    own = sigma[index] if sigma.ndim else 0.0
    # The rules of directions err by less than 1 % at default settings on analytic integrands.
    tolerance = 1e-2 * truth.value[0] + 4 * np.hypot(truth.standard_error[0], own)
    assert np.all(np.abs(values(volume)[index] - truth.value[0]) <= tolerance)


@every_model
def test_the_field_is_the_solution_of_its_own_equation(model: Model) -> None:
    """Against the judge at camera-visible voxels of the smooth random medium."""
    scene = Scene(MEDIUM, LIGHTS, CAMERA)
    volume = solved(model)
    figure = field_error(scene, volume, voxels=300, samples=1024)
    sigma, scale = np.asarray(noise(volume)), np.mean(values(volume) ** 2)
    allowed = math.sqrt(1e-2**2 + float(np.mean(sigma**2)) / scale)
    assert figure.relative_rmse <= allowed + 3 * figure.noise


FINGERPRINTS = """
import hashlib, sys
sys.path[:0] = {path!r}
from models.test_contract import models, solved
for model in models():
    digest = hashlib.blake2b(digest_size=8)
    for name, grid in sorted(solved(model).channels.items()):
        digest.update(name.encode() + grid.values.tobytes())
    print(model.id, digest.hexdigest())
"""


def test_one_thread_and_all_threads_bake_the_same_bits() -> None:
    cores = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else [0]
    if len(cores) < 2:
        skip("two processors")
    prints = [
        subprocess.run(
            [sys.executable, "-c", f"import os; os.sched_setaffinity(0, {some})\n"
             + FINGERPRINTS.format(path=sys.path)],
            check=True, capture_output=True, text=True,
        ).stdout
        for some in (cores[:1], cores)
    ]  # fmt: skip
    assert prints[0] == prints[1]
    assert len(prints[0].splitlines()) == len(models())


@every_model
def test_a_first_look_is_a_setting_of_the_model(model: Model) -> None:
    assert model.values(model.first_look).keys() == {each.name for each in model.parameters}
    if model.ladder and model.quick is None:
        assert model.first_look == model.ladder[0]
