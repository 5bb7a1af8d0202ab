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
        command.add_argument(name, type=kind, metavar=metavar, help=help_text)
    # `filled` puts defaults in, so that what was not given can be told from what was.
    command.set_defaults(
        defaults={"samples": samples, "noise": noise, "seconds": seconds, "rays": rays,
                  "width": width, "baselines": BASELINES}
    )  # fmt: skip
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


def given(options: argparse.Namespace) -> tuple[str, ...]:
    """The names of what was asked for, with what --thorough means put in, where nothing else was
    given."""
    options.ladder = options.ladder or options.thorough
    if options.thorough:
        for name, value in (("baselines", THOROUGH_BASELINES), ("rung_seconds", THOROUGH_SECONDS)):
            if getattr(options, name) is None:
                setattr(options, name, value)
    names = (*options.defaults, "rung_seconds", "published", "ladder")
    return tuple(name for name in names if getattr(options, name) not in (None, False))


def filled(options: argparse.Namespace) -> argparse.Namespace:
    """The options, complete."""
    given(options)
    for name, value in options.defaults.items():
        if getattr(options, name) is None:
            setattr(options, name, value)
    return options


def _whole(text: str) -> int:
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"{text} is not at least 1")
    return value


def _count(text: str) -> int:
    return 0 if int(text) == 0 else _whole(text)
