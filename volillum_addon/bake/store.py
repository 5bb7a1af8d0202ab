"""Files that are there whole or not at all: a temporary beside the target, then a rename.

A temporary is locked by the process that writes it, and the lock ends with the process however it
dies. The next bake in a directory removes those that nobody holds. (A process id in the name alone
would not tell: ids are reused, and a render farm's machines share directories, not processes.)
"""

from __future__ import annotations

import contextlib
import os
import secrets
import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ..core.errors import InputError

# On Windows an open file cannot be removed, which serves as the lock.
if sys.platform != "win32":
    import fcntl

PREFIX, SUFFIX = ".volillum-", ".tmp"
# Written after the data when something is wrong, to make the system say what.
PROBE_BYTES = 1 << 20


class StorageError(OSError, InputError):
    """A file or directory cannot be written; the message is one line for a person to read."""


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield a temporary path whose file becomes `path` when the body succeeds.

    The directory is made if need be. Whatever happens, no partial file appears under `path`, and
    the temporary is gone. Raises StorageError, also before the body when the directory cannot be
    written.
    """
    temporary, lock = _create(prepare(path.parent))
    try:
        yield temporary
        with _complaint(path.parent):
            _flush(temporary)
            if sys.platform == "win32":
                os.close(lock)
                lock = -1
            temporary.replace(path)
            _flush_directory(path.parent)
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)
        if lock >= 0:
            os.close(lock)


def prepare(directory: Path) -> Path:
    """Make the directory, and remove what dead processes have left in it."""
    with _complaint(directory):
        directory.mkdir(parents=True, exist_ok=True)
        leftovers = sorted(directory.glob(f"{PREFIX}*{SUFFIX}"))
    for leftover in leftovers:
        # One that cannot be opened or removed is somebody's own: it is in nobody's way.
        with contextlib.suppress(OSError):
            _remove_if_abandoned(leftover)
    return directory


def complain(directory: Path, temporary: Path) -> StorageError:
    """Why a file of this directory came out incomplete, asked of the system by writing more."""
    try:
        with temporary.open("ab") as file:
            file.write(bytes(PROBE_BYTES))
            file.flush()
            os.fsync(file.fileno())
    except OSError as error:
        return _storage_error(directory, error)
    free = shutil.disk_usage(directory).free
    return StorageError(
        f"a file was written incompletely ({free} bytes are free now); expected all of it to be "
        f"stored, in {directory}"
    )


def _create(directory: Path) -> tuple[Path, int]:
    while True:
        temporary = directory / f"{PREFIX}{os.getpid()}-{secrets.token_hex(4)}{SUFFIX}"
        with _complaint(directory):
            lock = os.open(temporary, os.O_CREAT | os.O_EXCL | os.O_RDWR, 0o666)
        # Another process may take it for abandoned before it is locked: then make another one.
        if _locked(lock) is not False and _same_file(lock, temporary):
            return temporary, lock
        os.close(lock)


def _locked(file: int) -> bool | None:
    """Lock an open file; False when another holds it, None where locks do not exist."""
    if sys.platform == "win32":
        return None
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        return None
    return True


def _same_file(file: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(file), path.stat())
    except FileNotFoundError:
        return False


def _remove_if_abandoned(path: Path) -> None:
    if sys.platform == "win32":
        path.unlink()
        return
    file = os.open(path, os.O_RDWR)
    try:
        if _locked(file) is True:
            path.unlink()
    finally:
        os.close(file)


def _flush(path: Path) -> None:
    with path.open("r+b") as file:
        os.fsync(file.fileno())


def _flush_directory(directory: Path) -> None:
    if sys.platform == "win32":
        return
    file = os.open(directory, os.O_RDONLY)
    try:
        os.fsync(file)
    finally:
        os.close(file)


@contextmanager
def _complaint(directory: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise _storage_error(directory, error) from error


def _storage_error(directory: Path, error: OSError) -> StorageError:
    return StorageError(
        f"{directory} cannot be written ({error.strerror or error}); expected a directory with "
        "permission to write and free space"
    )
