"""The wheel's version: the project's own, and a local part that changes whenever a source does.

Blender does not replace an installed wheel by another one of the same version, so two builds of
different sources must not share theirs. A hash of the sources is the same in a clone, in a source
archive and in a working tree with changes, which a commit's name is not.
"""

import hashlib
from collections.abc import Mapping
from pathlib import Path

NATIVE = Path(__file__).resolve().parent
SOURCES = ("CMakeLists.txt", "pyproject.toml", "include/**/*.h", "src/**/*")
HASH_DIGITS = 12


def source_hash() -> str:
    """The sources' names and contents as hexadecimal digits."""
    digest = hashlib.sha256()
    for path in sorted({path for pattern in SOURCES for path in NATIVE.glob(pattern)}):
        if path.is_file():
            content = hashlib.sha256(path.read_bytes()).hexdigest()
            digest.update(f"{path.relative_to(NATIVE).as_posix()} {content}\n".encode())
    return digest.hexdigest()[:HASH_DIGITS]


def dynamic_metadata(field: str, settings: Mapping[str, object]) -> str:
    """The hook that scikit-build-core calls (its dynamic metadata interface)."""
    if field != "version":
        raise ValueError(f"dynamic field is {field!r}; expected 'version'")
    return f"{settings['base']}+h{source_hash()}"
