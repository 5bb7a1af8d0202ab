"""How much memory this process holds, and has held at most."""

from __future__ import annotations

import sys
from pathlib import Path

if sys.platform != "win32":
    import resource

STATUS = Path("/proc/self/status")
SYSTEM = Path("/proc/meminfo")
KILOBYTE = 1024


def peak_bytes() -> int:
    """Most resident memory so far, in bytes; 0 where the system does not tell.

    On Linux from /proc, because ru_maxrss of a child starts at the peak of the process that
    started it.
    """
    if STATUS.exists():
        return _field(STATUS, "VmHWM")
    if sys.platform == "win32":
        return 0
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return int(peak if sys.platform == "darwin" else peak * KILOBYTE)


def resident_bytes() -> int:
    """Resident memory now, in bytes (elsewhere than on Linux: the peak so far)."""
    return _field(STATUS, "VmRSS") if STATUS.exists() else peak_bytes()


def available_bytes() -> int:
    """Memory that could still be used without swapping, in bytes; 0 where the system does not
    tell."""
    return _field(SYSTEM, "MemAvailable") if SYSTEM.exists() else 0


def _field(file: Path, field: str) -> int:
    for line in file.read_text().splitlines():
        if line.startswith(field + ":"):
            return int(line.split()[1]) * KILOBYTE
    return 0
