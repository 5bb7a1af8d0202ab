"""What to bake for a requested error, or in a given time: the choice among predictions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from .predict import Prediction, Predictions

# A predicted error counts as this much larger, and by this many of its standard errors: predictions
# at the models' own limits were up to this much too small (docs/recommendations.md).
ERROR_MARGIN, NOISE_MARGIN = 1.15, 2.0
# A predicted time counts as this many times longer.
TIME_MARGIN = 1.5
# What no coarse run sees: the display's march through the grids, and how far a photon run on half
# the spacing and Cycles' march are from each other (1.3 % on the coarsest volume of the gallery).
FLOOR = 0.013
# Errors that are answered where nothing is asked for.
USUAL_ERRORS = (0.2, 0.1, 0.05, 0.02, 0.01)


@dataclass(frozen=True)
class Request:
    """The largest total error after exposure (a share, not percent), the most seconds of bake and
    hand-over, or both."""

    error: float | None = None
    seconds: float | None = None


def recommended(entries: Sequence[Prediction], request: Request) -> Prediction | None:
    """The fastest setting that keeps the error; without one, the most accurate that keeps the time.
    None: no model can."""
    able = [
        each
        for each in entries
        if (request.seconds is None or each.seconds * TIME_MARGIN <= request.seconds)
        and (request.error is None or cautious(each) <= request.error)
    ]
    if not able:
        return None
    if request.error is not None:
        return min(able, key=lambda each: (each.seconds, each.error))
    return min(able, key=lambda each: (cautious(each), each.seconds))


def cautious(each: Prediction) -> float:
    """The error that a prediction is trusted to stay below."""
    image = each.error * ERROR_MARGIN + NOISE_MARGIN * each.noise
    return float((image**2 + FLOOR**2) ** 0.5)


def usual(found: Predictions) -> tuple[tuple[Request, Prediction | None], ...]:
    """Answers to what is asked most."""
    requests = [Request(error=error) for error in USUAL_ERRORS]
    return tuple((request, recommended(found.entries, request)) for request in requests)
