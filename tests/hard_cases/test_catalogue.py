"""The catalogue of hard scenes: every model keeps its laws in every one, or refuses in words."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from refusals import LIMITS

from volillum_addon.compare import hard_cases, hard_page
from volillum_addon.compare.hard_cases import PAGE, Cell, examine, variation
from volillum_addon.compare.hard_refined import refined_grid
from volillum_addon.compare.hard_scenes import FOLDER, HardCase, Lamp, Matter, catalogue, read
from volillum_addon.core.errors import InputError
from volillum_addon.core.grid import Grid
from volillum_addon.models.exact import Estimate
from volillum_addon.models.model import Model
from volillum_addon.models.registry import MODELS, models

CASES = catalogue()
MOST_REFUSED = 0.1


@pytest.fixture(scope="module")
def cells() -> dict[tuple[str, str], Cell]:
    """Cells as far as they were examined."""
    return {}


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.id)
def test_every_model_keeps_the_laws(case: HardCase, cells: dict[tuple[str, str], Cell]) -> None:
    found = [examine(case, model) for model in models()]
    cells.update({(cell.case, cell.model): cell for cell in found})
    assert [f"{cell.model}: {cell.reason}" for cell in found if cell.status == "broken"] == []
    for cell in found:
        if cell.status == "refused":
            assert any(limit in cell.reason for limit in LIMITS), cell.reason
            assert "\n" not in cell.reason


def test_few_are_refused(cells: dict[tuple[str, str], Cell]) -> None:
    if len(cells) == len(CASES) * len(MODELS):  # unless some of the above were left out
        refused = sum(cell.status == "refused" for cell in cells.values())
        assert refused <= MOST_REFUSED * len(cells)


def test_the_catalogue_covers_what_is_hard() -> None:
    """Each word of the ranges that the catalogue promises."""
    depths = [case.medium.depth for case in CASES]
    assert min(depths) < 1e-8 * 1.001
    assert max(depths) >= 1e6
    assert {case.medium.shape for case in CASES} >= {(1, 1, 1), (1, 1, 4096), (2, 3, 5)}
    assert {case.medium.g for case in CASES} >= {-0.99, 0.99}
    assert {case.medium.albedo for case in CASES} >= {0.0, 0.999999, 1.0}
    linear = [np.array(case.medium.axes) for case in CASES]
    assert min(np.linalg.det(axes) for axes in linear) < 0
    assert all(case.hard and case.holds for case in CASES)
    assert {pattern for case in CASES for pattern in [case.medium.pattern]} >= {
        "voxel", "checkerboard", "sinusoid", "shell", "step", "spikes",
    }  # fmt: skip


def test_a_file_that_is_not_as_expected_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "odd.json"
    file.write_text("{")
    with pytest.raises(InputError, match=r"odd\.json is not JSON"):
        read(file)
    entry = {"id": "a", "hard": "b", "holds": "c", "medium": {"depht": 1}}
    file.write_text(json.dumps({"cases": [entry]}))
    with pytest.raises(InputError, match="depht"):
        read(file)
    with pytest.raises(InputError, match="pattern is 'stripes'; expected one of"):
        Matter(pattern="stripes")
    with pytest.raises(InputError, match="light is 'lamp'; expected one of"):
        Lamp("lamp")


def test_presets_hold_no_code() -> None:
    assert {path.suffix for path in FOLDER.iterdir()} == {".json"}


def test_bounds_of_parameters_are_put_in() -> None:
    (case,) = [each for each in CASES if each.id == "theta_largest"]
    for model in models():
        for name, value in case.given(model).items():
            (parameter,) = [each for each in model.parameters if each.name == name]
            assert value == parameter.maximum


def test_a_refined_medium_is_the_same_field() -> None:
    """Trilinear in half cells as in whole ones, and as wide: integrals and values agree."""
    values = np.random.default_rng(0).random((3, 4, 2)).astype(np.float32)
    affine = np.array([[0.1, 0.02, 0, 1], [0, 0.2, 0.1, 2], [0, 0, 0.3, 3], [0, 0, 0, 1.0]])
    coarse = Grid(values, affine)
    fine = refined_grid(coarse)
    assert fine.shape == (7, 9, 5)
    assert np.allclose(fine.values[1::2, 1::2, 1::2], values)
    assert np.allclose(fine.to_world(np.ones(3)), coarse.to_world(np.zeros(3)))
    assert np.isclose(fine.values.sum() / 8, values.sum())
    assert np.allclose(fine.corners(), coarse.corners())


def faulty(model: Model, factor: float, unsteady: bool = False) -> Model:
    """The model with its channels off by a factor, and by another at each bake."""
    from dataclasses import replace

    turns = [0]

    def solve(scene, values, control):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
        turns[0] += 1
        wrong = factor + (1e-6 * turns[0] if unsteady else 0)
        return {
            name: grid.with_values(grid.values * np.float32(wrong), name)
            for name, grid in model.solve(scene, values, control).items()
        }

    return replace(model, solve=solve)


@pytest.mark.parametrize(
    ("id_", "factor", "unsteady", "law"),
    [
        ("touches_border", 1.02, False, "accurate"),
        ("depth_1e-8", 1.001, False, "within its bound"),
        ("light_along_z", -1.0, False, "not negative"),
        ("light_along_z", float("nan"), False, "NaN"),
        ("light_along_z", 1.0, True, "same for any threads"),
    ],
)
def test_a_planted_fault_is_found(
    id_: str, factor: float, unsteady: bool, law: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    (case,) = [each for each in CASES if each.id == id_]
    model = faulty(MODELS["multidirectional_occlusion"], factor, unsteady)
    monkeypatch.setitem(MODELS, model.id, model)
    cell = examine(case, model)
    assert cell.status == "broken"
    assert re.search(law, cell.reason), cell.reason


def test_means_over_voxels_may_differ_by_what_varies_within() -> None:
    """Of a linear solution that is a quarter of what it changes by from voxel to voxel; and a mean
    that is off by more than that and chance is found."""
    grid = Grid(np.ones((4, 4, 4), np.float32), np.diag([2.0, 1, 1, 1]))
    index = np.argwhere(grid.values > 0)
    slope = np.array([3.0, 0.0, 0.0])

    def judge(points: np.ndarray) -> Estimate:
        return Estimate(points * slope, np.zeros(points.shape))

    centres = judge(grid.to_world(index.astype(float))).value
    # 3 a unit, 2 units a voxel, on one of three axes of which the RMS is taken.
    assert variation(grid, index, centres, judge) == pytest.approx(3 * 2 / 4 / np.sqrt(3), rel=0.1)


def test_a_judge_that_takes_too_long_is_no_fault_of_the_model(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Light that is hardly absorbed scatters some ten thousand times in this cone."""
    monkeypatch.setattr(hard_cases, "PATIENCE", 3.0)
    case = HardCase("dense", "h", "h", Matter(depth=1e4, albedo=0.999999, pattern="uniform"))
    cell = examine(case, MODELS["half_angle"])
    assert cell.status == "kept", cell.reason
    assert "the judge is not done in 3 processor seconds" in cell.remark


