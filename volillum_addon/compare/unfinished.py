"""What the comparison that a directory holds unfinished was asked for, so that it can go on without
being told again. What it has measured lies in `parts`, each under a hash of its inputs."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from ..bake.store import StorageError, replacing
from ..core.errors import InputError, bad

FILE = "unfinished.json"


def asked(directory: Path) -> dict[str, Any] | None:
    """What was asked for; None where nothing is unfinished. Raises InputError for a broken file."""
    path = directory / FILE
    try:
        held = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return None
    except (OSError, ValueError) as error:
        raise bad(str(path), str(error), "what an unfinished comparison left") from error
    if not isinstance(held, dict):
        raise bad(str(path), type(held).__name__, "what an unfinished comparison left")
    return held


@contextmanager
def noted(directory: Path, request: Mapping[str, Any]) -> Iterator[None]:
    """Keep the request in the directory until the body has ended. Where its input is refused, what
    was there before is there again."""
    path = directory / FILE
    before = path.read_text(encoding="utf-8") if path.exists() else None
    with replacing(path) as temporary:
        temporary.write_text(json.dumps(request, indent=2) + "\n", encoding="utf-8")
    try:
        yield
    except StorageError:
        raise  # with more room it can go on
    except InputError:
        if before is not None:
            path.write_text(before, encoding="utf-8")
            raise
        path.unlink(missing_ok=True)
        with suppress(OSError):
            directory.rmdir()  # only where nothing else is in it
        raise
    path.unlink(missing_ok=True)
