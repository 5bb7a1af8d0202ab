"""The commands that work on a Blender scene; each returns what to print."""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path

from ..compare import unfinished
from ..compare.measure import Options
from ..compare.table import text
from ..core.errors import InputError, bad, choice
from ..readers.frames import VolumeFiles
from ..readers.matter import Imported
from ..readers.source import absent
from ..resources import PRESETS
from .terminal import quiet, watched

with quiet():
    import bpy

    from . import animation, comparing, properties, scene_presets, transfer, work
    from .scene_builder import save_scene

DEMO_VOLUME = PRESETS / "volumes" / "smoke.vdb"
DEMO_PRESET = "smoke"
MAKE_ONE = "`volillum scene VOLUME -o SCENE.blend` makes one"


@dataclass(frozen=True)
class Thoroughness:
    """How good a comparison is to be: see `volillum compare --help`."""

    samples: int
    noise: float
    seconds: float
    rays: int
    width: int | None
    published: bool = False
    ladder: bool = False
    baselines: int = 64
    rung_seconds: float | None = None

    @classmethod
    def of(cls, options: argparse.Namespace) -> Thoroughness:
        """As the command line has it, noise in percent."""
        return cls(
            options.samples,
            options.noise / 100,
            options.seconds,
            options.rays,
            options.width,
            options.published,
            options.ladder,
            options.baselines,
            options.rung_seconds,
        )


def make_scene(
    files: VolumeFiles,
    preset: str,
    target: Path,
    grid: str | None = None,
    imported: Imported | None = None,
) -> str:
    """Make the scene; the file's path."""
    with quiet(), settings_readable(), watched(f"making {target.name}") as control:
        save_scene(files, scene_presets.load(preset), target, grid, imported, control)
    return str(target)


@contextmanager
def _only_seen(scene: bpy.types.Scene, seen_only: bool) -> Iterator[None]:
    """The scene with the setting on where that is asked for, and as it was afterwards."""
    settings, before = scene.volillum, scene.volillum.seen_only
    settings.seen_only = before or seen_only
    try:
        yield
    finally:
        settings.seen_only = before


def bake(
    file: Path | None,
    scene_name: str | None,
    model: str,
    given: Mapping[str, str],
    directory: Path,
    progress_seconds: float | None,
    seen_only: bool = False,
) -> str:
    """Bake with the file's own parameters, `given` over them; the baked file's path."""
    with quiet(), opened(file, scene_name) as scene, _only_seen(scene, seen_only):
        values = {**properties.model_values(scene.volillum, model), **given}
        reading = work.read_to_bake(scene)
        begin = time.monotonic()
        with watched(f"baking {model}", progress_seconds) as control:
            baked = work.bake(reading, model, values, directory, control)
        seconds = time.monotonic() - begin
    for note in (*reading.notes, *baked.notes):
        print(f"note: {note}", file=sys.stderr)
    took = f"{baked.seconds_bake + baked.seconds_hand_over:.2f} s"
    how = f"found, baked before in {took}" if baked.found else f"baked in {took}"
    print(f"{model} {how} ({seconds:.2f} s in all)", file=sys.stderr)
    return str(baked.path)


def bake_frames(
    file: Path | None,
    scene_name: str | None,
    model: str,
    given: Mapping[str, str],
    frames: Sequence[int],
    directory: Path,
    progress_seconds: float | None,
    seen_only: bool = False,
) -> None:
    """Bake a range of frames as one sequence; a line of JSON for each frame once it is there."""
    with quiet() as say, opened(file, scene_name) as scene, _only_seen(scene, seen_only):
        values = {**properties.model_values(scene.volillum, model), **given}
        with watched(f"baking {model}", progress_seconds) as control:
            for frame in animation.bake(scene, model, values, frames, directory, control):
                say(json.dumps(animation.described(frame)))