def test_matter_may_have_colour_and_no_albedo() -> None:
    medium = Matter(shape=(2, 2, 2), albedo=0.0, colour=(0.0, 0.0, 0.5), glow=1.0).medium()
    assert medium.emission is not None
    assert np.allclose(medium.emission.values, medium.sigma_t.values)


def test_a_biased_mean_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    (case,) = [each for each in CASES if each.id == "mirrored"]
    model = faulty(MODELS["photon_mapping"], 1.2)
    monkeypatch.setitem(MODELS, model.id, model)
    assert "accurate" in examine(case, model, PAGE).reason


def test_pages_show_what_was_found() -> None:
    case, chosen = CASES[0], list(models())[:3]
    made = [
        Cell(case.id, chosen[0].id, "kept", 0.1, error=0.01, bound=0.02),
        Cell(case.id, chosen[1].id, "refused", 0.1, "knows only suns"),
        Cell(case.id, chosen[2].id, "broken", 0.1, "finite: 3 voxels are not"),
    ]
    for page in (
        hard_page.as_text([case], chosen, made),
        hard_page.as_markdown([case], chosen, made, "hard_cases.svg"),
        hard_page.as_picture([case], chosen, made),
        json.dumps(hard_page.as_json([case], chosen, made)),
    ):
        assert case.id in page
        assert "knows only suns" in page
        assert "3 voxels are not" in page
    assert "3 cells: 1 keep all laws, 1 are refused, 1 break one" in hard_page.counts(made) + " "
