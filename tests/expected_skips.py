"""The only way to skip a test, and every reason there may be for it.

A skip that does not come from here fails the run (`plugins/skips.py`), so that a test cannot drop
out unnoticed. To skip for a new reason, add it to `EXPECTED` and call `skip` with its name.
"""

import os
from pathlib import Path
from typing import NoReturn

import pytest

EXPECTED = {
    "x86-64 Linux": "run-time dispatch is compiled for x86-64 Linux only",
    "git checkout": "the sources are no git checkout, so that what belongs to them is not known",
    "browser": "there is no Chromium to look at the report with",
    "two processors": "this machine gives the tests one processor only",
    "real Blender": "no Blender with a window could be had",
    "third-party data": "VOLILLUM_DATA names no folder that holds the third-party volumes",
}
PREFIX = "expected skip, "


def skip(name: str, detail: str = "") -> NoReturn:
    """Skips the running test for the expected reason `name`; a KeyError if it is not listed."""
    reason = f"{PREFIX}{name}: {EXPECTED[name]}"
    pytest.skip(f"{reason} ({detail})" if detail else reason)


def is_expected(reason: str) -> bool:
    """Whether a skip's reason is one that `skip` words."""
    return any(reason.startswith(f"{PREFIX}{name}: {text}") for name, text in EXPECTED.items())


def third_party_data(name: str) -> Path:
    """The file or folder `name` under VOLILLUM_DATA; skips where that variable is not set.

    Where it is set, a name that is absent is a FileNotFoundError: the folder is then not what it
    is said to be.
    """
    folder = os.environ.get("VOLILLUM_DATA")
    if not folder:
        skip("third-party data")
    path = Path(folder) / name
    if not path.exists():
        raise FileNotFoundError(f"VOLILLUM_DATA={folder} has no {name}")
    return path
