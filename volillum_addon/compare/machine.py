"""What the measurements were made on."""

from __future__ import annotations

import os
import platform
from pathlib import Path

import numpy as np

from .. import __version__
from ..core.native import native


def machine() -> dict[str, object]:
    """Processor and system; no names of hosts or people."""
    return {
        "system": f"{platform.system()} {platform.machine()}",
        "processor": _processor(),
        "threads": os.process_cpu_count() or 1,
        "instruction_set": str(native.instruction_set()),
    }


def versions() -> dict[str, str]:
    """The software that is not the renderer's."""
    return {
        "volillum": __version__,
        "python": platform.python_version(),
        "numpy": np.__version__,
    }


def _processor() -> str:
    information = Path("/proc/cpuinfo")
    if information.exists():
        for line in information.read_text(errors="replace").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()
