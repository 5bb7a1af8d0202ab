"""Which exceptions are answers to a person, and how they read: one line."""

from __future__ import annotations

from ..core.errors import InputError

# The input, the disk or the memory; all else is a fault of the program and keeps its traceback.
EXPECTED = (InputError, OSError, MemoryError)


def one_line(error: BaseException) -> str:
    """The error as one line."""
    if isinstance(error, MemoryError):
        return f"the memory is exhausted ({error}); expected room for the grids of this bake"
    if isinstance(error, OSError) and error.filename is not None and error.strerror:
        return f"{error.filename}: {error.strerror}"
    return " ".join(str(error).split()) or type(error).__name__
