"""`volillum gallery`: standard scenes from real volumes, baked and path-traced."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from ..bake.store import prepare
from ..core.errors import InputError
from . import gallery_presets
from .arguments import model_id, percent, positive

ALL = "all"


def add(command: argparse.ArgumentParser) -> None:
    """What the command takes."""
    names = (*gallery_presets.names(), ALL)
    command.add_argument("name", choices=names, metavar="NAME", help="one of " + ", ".join(names))
    command.add_argument("-o", "--output", type=Path, required=True, metavar="DIR")
    command.add_argument(
        "--scene-only", action="store_true", help="make the .blend file and render nothing"
    )
    command.add_argument("--model", type=model_id, metavar="ID", help="bake this one instead")
    for name, kind, default, metavar, text in (
        ("--error", percent, 0.05, "PERCENT", "what the bake's error may be (default: 5)"),
        ("--seconds", positive, 60.0, "BUDGET", "of the Cycles picture (default: 60)"),
        ("--scale", positive, 1.0, "FACTOR", "of the pictures' size (default: 1)"),
        ("--progress-seconds", positive, None, "SECONDS", "print a line of progress this often"),
    ):
        command.add_argument(name, type=kind, default=default, metavar=metavar, help=text)
    command.set_defaults(run=run)


def run(options: argparse.Namespace) -> None:
    """Make the scenes; one whose volume is not there is said on standard error."""
    from .terminal import quiet, watched

    with quiet():
        from . import commands, gallery
    names = gallery_presets.names() if options.name == ALL else (options.name,)
    prepare(options.output)
    wishes = gallery.Wishes(options.error, options.model, options.seconds, scale=options.scale)
    absent = []
    for name in names:
        entry = gallery_presets.exhibit(name)
        try:
            gallery_presets.volume_file(entry.volume)
        except InputError as error:
            absent.append(gallery.missing(error))
            if len(names) > 1:
                print(f"volillum: {absent[-1]}", file=sys.stderr)
            continue
        if options.scene_only:
            with quiet():
                made = gallery.make_scene(entry, options.output)
            print(made)
            continue
        watching = watched(name, options.progress_seconds)
        with quiet(), commands.settings_readable(), watching as control:
            gallery.show(entry, wishes, options.output, control)
        print(options.output / f"{name}.json")
    if len(absent) == len(names):
        raise InputError(absent[0])
