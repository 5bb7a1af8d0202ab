"""A composition takes part in a comparison like any model."""

import json
from pathlib import Path

import numpy as np
from comparisons import synthetic_scene
from fake_renderer import FakeRenderer

from volillum_addon.compare.measure import Options
from volillum_addon.compare.run import compare

PAIR = "sun=multidirectional_occlusion,sky=spherical_harmonics"
OPTIONS = Options(
    name="ball", samples=64, noise=0.01, seconds=600, repeats=1, points=4, directions=32,
    voxels=400, voxel_directions=512,
)  # fmt: skip


def test_it_is_judged_by_the_sum_of_its_parts_equations(tmp_path: Path) -> None:
    renderer = FakeRenderer(synthetic_scene(), 32, 24)
    found = compare(renderer, [PAIR], OPTIONS, tmp_path)
    ((result, measured),) = found.measured
    assert result.id == PAIR
    assert (tmp_path / result.file).is_file()
    # Its own numerical error is small (docs/accuracy.md: below 1 % on smooth media): judged by
    # another equation it would be tens of percent.
    assert measured.errors["numerical"].relative_rmse < 0.02
    assert measured.errors["numerical_field"].relative_rmse < 0.02
    errors = measured.images
    total = errors.display + errors.numerical + errors.model
    np.testing.assert_allclose(errors.total, total, atol=1e-12)
    report = json.loads((tmp_path / "report.json").read_text())
    assert [model["id"] for model in report["models"]] == [PAIR]
    # The fake knows no witness for spherical harmonics, and half a witness is none.
    assert measured.witness is None
