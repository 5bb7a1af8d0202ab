"""The whole comparison with a renderer whose truth is known."""

import json
from dataclasses import replace
from pathlib import Path

import jsonschema
import numpy as np
import OpenEXR
import pytest
from comparisons import synthetic_scene
from fake_renderer import NOISE, FakeRenderer

from volillum_addon.compare import report
from volillum_addon.compare.measure import Options
from volillum_addon.compare.results import Comparison
from volillum_addon.compare.run import Candidate, compare
from volillum_addon.core.control import Cancelled, Control
from volillum_addon.core.errors import InputError
from volillum_addon.core.lights import EnvironmentLight
from volillum_addon.core.scene import Scene
from volillum_addon.models.registry import get

OPTIONS = Options(
    name="ball", samples=64, noise=0.01, seconds=600, repeats=1, points=4, directions=16,
    voxels=400, voxel_directions=256,
)  # fmt: skip
MODELS = ["directional_occlusion", "multidirectional_occlusion", "spherical_harmonics"]
SIZE = (40, 30)


class Run:
    """A finished comparison with its renderer and directory."""

    def __init__(self, directory: Path) -> None:
        self.directory = directory
        self.renderer = FakeRenderer(synthetic_scene(), *SIZE)
        self.found: Comparison = compare(self.renderer, MODELS, OPTIONS, directory)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return Run(tmp_path_factory.mktemp("comparison"))


def test_the_report_obeys_its_schema_and_the_files_are_there(run: Run) -> None:
    data = json.loads((run.directory / "report.json").read_text())
    schema = json.loads(report.SCHEMA.read_text())
    jsonschema.Draft202012Validator(schema).validate(data)
    assert [entry["id"] for entry in data["models"]] == MODELS
    files = {path.name for path in run.directory.iterdir()}
    images = {entry["image"] for entry in data["models"]}
    expected = {"report.json", "report.html", "contact_sheet.png", "bakes", "parts", "paper.csv"}
    plots = {f"plot_{name}.svg" for name in ("error_time", "error_parts", "profile")}
    assert files == images | expected | plots


def test_path_tracing_has_the_error_of_its_noise(run: Run) -> None:
    """The fake renderer's noise is NOISE / sqrt(samples) of each value, unbiased twice that."""
    assert {entry.samples for entry in run.found.baselines} == {1, 4, 16, 64}
    for entry in run.found.baselines:
        if entry.way.denoised:
            assert (entry.measured, entry.reason) == (None, "this Cycles has no such way")
            continue
        found = entry.measured
        assert found is not None
        noise = NOISE * (1 if entry.way.biased else 2) / np.sqrt(entry.samples)
        # Three draws are few for a standard error: 4 of them are left by 6 % of Student's t.
        assert found.total.relative_rmse == pytest.approx(noise, abs=8 * found.total.noise)
        assert found.total.noise < 0.2 * noise
        assert found.seconds.median == 1 + 0.01 * entry.samples
        assert found.total_after_exposure.relative_rmse <= found.total.relative_rmse
        assert 0 < found.flip.value < 1


def test_a_model_s_ladder_is_measured_as_far_as_the_budget_reaches(tmp_path: Path) -> None:
    options = replace(OPTIONS, ladder=True, baselines=0, rung_seconds=1e9)
    model = "multidirectional_occlusion"
    found = compare(FakeRenderer(synthetic_scene(), 20, 16), [model], options, tmp_path)
    ladder = found.models[0].ladder
    assert not found.baselines
    given = found.models[0].parameters
    expected = [get(model).values(rung) for rung in get(model).ladder]
    assert ladder[0].settings == {"resolution": 0.5}
    assert [{**given, **rung.settings} for rung in ladder[1:]] == [
        v for v in expected if v != given
    ]
    measured = [rung.measured for rung in ladder if rung.measured is not None]
    assert len(measured) == len(ladder)
    # An eighth of the voxels, but of the same matter: the picture is nearly the same.
    coarse = measured.pop(0)
    assert 0.001 < coarse.errors["numerical"].relative_rmse < 0.1
    files = sorted(path.stat().st_size for path in (tmp_path / "bakes").iterdir())
    assert files[0] < files[1] / 2
    # One equation, so one exact image; the bakes come closer to the last one's.
    images = [each.images for each in measured]
    assert all(np.array_equal(each.exact.value, images[0].exact.value) for each in images)
    last = images[-1].integrated.value
    distances = [np.abs(each.integrated.value - last).mean() for each in images]
    assert distances == sorted(distances, reverse=True)
    assert distances[0] > 0
    hurried = replace(options, rung_seconds=1e-6)
    again = compare(FakeRenderer(synthetic_scene(), 20, 16), [model], hurried, tmp_path)
    reasons = [rung.reason for rung in again.models[0].ladder]
    assert reasons[0] is None
    assert all(reason and "the budget is" in reason for reason in reasons[1:])
    data = json.loads((tmp_path / "report.json").read_text())
    jsonschema.Draft202012Validator(json.loads(report.SCHEMA.read_text())).validate(data)
    assert [rung["reason"] for rung in data["models"][0]["ladder"]] == reasons