def compare(
    file: Path | None,
    scene_name: str | None,
    models: tuple[str, ...],
    thoroughness: Thoroughness,
    directory: Path,
    progress_seconds: float | None,
) -> str:
    """Compare with the file's own parameters; the closing table and the report's path.

    Parts that the directory holds are found by their hashes, whatever was asked for when they were
    measured. What is asked for now is kept until it is done, for `resume`.
    """
    request = {
        "file": None if file is None else str(file.absolute()),
        "scene": scene_name,
        "models": list(models),
        "thoroughness": asdict(thoroughness),
    }
    before = unfinished.asked(directory)
    if before is not None and before != request:
        print(
            f"note: {directory} holds an unfinished comparison that was asked for otherwise; what "
            "it measured stays, but --resume will go on with this one",
            file=sys.stderr,
        )
    with quiet(), opened(file, scene_name) as scene:
        options = Options(
            name=scene.name,
            samples=thoroughness.samples,
            noise=thoroughness.noise,
            seconds=thoroughness.seconds,
            directions=thoroughness.rays,
            published=thoroughness.published,
            ladder=thoroughness.ladder,
            baselines=thoroughness.baselines,
            rung_seconds=thoroughness.rung_seconds,
        )
        chosen = work.chosen_models(scene, models)
        with (
            unfinished.noted(directory, request),
            watched("comparing", progress_seconds, estimated=True) as control,
        ):
            found = comparing.compare(
                scene, chosen, options, thoroughness.width, directory, control
            )
    return f"{text(found)}\n\n{directory / comparing.PAGE}"


def resume(
    file: Path | None,
    scene_name: str | None,
    asked: Mapping[str, object],
    directory: Path,
    progress_seconds: float | None,
) -> str:
    """Go on with the directory's unfinished comparison as it was asked for. Its file, its scene
    and what is `asked` for by name may be given again, and must be the same: InputError."""
    held = unfinished.asked(directory)
    if held is None:
        state = "a finished one" if (directory / comparing.PAGE).exists() else "none"
        raise bad(f"the comparison in {directory}", state, "an unfinished one for --resume")
    named = {"file": file and str(file.absolute()), "scene": scene_name, **asked}
    before = {**held, **held["thoroughness"]}
    for name, given in named.items():
        if given is not None and given != before[name]:
            label = name.replace("_", " ")
            raise bad(f"the {label} to resume with", given, f"{before[name]}", str(directory))
    return compare(
        None if held["file"] is None else Path(held["file"]),
        held["scene"],
        tuple(held["models"]),
        Thoroughness(**held["thoroughness"]),
        directory,
        progress_seconds,
    )


def demo(thoroughness: Thoroughness, directory: Path, progress_seconds: float | None) -> str:
    """The main job on the volume that comes with the program."""
    file = directory / f"{DEMO_VOLUME.stem}.blend"
    make_scene(VolumeFiles(DEMO_VOLUME), DEMO_PRESET, file)
    return compare(file, None, (), thoroughness, directory, progress_seconds)


@contextmanager
def opened(file: Path | None, name: str | None) -> Iterator[bpy.types.Scene]:
    """The scene of the file (opened in this Blender), or of the file that is open."""
    with settings_readable():
        if file is not None:
            _open(file)
        elif bpy.app.module and not bpy.data.filepath:
            raise bad("the scene", "not named", f"SCENE.blend; {MAKE_ONE}")
        if name is not None:
            choice("scene", name, tuple(bpy.data.scenes.keys()))
        yield bpy.data.scenes[name] if name is not None else bpy.context.scene


@contextmanager
def settings_readable() -> Iterator[None]:
    """Scenes and materials have their settings, even where the extension is not enabled."""
    registered = properties.is_registered()
    if not registered:
        properties.register()
        transfer.register()
    try:
        yield
    finally:
        if not registered:
            transfer.unregister()
            properties.unregister()


def _open(file: Path) -> None:
    if not file.exists():
        raise absent(file, "a .blend file")
    if file.is_dir():
        raise bad(str(file), "a folder", f"a .blend file; {MAKE_ONE}")
    try:
        bpy.ops.wm.open_mainfile(filepath=str(file.absolute()), load_ui=False)
    except RuntimeError as error:
        why = " ".join(str(error).split())
        raise InputError(f"{file} cannot be opened ({why}); expected a .blend file; "
                         f"{MAKE_ONE}") from error  # fmt: skip
