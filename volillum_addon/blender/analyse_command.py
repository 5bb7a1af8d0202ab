"""`volillum analyse`: its arguments, and what it prints."""

from __future__ import annotations

import argparse
import json

from ..compare.predict import predict
from ..compare.recommend import Request, recommended, usual
from .analysis_text import as_json, as_text
from .arguments import percent, positive


def add_arguments(command: argparse.ArgumentParser) -> None:
    """What the command takes beside the scene."""
    command.add_argument("--json", action="store_true", help="as JSON, for programs")
    command.add_argument(
        "--error",
        type=percent,
        metavar="PERCENT",
        help="recommend the fastest setting of at most this total error (after exposure)",
    )
    command.add_argument(
        "--seconds",
        type=positive,
        metavar="SECONDS",
        help="recommend the most accurate setting that bakes in this time; or both",
    )
    command.add_argument("--all", action="store_true", help="list every composition too")
    command.set_defaults(run=run)


def run(options: argparse.Namespace) -> None:
    """Read, predict, print."""
    from . import commands, work  # needs bpy
    from .terminal import quiet, watched

    with quiet(), commands.opened(options.file, options.scene) as scene:
        reading = work.read(scene)
        with watched("analysing", options.progress_seconds) as control:
            found = predict(reading.scene, reading.width / reading.height, control)
    request = Request(options.error, options.seconds)
    asked = request != Request()
    answers = [(request, recommended(found.entries, request))] if asked else usual(found)
    if options.json:
        print(json.dumps(as_json(found, answers), indent=2, allow_nan=False))
    else:
        print(as_text(reading.stem, found, answers, options.all))
