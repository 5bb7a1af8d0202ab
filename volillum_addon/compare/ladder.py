"""Settings from fast to accurate, climbed as far as the budget reaches."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from .table import seconds

# From one rung to the next the seconds grow at most this many times faster than before: models'
# ladders and the samples of the baselines are made so.
GROWTH = 4.0


def climb[Rung, Result](
    rungs: Sequence[Rung],
    take: Callable[[Rung], Result],
    spent: Callable[[Result], float],
    repeats: int,
    budget: float,
) -> list[Result | str]:
    """The results of the rungs, fast to slow; in the place of one that would take longer than
    `budget` seconds, and of all after it, the reason why it was left out.

    `spent(result)` are the seconds of one measurement of a rung, `repeats` how many of it the next
    one needs at least. What a rung takes is continued from the two before it, so that seconds that
    all rungs share are not multiplied; the second is tried wherever the first was within budget.
    """
    results: list[Result | str] = []
    last = expected = 0.0
    for number, rung in enumerate(rungs):
        if repeats * expected > budget:
            results.append(
                f"would take about {seconds(repeats * expected)}; the budget is {seconds(budget)}"
            )
            last, expected = expected, expected + GROWTH * max(expected - last, 0.0)
            continue
        result = take(rung)
        results.append(result)
        taken = spent(result)
        expected = taken + (GROWTH * max(taken - last, 0.0) if number else 0.0)
        last = taken
    return results
