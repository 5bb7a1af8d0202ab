"""What a file holds, before its voxels are read."""

from __future__ import annotations

import difflib
import io
import logging
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import override

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.control import Cancelled
from ..core.errors import InputError, bad

# Numbers of any real type, [i, j, k].
Slab = NDArray[np.generic]
# Anatomical worlds and how each becomes the one used here: x to the patient's left, y to the back,
# z to the head (DICOM's). In Blender's front view a patient then stands upright and faces us.
TO_LPS = {"LPS": (1, 1, 1), "RAS": (-1, -1, 1), "LAS": (1, -1, 1)}
# No stream of these formats unpacks to more than this times its length (deflate 1032, TIFF's LZW
# 2730), give or take a short one: a header that claims more is lying.
MOST_UNPACKED, SHORT_FILE = 3000, 1 << 12
# Positions beyond this are a damaged header.
FARTHEST = 1e12
# Longest edge of a volume in voxels: more is a damaged header.
LONGEST = 1 << 20


@dataclass(frozen=True)
class RawLayout:
    """How the bytes of a file without a header are to be read; lengths in `length_unit`.

    `direction`: the world directions of the axes i, j, k, one after another. `axes` names them from
    the fastest to the slowest: "xyz" as in most files, "zyx" for C-ordered [x, y, z] arrays.
    """

    shape: tuple[int, int, int]
    dtype: np.dtype[np.generic]
    offset: int = 0
    spacing: tuple[float, float, float] = (1.0, 1.0, 1.0)
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    direction: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
    axes: str = "xyz"
    slope: float = 1.0
    intercept: float = 0.0
    unit: str = ""
    length_unit: str = ""
    kind: str = ""


@dataclass(frozen=True)
class Options:
    """What of a file is wanted: a channel (or time step) of several, a grid of a VDB file, and the
    layout of a file that does not tell its own."""

    channel: int | None = None
    grid: str | None = None
    raw: RawLayout | None = None


@dataclass(frozen=True, eq=False)
class Source:
    """A volume of `shape` voxels and what its file says of it.

    `slabs(depth)` yields its voxels in order of k, each at most `depth` layers thick, as numbers
    of the data's own unit. `kind` is what made it ("ct", "mr", "microscopy", "simulation",
    "cloud"), `unit` that of the values, `length_unit` that of `index_to_world`; empty where the
    file does not say. `space` is "LPS" where the world is a patient's.
    """

    path: Path
    format: str
    shape: tuple[int, int, int]
    index_to_world: NDArray[np.float64]
    dtype: np.dtype[np.generic]
    slabs: Callable[[int], Iterator[Slab]]
    kind: str = ""
    unit: str = ""
    length_unit: str = ""
    space: str = ""
    notes: tuple[str, ...] = field(default=())

    def __post_init__(self) -> None:
        check_shape(self.shape, self.path)
        check_number_type(self.dtype, self.path)
        if not np.all(np.abs(self.index_to_world) <= FARTHEST):
            raise bad("the position of its voxels", "no number or beyond all measure",
                      f"at most {FARTHEST:g} from the origin", str(self.path))  # fmt: skip


# Libraries that log what they think of a file.
LOGGERS = ("nibabel.global", "pydicom", "tifffile")


class Complaints(logging.Filter):
    """Keeps a logger silent and remembers what it would have said of errors."""

    def __init__(self) -> None:
        super().__init__()
        self.errors: list[str] = []

    @override
    def filter(self, record: logging.LogRecord) -> bool:
        if record.levelno >= logging.ERROR:
            self.errors.append(record.getMessage())
        return False


class BoundedFile(io.BufferedReader):
    """A file of which no more is asked than there is: reading a length that a damaged header names
    would allocate it first."""

    def __init__(self, path: Path) -> None:
        super().__init__(io.FileIO(path))
        self._bytes = path.stat().st_size

    @override
    def read(self, size: int | None = -1, /) -> bytes:
        left = max(self._bytes - self.tell(), 0)
        return super().read(left if size is None or size < 0 else min(size, left))


