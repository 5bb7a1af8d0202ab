"""The radiance for a scene's lights as a file of its own."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bake.conftest import blob, volume

from volillum_addon.bake.radiance_file import radiance_file
from volillum_addon.bake.vdb import grid_names, read_metadata, read_vdb, write_vdb
from volillum_addon.core.errors import InputError
from volillum_addon.core.medium import Medium
from volillum_addon.models.angular import Moment
from volillum_addon.models.volume import Factor, IlluminationVolume, RadianceTerm


@pytest.fixture
def given() -> IlluminationVolume:
    whole = volume(Medium.from_density(blob(), 2.0, 0.9))
    return whole.with_radiance(
        (
            RadianceTerm((Factor("visibility"), Factor("colour", 1)), (0.1, 1 / 3, 2.0)),
            RadianceTerm((Factor("colour"),), (-0.5, 0.25, 0.0)),
            RadianceTerm((Factor("visibility"),), (1.0, 2.0, 3.0), Moment(3)),
        )
    )


def test_one_grid_for_each_dependence_on_the_view(
    given: IlluminationVolume, tmp_path: Path
) -> None:
    baked = tmp_path / "blob.model.0123.vdb"
    write_vdb(given, baked, {"hash": "0123"})
    path = radiance_file(given, baked, tmp_path)
    assert path.name.startswith("blob.model.0123.radiance.")
    assert sorted(grid_names(path)) == ["density", "volillum_radiance", "volillum_radiance_1"]
    read = read_vdb(path)
    assert [term.angular for term in read.radiance] == [None, Moment(3)]
    assert not given.as_radiance().in_scattered(view=(0, 0, 1)).values.min() < 0
    # Negative sums are kept for the clamp after interpolation.
    assert read.channels["radiance"].values.min() < 0
    inside = given.medium.sigma_t.values > 0
    for view in ((0, 0, 1), (1.0, 0.5, -2.0)):
        np.testing.assert_allclose(
            read.in_scattered(view=view).values[inside],
            given.in_scattered(view=view).values[inside],
            rtol=2e-6, atol=1e-6,
        )  # fmt: skip


def test_the_same_lights_find_it_and_others_are_another_file(
    given: IlluminationVolume, tmp_path: Path
) -> None:
    baked = tmp_path / "blob.model.0123_0007.vdb"
    write_vdb(given, baked, {"hash": "0123"})
    first = radiance_file(given, baked, tmp_path)
    assert first.name.endswith("_0007.vdb"), "Blender plays a sequence by the number at the end"
    written = first.stat().st_mtime_ns
    assert radiance_file(given, baked, tmp_path) == first
    assert first.stat().st_mtime_ns == written
    brighter = tuple(
        replace(term, weight=tuple(2 * w for w in term.weight)) for term in given.radiance
    )
    second = radiance_file(given.with_radiance(brighter), baked, tmp_path)
    assert second != first
    ratio = [read_vdb(path).channels["radiance"].values for path in (second, first)]
    np.testing.assert_allclose(ratio[0], 2 * ratio[1], rtol=1e-6)
    # One that is not whole is written again.
    first.write_bytes(first.read_bytes()[:-100])
    assert radiance_file(given, baked, tmp_path) == first
    assert read_metadata(first)["channels"] == ["radiance", "radiance_1"]
    # Another bake under the same name has another one.
    write_vdb(given, baked, {"hash": "4567"})
    assert radiance_file(given, baked, tmp_path) not in (first, second)


def test_a_file_that_is_no_bake_is_refused(given: IlluminationVolume, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"nowhere\.vdb"):
        radiance_file(given, tmp_path / "nowhere.vdb", tmp_path)
