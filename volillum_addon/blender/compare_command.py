"""How thorough a comparison is to be, on the command line."""

from __future__ import annotations

import argparse

from .arguments import positive

# Samples of the baselines and seconds of a setting, unless asked otherwise, and with --thorough.
BASELINES, THOROUGH_BASELINES, THOROUGH_SECONDS = 64, 1024, 120.0


def add_thoroughness(
    command: argparse.ArgumentParser,
    samples: int,
    noise: float,
    seconds: float,
    rays: int,
    width: int | None,
) -> None:
    """The options of `compare` and `demo`, with their defaults."""
    for name, kind, default, metavar, text in (
        ("--samples", _whole, samples, "N", "samples per pixel and seed of a reference"),
        ("--noise", positive, noise, "PERCENT", "render references until below this noise"),
        ("--seconds", positive, seconds, "BUDGET", "or until this time has gone"),
        ("--rays", _whole, rays, "N", "rays per point of the models' exact images"),
        ("--width", _whole, width, "N", "pixels across"),
    ):
        shown = "as the scene renders" if default is None else f"{default:g}"
        help_text = f"{text} (default: {shown})"
        command.add_argument(name, type=kind, default=default, metavar=metavar, help=help_text)
    # Without a default: --thorough has its own.
    command.add_argument(
        "--baselines",
        type=_count,
        metavar="N",
        help=f"Cycles itself with 1 to N samples; 0: without (default: {BASELINES})",
    )
    command.add_argument(
        "--rung-seconds",
        type=positive,
        metavar="BUDGET",
        help="leave out other settings that take longer (default: an eighth of --seconds)",
    )
    command.add_argument(
        "--published",
        action="store_true",
        help="set each model's published algorithm beside it",
    )
    command.add_argument(
        "--ladder", action="store_true", help="other settings of each model, from fast to accurate"
    )
    command.add_argument(
        "--thorough",
        action="store_true",
        help="--ladder, and unless they are given "
        f"--baselines {THOROUGH_BASELINES} --rung-seconds {THOROUGH_SECONDS:g}",
    )


def filled(options: argparse.Namespace) -> argparse.Namespace:
    """The options with what --thorough means put in, where nothing else was given."""
    options.ladder = options.ladder or options.thorough
    if options.baselines is None:
        options.baselines = THOROUGH_BASELINES if options.thorough else BASELINES
    if options.rung_seconds is None and options.thorough:
        options.rung_seconds = THOROUGH_SECONDS
    return options


def _whole(text: str) -> int:
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"{text} is not at least 1")
    return value


def _count(text: str) -> int:
    return 0 if int(text) == 0 else _whole(text)
