"""What is written: report.json by its schema, tables, pictures, OpenEXR files."""

import csv
import html
import io
import json
import math
from dataclasses import replace
from pathlib import Path

import jsonschema
import numpy as np
import OpenEXR
import pytest
from comparisons import synthetic_comparison
from matplotlib.image import imread

from volillum_addon.compare import images, page, paper, report, table
from volillum_addon.compare.figures import summary
from volillum_addon.compare.metrics import Figure
from volillum_addon.compare.results import Comparison
from volillum_addon.core.colour import LUMINANCE
from volillum_addon.models.registry import MODELS


@pytest.fixture(scope="module")
def comparison() -> Comparison:
    return synthetic_comparison()


def test_the_report_obeys_its_schema(comparison: Comparison, tmp_path: Path) -> None:
    schema = json.loads(report.SCHEMA.read_text())
    jsonschema.Draft202012Validator.check_schema(schema)
    path = tmp_path / "report.json"
    report.write(comparison, path)
    data = json.loads(path.read_text())
    jsonschema.Draft202012Validator(schema).validate(data)
    assert [entry["id"] for entry in data["models"]][: len(MODELS)] == list(MODELS)
    first = data["models"][0]
    images_of = comparison.measured[0][1].images
    total = images_of.total[comparison.mask].sum()
    truth = images_of.full.value[comparison.mask].sum()
    assert first["errors"]["total"]["bias"] == pytest.approx(total / truth, rel=1e-12)
    times = first["seconds"]
    assert times["total"] == pytest.approx(
        times["bake"]["median"] + times["hand_over"]["median"] + times["display"]["median"]
    )


def test_savings_stand_in_the_report_and_on_the_page(comparison: Comparison) -> None:
    second = report.as_json(comparison)["models"][2]
    assert second["savings"] == [
        {"lacks": "a <glow>", "seconds_ratio": 1.5, "stored_ratio": 2.0},
        {"lacks": "matter in 75 % of the grid", "seconds_ratio": 4.0, "stored_ratio": 4.0},
    ]
    words = page.page(comparison)
    assert "a &lt;glow&gt;" in words
    # 0.45 s of the bake, times 1.5 and 4.
    assert "≈ 2.70" in words


def test_a_model_that_cannot_serve_has_its_reason_and_nulls(comparison: Comparison) -> None:
    entry = report.as_json(comparison)["models"][-1]
    assert entry["reason"] == "needs a distant light; the scene has none"
    assert entry["seconds"] is None
    assert set(entry["errors"]) == set(report.ERRORS)
    assert not any(entry["errors"].values())


def test_an_infinite_parameter_is_a_word(comparison: Comparison) -> None:
    entries = report.as_json(comparison)["models"]
    infinite = [entry["parameters"].get("radius") for entry in entries]
    assert "inf" in infinite


def test_the_schema_refuses_what_it_should(comparison: Comparison) -> None:
    validator = jsonschema.Draft202012Validator(json.loads(report.SCHEMA.read_text()))
    for path, value in [
        (("models", 0, "errors", "total", "relative_rmse"), -0.1),
        (("models", 0, "seconds", "bake"), 0.5),
        (("references", "full", "seeds"), 1),
        (("schema",), 2),
    ]:
        data = report.as_json(comparison)
        place = data
        for key in path[:-1]:
            place = place[key]
        place[path[-1]] = value
        assert not validator.is_valid(data), path


@pytest.mark.parametrize(
    ("value", "noise", "text"),
    [
        (12.3456, 0.21, "12.3 ± 0.2"),
        (12.3456, 0.12, "12.35 ± 0.12"),
        (0.0123, 0.0004, "0.0123 ± 0.0004"),
        (153.2, 31.0, "153 ± 31"),
        (1.5, 0.0, "1.5"),
    ],
)
def test_values_have_the_digits_of_their_noise(value: float, noise: float, text: str) -> None:
    assert table.with_noise(value, noise) == text


def test_figures_below_their_noise_are_bounds() -> None:
    bound = Figure(0.00312, 0.00312, 0.0001, 0.0002, is_bound=True)
    assert table.percent(bound) == "< 0.31"
    assert table.percent(Figure(0.123456, 0.0021, 0, 0, is_bound=False)) == "12.3 ± 0.2"
    assert table.bias_percent(bound) == "+0.01 ± 0.02"


def test_times_in_words() -> None:
    assert [table.seconds(value) for value in (0.1234, 12.34, 119.6, 200.0, 179.7)] == [
        "0.123 s", "12.3 s", "120 s", "3 min 20 s", "3 min 0 s",
    ]  # fmt: skip


def test_the_table_has_every_model_and_the_references(comparison: Comparison) -> None:
    text = table.text(comparison)
    for model, found in comparison.measured:
        row = next(line for line in text.splitlines() if line.startswith(model.label + " "))
        assert table.percent(found.errors["total"]) in row
    assert "64 bounces, 16 x 64 samples" in text
    assert "needs a distant light" in text
    assert len({len(line) for line in text.splitlines()[1:2]}) == 1


def test_an_openexr_file_holds_the_layers(comparison: Comparison, tmp_path: Path) -> None:
    found = comparison.measured[0][1]
    images.write_exr(found.images, tmp_path / "model.exr")
    with OpenEXR.File(str(tmp_path / "model.exr")) as file:
        parts = {part.name(): part.channels["RGB"].pixels.copy() for part in file.parts}
    assert list(parts) == list(images.layers(found.images))
    for name, layer in images.layers(found.images).items():
        assert parts[name].dtype == np.float32
        np.testing.assert_array_equal(parts[name], layer.astype(np.float32))
    # float32 layers of order 1: the sum of three is right to a few 1e-7.
    three = parts["error_display"] + parts["error_numerical"] + parts["error_model"]
    np.testing.assert_allclose(three, parts["error"], atol=1e-6)
    np.testing.assert_allclose(parts["model"] - parts["reference"], parts["error"], atol=1e-6)


