"""The command line: one function for `volillum`, `blender --command volillum` and tests.

Needs no bpy until a command works on a scene.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from .. import __version__
from ..bake.store import prepare
from ..core.control import Cancelled
from ..models.composition import FORM
from ..models.registry import MODELS
from . import analyse_command, compare_command, gallery_command, import_command, scene_presets
from .arguments import frame_range, model_id, model_ids, positive
from .describe import as_json, as_markdown, as_text
from .failures import EXPECTED, one_line
from .model_page import as_page

DONE, FAILED, WRONG_USAGE, CANCELLED = 0, 1, 2, 130


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; `argv` are the process's arguments unless given.

    Returns the exit status: 0 done, 1 the input or the work failed (one line on standard error),
    2 wrong usage, 130 cancelled.
    """
    wanted = sys.argv[1:] if argv is None else argv
    if not wanted:
        parser().print_help(sys.stderr)
        return WRONG_USAGE
    try:
        options = parser().parse_args(wanted)
    except SystemExit as stop:  # argparse exits; a Blender that calls this must go on running
        return stop.code if isinstance(stop.code, int) else FAILED
    try:
        options.run(options)
    except (Cancelled, KeyboardInterrupt):
        print("volillum: cancelled", file=sys.stderr)
        return CANCELLED
    except BrokenPipeError:
        # The reader of our output has seen enough (`| head`); the exit's own flush must not fail.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except EXPECTED as error:
        print(f"volillum: {one_line(error)}", file=sys.stderr)
        return FAILED
    return DONE


def parser() -> argparse.ArgumentParser:
    """What `volillum` understands."""
    result = argparse.ArgumentParser(
        prog="volillum",
        description="Bake volumetric illumination models and compare them with full scattering.",
    )
    result.add_argument("--version", action="version", version=f"volillum {__version__}")
    commands = result.add_subparsers(title="commands", metavar="COMMAND", required=True)
    _add_models(commands.add_parser("models", help="list the models and their parameters"))
    import_command.add(commands.add_parser("import", help="turn a volume of any format into a VDB"))
    _add_scene(commands.add_parser("scene", help="make a scene around a volume"))
    _add_bake(commands.add_parser("bake", help="bake one model's illumination into a VDB file"))
    _add_analyse(commands.add_parser("analyse", help="what a scene needs, and what to bake for it"))
    _add_compare(commands.add_parser("compare", help="measure models against full scattering"))
    gallery_command.add(commands.add_parser("gallery", help="show standard scenes of real volumes"))
    _add_demo(commands.add_parser("demo", help="compare all models on the volume that is included"))
    _add_hardcases(commands.add_parser("hardcases", help="examine models in scenes that are hard"))
    return result


def _add_models(command: argparse.ArgumentParser) -> None:
    form = command.add_mutually_exclusive_group()
    form.add_argument("--json", action="store_true", help="as JSON, for programs")
    form.add_argument("--markdown", action="store_true", help="the terms of all, side by side")
    form.add_argument("--pages", type=Path, metavar="DIR", help="a page about each, as files there")
    command.set_defaults(run=_models)


def _add_scene(command: argparse.ArgumentParser) -> None:
    import_command.add_lit_volume(command)
    presets = scene_presets.names()
    command.add_argument("--preset", choices=presets, default="default", help="light and camera")
    command.add_argument("-o", "--output", type=Path, required=True, metavar="OUT.blend")
    command.set_defaults(run=_make_scene)


def _add_bake(command: argparse.ArgumentParser) -> None:
    _add_scene_file(command)
    command.add_argument(
        "--model",
        type=model_id,
        required=True,
        metavar="ID",
        help="one of " + ", ".join(MODELS) + "; or one for each kind of light: " + FORM,
    )
    command.add_argument(
        "--set",
        type=_assignment,
        action="append",
        default=[],
        dest="given",
        metavar="NAME=VALUE",
        help="a parameter in place of the file's (see `volillum models`)",
    )
    command.add_argument(
        "--frames",
        type=frame_range,
        metavar="A-B",
        help="bake these frames as a sequence, and print a line of JSON for each",
    )
    command.add_argument(
        "--seen-only",
        action="store_true",
        help="no light where the scene's camera does not look (default: as the file says)",
    )
    command.set_defaults(run=_bake)