def test_references_are_the_truth_within_their_noise(run: Run) -> None:
    for reference in (run.found.single, run.found.full):
        assert reference.noise <= OPTIONS.noise
        assert reference.seeds >= 4
        error = (reference.image.value - run.renderer.truth(reference.bounces))[run.found.mask]
        deviation = np.sqrt(reference.image.variance[run.found.mask])
        # Student's t: its square has the mean n / (n - 2); colours are one, so a sample of the
        # silhouette's pixels; four standard errors of its mean (kurtosis below 9 from n = 10).
        degrees = reference.image.degrees
        squares = (error / deviation) ** 2
        assert degrees >= 10
        spread = 4 * np.sqrt(8 / len(squares)) * degrees / (degrees - 2)
        assert squares.mean() == pytest.approx(degrees / (degrees - 2), abs=spread)


def test_error_images_add_up_and_figures_follow(run: Run) -> None:
    truth = run.renderer.truth(run.found.full.bounces)
    for model, found in run.found.measured:
        images = found.images
        parts = images.display + images.numerical + images.model
        scale = np.abs(images.full.value).max()
        np.testing.assert_allclose(parts, images.total, atol=8 * np.finfo(float).eps * scale)
        # Against the noise-free truth, which the comparison does not know.
        mask = run.found.mask
        error = images.displayed.value[mask] - truth[mask]
        expected = np.sqrt(np.sum(error**2) / np.sum(truth[mask] ** 2))
        figure = found.errors["total"]
        assert abs(figure.relative_rmse - expected) < 4 * figure.noise, model.id
        bias = error.sum() / truth[mask].sum()
        assert abs(figure.bias - bias) < 4 * figure.bias_noise, model.id
        # The display is 1.001 times the integral, but for float32 and the silhouette's mask.
        assert found.errors["display"].relative_rmse == pytest.approx(1e-3, rel=1e-3)
        exposed = np.sum(images.displayed.value[mask] * truth[mask]) / np.sum(
            images.displayed.value[mask] ** 2
        )
        assert abs(found.exposure.factor - exposed) < 4 * found.exposure.noise, model.id


def test_the_numerical_errors_are_small_on_a_smooth_ball(run: Run) -> None:
    # Smooth and 64 or 128 directions: MODELS promise below 1 %, in the image and in the field.
    for model, found in run.found.measured:
        for kind in ("numerical", "numerical_field"):
            figure = found.errors[kind]
            assert figure.relative_rmse < 0.01 + 2 * figure.noise, (model.id, kind)
            assert abs(figure.bias) < 0.005 + 4 * figure.bias_noise, (model.id, kind)


def test_only_the_model_with_a_witness_has_one_and_it_agrees(run: Run) -> None:
    witnesses = {model.id: found.witness for model, found in run.found.measured}
    assert witnesses.pop("multidirectional_occlusion") is not None
    assert not any(witnesses.values())
    found = next(f for m, f in run.found.measured if m.id == "multidirectional_occlusion").witness
    assert found is not None
    assert found.agrees, found


def test_the_bounce_limit_is_checked(run: Run) -> None:
    late, bounces = run.found.truncation, run.found.full.bounces
    assert late.half == bounces // 2
    truth = run.renderer.truth
    expected = 1 - truth(late.half).sum() / truth(bounces).sum()
    # Equal seeds have equal noise here, so the gain is right but for float32.
    assert late.gain == pytest.approx(expected, rel=1e-3)


def test_times_are_positive_and_of_a_cold_process(run: Run) -> None:
    for _, found in run.found.measured:
        taken = found.seconds
        assert 0 < taken.bake.median < taken.whole.median
        assert 0 < taken.hand_over.median < taken.whole.median
        assert taken.total < taken.whole.median + taken.display.median
        # An interpreter with numpy alone is above 20 MB.
        assert found.peak_bytes > 20e6


def test_a_second_run_finds_everything(run: Run) -> None:
    renderer = FakeRenderer(synthetic_scene(), *SIZE)
    before = (run.directory / "report.json").read_text()
    again = compare(renderer, MODELS, OPTIONS, run.directory)
    assert not renderer.calls
    assert (run.directory / "report.json").read_text() == before
    for (_, one), (_, other) in zip(run.found.measured, again.measured, strict=True):
        np.testing.assert_array_equal(one.images.total, other.images.total)


