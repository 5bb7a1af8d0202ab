"""How much memory this process holds, and has held at most."""

from __future__ import annotations

import sys
from pathlib import Path

if sys.platform != "win32":
    import resource

STATUS = Path("/proc/self/status")
KILOBYTE = 1024


def peak_bytes() -> int:
    """Most resident memory so far, in bytes; 0 where the system does not tell.

    On Linux from /proc, because ru_maxrss of a child starts at the peak of the process that
    started it.
    """
    if STATUS.exists():
        return _status("VmHWM")
    if sys.platform == "win32":
        return 0
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return int(peak if sys.platform == "darwin" else peak * KILOBYTE)


def resident_bytes() -> int:
    """Resident memory now, in bytes (elsewhere than on Linux: the peak so far)."""
    return _status("VmRSS") if STATUS.exists() else peak_bytes()


def _status(field: str) -> int:
    for line in STATUS.read_text().splitlines():
        if line.startswith(field + ":"):
            return int(line.split()[1]) * KILOBYTE
    return 0