def _add_analyse(command: argparse.ArgumentParser) -> None:
    _add_scene_name(command)
    _add_progress(command)
    analyse_command.add_arguments(command)


def _add_compare(command: argparse.ArgumentParser) -> None:
    _add_scene_file(command)
    command.add_argument(
        "--models", type=model_ids, default=(), metavar="ID,ID", help="default: all"
    )
    compare_command.add_thoroughness(
        command, samples=64, noise=1.0, seconds=120.0, rays=32, width=None
    )
    command.add_argument(
        "--resume",
        action="store_true",
        help="go on with the directory's unfinished comparison, as it was asked for; options that "
        "are given again must be the same",
    )
    command.set_defaults(run=_compare)


def _add_demo(command: argparse.ArgumentParser) -> None:
    _add_output(command)
    compare_command.add_thoroughness(
        command, samples=32, noise=2.0, seconds=36.0, rays=12, width=64
    )
    command.set_defaults(run=_demo)


def _add_hardcases(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--models", type=model_ids, default=(), metavar="ID,ID", help="default: all"
    )
    command.add_argument("-o", "--output", type=Path, required=True, metavar="DIR")
    command.set_defaults(run=_hardcases)


def _add_scene_file(command: argparse.ArgumentParser) -> None:
    _add_scene_name(command)
    _add_output(command)


def _add_scene_name(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "file",
        type=Path,
        nargs="?",
        metavar="SCENE.blend",
        help="the open file, when left out inside Blender",
    )
    command.add_argument("--scene", metavar="NAME", help="which scene of the file")


def _add_output(command: argparse.ArgumentParser) -> None:
    command.add_argument("-o", "--output", type=Path, required=True, metavar="DIR")
    _add_progress(command)


def _add_progress(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--progress-seconds",
        type=positive,
        metavar="SECONDS",
        help="print a line of progress this often",
    )


def _assignment(text: str) -> tuple[str, str]:
    name, equals, value = text.partition("=")
    if not (name and equals and value):
        raise argparse.ArgumentTypeError(f"{text!r} is not NAME=VALUE")
    return name, value


def _models(options: argparse.Namespace) -> None:
    if options.json:
        print(json.dumps([as_json(model) for model in MODELS.values()], indent=2, allow_nan=False))
    elif options.pages is not None:
        prepare(options.pages)
        for model in MODELS.values():
            path = options.pages / f"{model.id}.md"
            path.write_text(as_page(model), encoding="utf-8")
            print(path)
    elif options.markdown:
        print(as_markdown(tuple(MODELS.values())))
    else:
        print("\n\n".join(as_text(model) for model in MODELS.values()))


def _hardcases(options: argparse.Namespace) -> None:
    from ..compare.hard_command import hardcases

    print(hardcases(options.models, options.output))


# What follows needs bpy, which takes a second to import and prints to standard output.


def _make_scene(options: argparse.Namespace) -> None:
    from . import commands
    from .scene_builder import check_target

    check_target(options.output)
    files, imported = import_command.lit_volume(options, options.output.parent)
    print(commands.make_scene(files, options.preset, options.output, options.grid, imported))


def _bake(options: argparse.Namespace) -> None:
    from . import commands

    if options.frames is not None:
        commands.bake_frames(
            options.file,
            options.scene,
            options.model,
            dict(options.given),
            options.frames,
            options.output,
            options.progress_seconds,
            options.seen_only,
        )
        return
    print(
        commands.bake(
            options.file,
            options.scene,
            options.model,
            dict(options.given),
            options.output,
            options.progress_seconds,
            options.seen_only,
        )
    )


def _compare(options: argparse.Namespace) -> None:
    from . import commands

    given = compare_command.given(options)
    thoroughness = commands.Thoroughness.of(compare_command.filled(options))
    if options.resume:
        asked = {name: getattr(thoroughness, name) for name in given}
        if options.models:
            asked["models"] = list(options.models)
        where = (options.file, options.scene, asked, options.output, options.progress_seconds)
        print(commands.resume(*where))
        return
    print(
        commands.compare(
            options.file,
            options.scene,
            options.models,
            thoroughness,
            options.output,
            options.progress_seconds,
        )
    )


def _demo(options: argparse.Namespace) -> None:
    from . import commands

    thoroughness = commands.Thoroughness.of(compare_command.filled(options))
    print(commands.demo(thoroughness, options.output, options.progress_seconds))
