"""References: independent seeds until the noise is low enough, kept and added to."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from volillum_addon.compare.cache import key_of, load, store
from volillum_addon.compare.metrics import relative_noise
from volillum_addon.compare.reference import FEWEST_SEEDS, Stopping, Tally, gather
from volillum_addon.core.control import Cancelled, Control

SHAPE = (12, 16)
EVERYWHERE = np.ones(SHAPE, bool)
NOISE = 0.1  # of one seed


class Camera:
    """Draws noisy images of 1 and counts them."""

    def __init__(self) -> None:
        self.seeds: list[int] = []

    def draw(self, seed: int) -> NDArray[np.float32]:
        self.seeds.append(seed)
        random = np.random.default_rng(seed)
        return (1 + NOISE * random.standard_normal((*SHAPE, 3))).astype(np.float32)


def test_seeds_are_drawn_until_the_noise_is_reached(tmp_path: Path) -> None:
    camera = Camera()
    stopping = Stopping(noise=0.02, seconds=1e9)
    tally = gather(tmp_path / "a.npz", camera.draw, stopping, EVERYWHERE, Control())
    # 0.1 / sqrt(25) = 0.02; the level is known to 1 / sqrt(2 * 24 * 576) = 0.6 %, so 25 +- 1.
    assert abs(tally.seeds - 25) <= 1
    assert camera.seeds == list(range(1, tally.seeds + 1))
    assert relative_noise(tally.image(), EVERYWHERE) <= 0.02
    images = np.array([camera.draw(seed) for seed in range(1, tally.seeds + 1)], np.float64)
    np.testing.assert_allclose(tally.image().value, images.mean(axis=0), rtol=1e-12)
    np.testing.assert_allclose(
        tally.image().variance, images.var(axis=0, ddof=1) / tally.seeds, rtol=1e-9
    )


def test_what_is_stored_is_found_and_added_to(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    first = gather(path, Camera().draw, Stopping(0.04, 1e9), EVERYWHERE, Control())
    camera = Camera()
    again = gather(path, camera.draw, Stopping(0.04, 1e9), EVERYWHERE, Control())
    assert camera.seeds == []
    np.testing.assert_array_equal(again.mean, first.mean)
    more = gather(path, camera.draw, Stopping(0.02, 1e9), EVERYWHERE, Control())
    assert camera.seeds[0] == first.seeds + 1
    whole = gather(tmp_path / "b.npz", Camera().draw, Stopping(0.02, 1e9), EVERYWHERE, Control())
    np.testing.assert_array_equal(more.mean, whole.mean)
    np.testing.assert_array_equal(more.squares, whole.squares)


def test_a_spent_budget_still_gives_a_standard_error(tmp_path: Path) -> None:
    camera = Camera()
    tally = gather(tmp_path / "a.npz", camera.draw, Stopping(1e-9, 0.0001), EVERYWHERE, Control())
    assert tally.seeds == FEWEST_SEEDS
    assert np.all(tally.image().variance > 0)


def test_a_cancelled_run_goes_on_where_it_was(tmp_path: Path) -> None:
    path, camera, control = tmp_path / "a.npz", Camera(), Control()

    def draw(seed: int) -> NDArray[np.float32]:
        if seed == 7:
            control.cancel()
        return camera.draw(seed)

    with pytest.raises(Cancelled):
        gather(path, draw, Stopping(0.02, 1e9), EVERYWHERE, control)
    assert camera.seeds == [1, 2, 3, 4, 5, 6, 7]
    gather(path, camera.draw, Stopping(0.02, 1e9), EVERYWHERE, Control())
    assert camera.seeds == list(range(1, len(camera.seeds) + 1))


def test_a_damaged_part_is_drawn_again(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    gather(path, Camera().draw, Stopping(0.05, 1e9), EVERYWHERE, Control())
    path.write_bytes(path.read_bytes()[:200])
    assert load(path) is None
    camera = Camera()
    gather(path, camera.draw, Stopping(0.05, 1e9), EVERYWHERE, Control())
    assert camera.seeds[0] == 1


def test_the_share_that_is_done_only_grows(tmp_path: Path) -> None:
    shares: list[float] = []
    stopping = Stopping(noise=0.01, seconds=1e9)
    gather(tmp_path / "a.npz", Camera().draw, stopping, EVERYWHERE, Control(),
           lambda share, _: shares.append(share))  # fmt: skip
    assert shares == sorted(shares)
    assert shares[0] == 0
    # Near the end the share is the part of the seeds: 1 / 100 each.
    assert shares[-1] == pytest.approx(1, abs=0.03)


def test_one_seed_has_no_standard_error() -> None:
    empty = np.zeros((*SHAPE, 3))
    with pytest.raises(ValueError, match="at least 2"):
        Tally(empty, empty).add(empty, 0.1).image()


def test_keys_differ_where_inputs_do(tmp_path: Path) -> None:
    array = np.arange(4.0)
    base = {"a": 1, "b": [1, 2], "c": array}
    assert key_of(base) == key_of({"c": array.copy(), "b": [1, 2], "a": 1})
    changes: list[dict[str, object]] = [{"a": 2}, {"b": [2, 1]}]
    changes += [{"c": other} for other in (array + 1e-12, array[None], array.astype(np.float32))]
    assert len({key_of(base | change) for change in [{}, *changes]}) == 6
    with pytest.raises(TypeError, match="object cannot be hashed"):
        key_of({"a": object()})
    store(tmp_path / "deep" / "part.npz", value=array)
    held = load(tmp_path / "deep" / "part.npz")
    assert held is not None
    np.testing.assert_array_equal(held["value"], array)
    assert [path.name for path in (tmp_path / "deep").iterdir()] == ["part.npz"]
