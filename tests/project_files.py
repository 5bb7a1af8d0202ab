"""The project's own files and make targets, for tests of the project itself."""

import os
import subprocess
from pathlib import Path, PurePosixPath

from expected_skips import skip

ROOT = Path(__file__).resolve().parents[1]


def tracked_files() -> list[PurePosixPath]:
    """The tracked files, relative to the project's root."""
    if not (ROOT / ".git").exists():
        skip("git checkout")
    listing = subprocess.run(
        ["git", "ls-files", "-z"], cwd=ROOT, check=True, capture_output=True, text=True
    ).stdout
    return [PurePosixPath(name) for name in listing.split("\0") if (ROOT / name).is_file()]


def make(*arguments: str) -> None:
    """Runs make as a user would, even when make runs these tests."""
    environment = {key: value for key, value in os.environ.items() if not key.startswith("MAKE")}
    done = subprocess.run(
        ["make", "--no-print-directory", *arguments],
        cwd=ROOT,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
