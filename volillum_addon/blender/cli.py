"""The command line: one function for `volillum`, `blender --command volillum` and tests."""

import argparse
import sys
from collections.abc import Sequence

from .. import __version__


def parser() -> argparse.ArgumentParser:
    """What `volillum` understands."""
    result = argparse.ArgumentParser(
        prog="volillum",
        description="Bake volumetric illumination models and compare them with full scattering.",
    )
    result.add_argument("--version", action="version", version=f"volillum {__version__}")
    return result


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command line; `arguments` are those of the process unless given.

    Returns the exit status: 0 done, 1 the input or the work failed, 2 wrong usage, 130 cancelled.
    """
    options = parser()
    try:
        options.parse_args(arguments)
    except SystemExit as exit_:  # argparse exits; a Blender that calls this must go on running
        return exit_.code if isinstance(exit_.code, int) else 1
    options.print_usage(sys.stderr)
    return 2