@contextmanager
def library(path: Path, expected: str) -> Iterator[Complaints]:
    """Word whatever a library raises on a damaged file, and keep its warnings to itself."""
    complaints = Complaints()
    loggers = [logging.getLogger(name) for name in LOGGERS]
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            for logger in loggers:
                logger.addFilter(complaints)
            yield complaints
    except (InputError, Cancelled):
        raise
    except Exception as error:
        raise unreadable(path, error, expected) from error
    finally:
        for logger in loggers:
            logger.removeFilter(complaints)


def unreadable(path: Path, error: BaseException, expected: str) -> InputError:
    """`path` cannot be read (why); expected ..."""
    reason = getattr(error, "strerror", None) or " ".join(str(error).split())
    return InputError(
        f"{path} cannot be read ({reason[:200] or type(error).__name__}); expected {expected}"
    )


def check_shape(shape: Sequence[int], path: Path) -> None:
    """Raise an InputError unless these are three sizes of a volume."""
    if len(shape) != 3 or not all(1 <= n <= LONGEST for n in shape):
        found = " x ".join(map(str, shape))
        raise bad("the volume's size", found, f"three of 1 to {LONGEST} voxels", str(path))


def check_number_type(dtype: np.dtype[np.generic], path: Path) -> None:
    """Raise an InputError unless voxels are real numbers."""
    if dtype.kind not in "iufb":
        raise bad("the type of its voxels", str(dtype), "integers or floats", str(path))


def check_unpacked(path: Path, claimed: int, packed: int) -> None:
    """Raise an InputError when `packed` bytes cannot unpack to `claimed` ones."""
    if claimed > MOST_UNPACKED * (packed + SHORT_FILE):
        raise bad(
            "its data",
            f"{packed} compressed bytes for {claimed} bytes of voxels",
            "enough of them (the header is wrong, or the file is cut off)",
            str(path),
        )


def absent(path: Path, expected: str) -> InputError:
    """`path` is not there; expected ..., with the first folder on the way that is not there, or
    what is called alike."""
    gone = next((each for each in reversed(path.parents) if not each.is_dir()), None)
    if gone is not None:
        hint = f" (there is no folder {gone})"
    elif any(mark in path.name for mark in "*?%$"):
        hint = " (a sequence's number is written with #, as in smoke_####.vdb)"
    else:
        there: list[str] = []
        with suppress(OSError):
            there += [each.name for each in path.parent.iterdir()]
        alike = difflib.get_close_matches(path.name, there)
        hint = f" (did you mean {' or '.join(alike)}?)" if alike else ""
    return InputError(f"{path} is not there; expected {expected}{hint}")


def file_size(path: Path) -> int:
    """Bytes of the file; InputError where it is not there or cannot be looked at."""
    try:
        return path.stat().st_size
    except FileNotFoundError:
        raise absent(path, "a volume's file or folder") from None
    except OSError as error:
        raise unreadable(path, error, "a file") from None


def choose_channel(count: int, options: Options, path: Path, what: str = "channels") -> int:
    """Which of `count` channels (or time steps) to read: the only one, or the one asked for."""
    if options.channel is None:
        if count == 1:
            return 0
        raise bad(path.name, f"{count} {what}", f"a choice of one, 0 to {count - 1} (--channel)")
    if not 0 <= options.channel < count:
        raise bad("the channel", options.channel, f"0 to {count - 1}", str(path))
    return options.channel


def affine(
    directions: ArrayLike, spacing: ArrayLike, origin: ArrayLike, path: Path
) -> NDArray[np.float64]:
    """Index to world from world directions of i, j, k (rows), their spacing, voxel 0's centre."""
    result = np.eye(4)
    try:
        rows = np.asarray(directions, np.float64).reshape(3, 3)
        with np.errstate(over="ignore", invalid="ignore"):  # a Source looks at the result
            result[:3, :3] = rows.T * np.asarray(spacing, np.float64).reshape(3)
        result[:3, 3] = np.asarray(origin, np.float64).reshape(3)
    except (TypeError, ValueError):
        raise bad(
            "its directions, spacing or origin",
            "incomplete",
            "nine, three and three numbers",
            str(path),
        ) from None
    return result


def to_lps(matrix: NDArray[np.float64], space: str) -> NDArray[np.float64]:
    """`matrix` of another anatomical space, turned or mirrored into LPS."""
    with np.errstate(over="ignore", invalid="ignore"):  # a Source looks at the result
        turned: NDArray[np.float64] = np.diag([*TO_LPS[space], 1]) @ matrix
    return turned