def test_tone_mapping_is_the_srgb_curve_under_one_exposure(comparison: Comparison) -> None:
    tone = images.Tone.of(comparison)
    grey = np.array([[[0.0] * 3, [0.5] * 3, [0.9] * 3, [7.0] * 3]]) / tone.exposure
    # IEC 61966-2-1: 0.5 is 187.5, 0.9 is 243.4.
    assert tone.picture(grey)[0, :, 0].tolist() == [0, 188, 243, 255]
    luminance = (comparison.full.image.value @ LUMINANCE)[comparison.mask]
    assert np.mean(luminance * tone.exposure > 0.9) == pytest.approx(0.01, abs=0.005)


def test_error_colours_are_signed_symmetric_and_black_at_zero(comparison: Comparison) -> None:
    tone = images.Tone.of(comparison)
    size = tone.limit * tone.mean
    pixels = tone.error_picture(np.array([[[-size] * 3, [0.0] * 3, [size] * 3, [9 * size] * 3]]))
    low, zero, high, beyond = pixels[0].astype(float)
    assert zero.max() <= 4
    assert low[2] > low[0]
    assert high[0] > high[2]
    np.testing.assert_array_equal(high, beyond)
    bar = images.colour_bar()[0].astype(float) @ LUMINANCE
    np.testing.assert_allclose(bar, bar[::-1], atol=14)  # of 255: equally light on both sides


def test_the_error_scale_holds_nearly_all_errors(comparison: Comparison) -> None:
    tone = images.Tone.of(comparison)
    # One scale for all models: 2 % of all their pixels lie beyond it, however a single one does.
    errors = [
        np.abs(found.images.total @ LUMINANCE)[comparison.mask] / tone.mean
        for _, found in comparison.measured
    ]
    assert np.mean(np.concatenate(errors) > tone.limit) <= 0.02
    rounded = [images.round_up(value) for value in (0.1, 0.11, 0.21, 0.7, 9.1)]
    assert rounded == pytest.approx([0.1, 0.15, 0.25, 0.8, 10])


def test_a_png_holds_its_pixels() -> None:
    pixels = np.random.default_rng(1).integers(0, 256, (5, 7, 3), dtype=np.uint8)
    read = imread(io.BytesIO(images.png(pixels)), format="png")
    np.testing.assert_array_equal(np.rint(read[..., :3] * 255), pixels)


def test_the_contact_sheet_shows_every_model(comparison: Comparison, tmp_path: Path) -> None:
    images.write_contact_sheet(comparison, tmp_path / "sheet.png")
    height, width = imread(tmp_path / "sheet.png").shape[:2]
    assert width > 1000
    assert height > 200 * len(comparison.measured)
    assert [path.name for path in tmp_path.iterdir()] == ["sheet.png"]
    one = replace(comparison, models=comparison.models[:1])
    images.write_contact_sheet(one, tmp_path / "one.png")
    assert imread(tmp_path / "one.png").shape[0] < height


def test_no_figure_is_not_a_number(comparison: Comparison) -> None:
    def numbers(value: object) -> list[float]:
        if isinstance(value, dict):
            return [number for entry in value.values() for number in numbers(entry)]
        if isinstance(value, list):
            return [number for entry in value for number in numbers(entry)]
        return [value] if isinstance(value, float) else []

    assert all(math.isfinite(number) for number in numbers(report.as_json(comparison)))


def test_every_measured_way_is_a_row_of_the_paper_s_table(comparison: Comparison) -> None:
    rows = list(csv.DictReader(io.StringIO(paper.table(comparison))))
    data = report.as_json(comparison)
    found = summary(comparison)
    assert len(rows) == sum(len(one.points) for one in found.series)
    by_id = {f"{model['id']}.{model['variant']}": model for model in data["models"]}
    compared = [row for row in rows if row["series"] in by_id and row["flip"]]
    assert len(compared) == len(MODELS)  # rungs of a ladder have no FLIP
    for row in compared:
        model = by_id[row["series"]]
        assert float(row["total_relative_rmse"]) == model["errors"]["total"]["relative_rmse"]
        assert float(row["flip"]) == model["flip"]["mean"]
        assert float(row["seconds"]) == pytest.approx(model["seconds"]["total"])
    traced = [row for row in rows if row["series"] == "cycles_biased"]
    assert [row["settings"] for row in traced] == ["1 sample", "4 samples", "16 samples"]
    assert all(row["numerical_relative_rmse"] == "" for row in traced)


def test_the_page_the_data_and_the_table_say_the_same_seconds(comparison: Comparison) -> None:
    data, printed = report.as_json(comparison), html.unescape(page.page(comparison))
    for entry in data["time_to_error"]:
        for target in entry["targets"]:
            if target["seconds"] is not None and target["how"] == "measured":
                assert table.seconds(target["seconds"]) in printed
                assert table.seconds(target["seconds"]) in table.text(comparison)
    assert {target["how"] for entry in data["time_to_error"] for target in entry["targets"]} >= {
        "measured", "interpolated", "averaged", "model error",
    }  # fmt: skip
    for move in data["break_even"]:
        assert [entry["frames"] for entry in move["frames"]] == [1, 24, 240]