def test_less_noise_adds_seeds_and_keeps_the_rest(run: Run, tmp_path: Path) -> None:
    directory = tmp_path / "copy"
    directory.mkdir()
    for folder in ("parts", "bakes"):
        (directory / folder).symlink_to(run.directory / folder)
    renderer = FakeRenderer(synthetic_scene(), *SIZE)
    options = Options(**{**vars(OPTIONS), "noise": 0.008})
    found = compare(renderer, MODELS[:1], options, directory)
    assert set(renderer.calls) == {"reference"}
    assert renderer.calls["reference"] == (
        found.full.seeds - run.found.full.seeds + found.single.seeds - run.found.single.seeds
    )


def test_openexr_layers_are_the_comparison(run: Run) -> None:
    for model, found in run.found.measured:
        with OpenEXR.File(str(run.directory / model.file)) as file:
            parts = {part.name(): part.channels["RGB"].pixels.copy() for part in file.parts}
        np.testing.assert_array_equal(parts["error"], found.images.total.astype(np.float32))


class Listening(Control):
    """Notes every message with the fraction that was done."""

    def __init__(self) -> None:
        self.heard: list[tuple[float, str]] = []
        super().__init__()

    def __setattr__(self, name: str, value: object) -> None:
        super().__setattr__(name, value)
        if name == "message" and hasattr(self, "_reported"):
            self.heard.append((self.fraction, str(value)))


def test_a_model_that_cannot_serve_is_reported_and_the_others_go_on(tmp_path: Path) -> None:
    scene, listening = synthetic_scene(), Listening()
    sky = Scene(scene.medium, (EnvironmentLight((0.3, 0.4, 0.6)),), scene.camera)
    models = [
        "multidirectional_occlusion",
        Candidate("spherical_harmonics", {"order": 1}, "order 1"),
    ]
    found = compare(FakeRenderer(sky, 20, 16), models, OPTIONS, tmp_path, listening)
    assert found.models[0].measured is None
    assert found.models[0].reason is not None
    assert "distant" in found.models[0].reason
    assert found.models[1].parameters["order"] == 1
    assert (tmp_path / "spherical_harmonics.order 1.exr").exists()
    assert found.models[0].reason in (tmp_path / "report.html").read_text()
    fractions = [fraction for fraction, _ in listening.heard]
    assert fractions == sorted(fractions)
    assert fractions[-1] > 0.9
    assert any("left)" in text for _, text in listening.heard)


def test_no_model_at_all_is_an_error(tmp_path: Path) -> None:
    scene = synthetic_scene()
    sky = Scene(scene.medium, (EnvironmentLight(1.0),), scene.camera)
    with pytest.raises(InputError, match="knows only lights of the kinds distant"):
        compare(FakeRenderer(sky, 8, 6), ["multidirectional_occlusion"], OPTIONS, tmp_path)
    with pytest.raises(InputError, match="model is 'nonsense'"):
        compare(FakeRenderer(sky, 8, 6), ["nonsense"], OPTIONS, tmp_path)
    assert not (tmp_path / "report.json").exists()


def test_a_cancelled_comparison_writes_no_report_and_goes_on_later(tmp_path: Path) -> None:
    control = Control()

    class Impatient(FakeRenderer):
        def reference(self, bounces: int, samples: int, seed: int) -> np.ndarray:
            if bounces and seed == 3:
                control.cancel()
            return super().reference(bounces, samples, seed)

    with pytest.raises(Cancelled):
        compare(Impatient(synthetic_scene(), *SIZE), MODELS[2:], OPTIONS, tmp_path, control)
    assert not (tmp_path / "report.json").exists()
    patient = FakeRenderer(synthetic_scene(), *SIZE)
    found = compare(patient, MODELS[2:], OPTIONS, tmp_path)
    # Three seeds of the full reference, and all of the single one, were there; the check takes 8.
    assert patient.calls["reference"] == found.full.seeds - 3 + 8


def test_the_published_algorithm_takes_part_beside_its_model(tmp_path: Path) -> None:
    """Both share the equation, so the exact image and the model error are one; the bakes differ."""
    options = replace(OPTIONS, published=True)
    found = compare(FakeRenderer(synthetic_scene(), *SIZE), ["multidirectional_occlusion"], options,
                    tmp_path)  # fmt: skip
    assert [model.variant for model in found.models] == ["equation", "published"]
    assert [model.file for model in found.models] == [
        "multidirectional_occlusion.exr",
        "multidirectional_occlusion.published.exr",
    ]
    (own, equation), (other, published) = found.measured
    assert other.label == f"{own.label} (published)"
    assert np.array_equal(equation.images.exact.value, published.images.exact.value)
    assert len(list((tmp_path / "parts").glob("exact_*.npz"))) == 1
    worse = published.errors["numerical_field"].relative_rmse
    assert worse > 2 * equation.errors["numerical_field"].relative_rmse
