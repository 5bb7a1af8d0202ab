"""The wording of every complaint: what was found, what was expected, where."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

# A length within the rounding of normalising (a few float64 epsilons) is 1.
UNIT_SLACK = 1e-15


class InputError(ValueError):
    """The input is not usable; the message is one line for a person to read."""


def bad(what: str, found: object, expected: str, where: str = "") -> InputError:
    """`what` is `found`; expected `expected` (`where`)."""
    place = f" ({where})" if where else ""
    return InputError(f"{what} is {found}; expected {expected}{place}")


def bad_voxels(what: str, kind: str, wrong: NDArray[np.bool_], expected: str) -> InputError:
    """`what` holds 12 NaN voxels, first at (3, 0, 7); expected ..."""
    first = tuple(int(index) for index in np.argwhere(wrong)[0])
    count = int(np.count_nonzero(wrong))
    noun = "voxel" if count == 1 else "voxels"
    return InputError(f"{what} holds {count} {kind} {noun}, first at {first}; expected {expected}")


def number(what: str, value: float, minimum: float, maximum: float, unit: str = "") -> float:
    """`value` as a float in [minimum, maximum], or an InputError."""
    try:
        result = float(value)
    except (TypeError, ValueError):
        raise bad(what, repr(value), "a number") from None
    if not (minimum <= result <= maximum):
        raise bad(what, f"{result:g}", f"{minimum:g} to {maximum:g}{' ' + unit if unit else ''}")
    return result


def vector(what: str, value: ArrayLike) -> NDArray[np.float64]:
    """`value` as three finite float64 numbers."""
    result = np.asarray(value, dtype=np.float64)
    if result.shape != (3,) or not np.all(np.isfinite(result)):
        raise bad(what, np.array2string(result, threshold=8), "three finite numbers")
    return result


def unit_vector(what: str, value: ArrayLike) -> NDArray[np.float64]:
    """`value` normalised; a zero vector is refused. Normalising again changes no bit."""
    result = vector(what, value)
    length = math.sqrt(float(result @ result))
    if length < 1e-30:
        raise bad(what, "a zero vector", "a direction")
    return result if abs(length - 1) < UNIT_SLACK else result / length


def colour(what: str, value: ArrayLike | float) -> NDArray[np.float64]:
    """`value` as RGB float64; one number is grey; negative or non-finite values are refused."""
    result = np.broadcast_to(np.asarray(value, dtype=np.float64), (3,)).copy()
    if not np.all(np.isfinite(result)) or np.any(result < 0):
        raise bad(what, np.array2string(result), "finite values of at least 0")
    return result


def choice(what: str, value: str, choices: Sequence[str]) -> str:
    """`value` if it is one of `choices`."""
    if value not in choices:
        raise bad(what, repr(value), "one of " + ", ".join(choices))
    return value
