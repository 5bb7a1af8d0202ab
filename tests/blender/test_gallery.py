"""The gallery: its data, its scenes, and pictures that nobody would show."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import override

import bpy
import numpy as np
import pytest
from expected_skips import third_party_data

from volillum_addon.blender import gallery, scene_presets, work
from volillum_addon.blender.cli import FAILED, main
from volillum_addon.blender.gallery_presets import Exhibit, exhibit, names, volume_file
from volillum_addon.core.coarse import block_means
from volillum_addon.core.control import Control
from volillum_addon.core.errors import InputError
from volillum_addon.core.medium import Medium

UNSEEN = Path(__file__).resolve().parents[1] / "benchmarks" / "unseen"


@pytest.mark.parametrize("name", names())
def test_every_scene_is_there_and_shows_what_it_says(name: str) -> None:
    entry = exhibit(name)
    assert entry.preset.sun.irradiance != (0, 0, 0)
    if entry.volume != "smoke.vdb":
        third_party_data(entry.volume)
    medium = entry.load()
    # Enough matter to see, and light can get through some of it.
    depth = medium.sigma_t.values.sum(axis=0).max() * medium.sigma_t.voxel_size[0]
    assert depth > 1
    assert (medium.emission is None) == (entry.emission is None)
    if medium.emission is not None:
        assert medium.emission.values.any()


def test_unseen_scenes_are_none_of_the_gallery() -> None:
    shown = {exhibit(name).volume for name in names()}
    assert not shown & {exhibit(name, UNSEEN).volume for name in names(UNSEEN)}


@pytest.mark.usefixtures("extension")
def test_the_scene_has_the_medium_of_the_entry(tmp_path: Path) -> None:
    """A coarse part of the smoke with a glow: written, shown, read back as it was."""
    entry = exhibit("smoke")
    bpy.ops.wm.open_mainfile(filepath=str(gallery.make_scene(entry, tmp_path)))
    read = work.read(bpy.context.scene).scene
    wanted = entry.load().trimmed(0)
    found = read.medium.trimmed(0)
    np.testing.assert_allclose(found.sigma_t.values, wanted.sigma_t.values, rtol=1e-5, atol=1e-7)
    albedo = found.constant_albedo
    assert albedo == pytest.approx(wanted.constant_albedo, rel=1e-4)
    assert {light.kind for light in read.lights} == {"distant", "environment"}


@pytest.mark.usefixtures("extension")
def test_what_glows_still_glows(tmp_path: Path) -> None:
    third_party_data("density_heat_vdb")
    entry = exhibit("fire")
    bpy.ops.wm.open_mainfile(filepath=str(gallery.make_scene(entry, tmp_path)))
    found = work.read(bpy.context.scene).scene.medium.trimmed(0)
    wanted = entry.load().trimmed(0)
    assert found.emission is not None
    assert wanted.emission is not None
    np.testing.assert_allclose(found.emission.values, wanted.emission.values, rtol=1e-5, atol=1e-7)
    assert found.emission.values.max() == pytest.approx(2.4 * 0.7595, rel=1e-3)


@pytest.mark.parametrize(
    ("brightness", "cover", "complaint"),
    [((0.0, 0.01), 0.5, "mean brightness"), ((0.5, 0.5), 0.5, "spread"), ((0.1, 0.9), 0.01, "cov")],
)
def test_pictures_nobody_would_show_are_refused(
    brightness: tuple[float, float], cover: float, complaint: str
) -> None:
    mask = np.arange(10_000).reshape(100, 100) < cover * 10_000
    radiance = np.linspace(*brightness, 30_000).reshape(100, 100, 3)
    with pytest.raises(InputError, match=complaint):
        gallery.check_picture("it", radiance, mask)
    good = np.linspace(0.1, 0.9, 30_000).reshape(100, 100, 3)
    gallery.check_picture("it", good, np.ones((100, 100), bool))


def test_an_absent_volume_is_said_loudly(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delenv("VOLILLUM_DATA", raising=False)
    with pytest.raises(InputError, match="VOLILLUM_DATA is not set"):
        volume_file("rico_cloud/rico122x106x39.txt")
    assert volume_file("smoke.vdb").is_file()
    status = main(["gallery", "cloud", "-o", str(tmp_path), "--scene-only"])
    assert status == FAILED
    assert "NOT SHOWN: rico_cloud" in capsys.readouterr().err
    monkeypatch.setenv("VOLILLUM_DATA", str(tmp_path))
    with pytest.raises(InputError, match="expected it there"):
        volume_file("rico_cloud/rico122x106x39.txt")


class Small(Exhibit):
    """The same on a coarse grid."""

    @override
    def load(self) -> Medium:
        """Blocks of eight voxels along each axis."""
        medium = super().load()
        return replace(
            medium,
            sigma_t=block_means(medium.sigma_t, 8),
            sigma_s=block_means(medium.sigma_s, 8),
        )


@pytest.mark.usefixtures("extension")
def test_a_scene_is_baked_rendered_and_measured(tmp_path: Path) -> None:
    entry = exhibit("smoke")
    small = replace(entry.preset, image=scene_presets.Picture(24, 32, "transparent"))

    shown = Small(entry.name, entry.summary, entry.volume, entry.medium, None, small)
    wishes = gallery.Wishes(model="multidirectional_occlusion", seconds=1.0, samples=4)
    found = gallery.show(shown, wishes, tmp_path, Control())
    assert json.loads((tmp_path / "smoke.json").read_text()) == found
    for kind in ("baked", "cycles"):
        assert (tmp_path / f"smoke.{kind}.png").stat().st_size > 500
    assert found["model"] == "multidirectional_occlusion"
    # Single scattering of smoke is too dark by some tens of percent, never black or brighter.
    assert 0.2 < found["total"]["relative_rmse"] < 0.9
    assert found["exposure"] > 1
