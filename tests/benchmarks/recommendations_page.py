"""The page about the recommendations: every request in every scene, and what its answer cost."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from volillum_addon.compare.predict import Prediction
from volillum_addon.compare.recommend import Request, recommended

REQUESTS = (
    *(Request(error=error) for error in (0.3, 0.2, 0.1, 0.05, 0.03, 0.02, 0.01)),
    *(Request(seconds=seconds) for seconds in (0.5, 2.0, 10.0)),
)
UNREACHABLE = "unreachable"

# One measured setting: seconds, error, noise, is_bound.
Row = Mapping[str, Any]


def key(each: Prediction) -> str:
    """One name for a setting."""
    return f"{each.model} {json.dumps(dict(each.parameters), sort_keys=True)}"


@dataclass(frozen=True, eq=False)
class Found:
    """One scene: what was foreseen, and by setting what was measured."""

    name: str
    unseen: bool
    summary: str
    voxels: Sequence[int]
    foreseeing_seconds: float
    reference_noise: float
    entries: Sequence[Prediction]
    rows: Mapping[str, Row]


@dataclass(frozen=True)
class Case:
    """One request in one scene: whether it was met, and what that cost beside the best choice.

    `in_doubt`: the verdict would be another if the figure it hangs on were a standard error better
    or worse.
    """

    scene: str
    unseen: bool
    request: Request
    answer: str
    mine: Row | None
    met: bool
    in_doubt: bool
    best: str
    best_row: Row | None

    @property
    def asked(self) -> str:
        """The request in words."""
        if self.request.error is not None:
            return f"{100 * self.request.error:g} %"
        return f"{self.request.seconds:g} s"


def meets(row: Row, request: Request, doubt: float = 0.0) -> bool:
    """Whether a setting keeps the request, with so many standard errors in its favour."""
    if request.error is not None:
        # A bound is what the error certainly stays below; it may be anything less.
        noise = row["noise"] if not row["is_bound"] else row["error"] if doubt > 0 else 0.0
        return bool(row["error"] - doubt * noise <= request.error)
    return bool(row["seconds"] <= request.seconds)


def cases(found: Found) -> Iterator[Case]:
    """The requests of one scene."""
    for request in REQUESTS:
        answer = recommended(found.entries, request)
        measure = "seconds" if request.error is not None else "error"
        able = {name: row for name, row in found.rows.items() if meets(row, request)}
        best = min(able, key=lambda name: able[name][measure], default=UNREACHABLE)
        mine = None if answer is None else found.rows[key(answer)]
        # The benefit of the doubt goes to the answer, whichever it is.
        verdicts = [
            meets(mine, request, doubt) if mine is not None
            else not any(meets(row, request, -doubt) for row in found.rows.values())
            for doubt in (1.0, -1.0)
        ]  # fmt: skip
        yield Case(
            found.name,
            found.unseen,
            request,
            UNREACHABLE if answer is None else key(answer),
            mine,
            verdicts[0],
            verdicts[0] != verdicts[1],
            best,
            able.get(best),
        )


def page(scenes: Sequence[Found], unmeasured: Sequence[str]) -> str:
    """docs/recommendations.md; `unmeasured` are the scenes it lacks."""
    found = [case for scene in scenes for case in cases(scene)]
    doubtful = sum(case.in_doubt for case in found)
    lines = [
        "# How good the recommendations are",
        "",
        "`volillum analyse` foresees every model's time and error from bakes on two coarse grids "
        "and recommends a setting. Here each is then baked and judged against Cycles' full "
        "scattering; `make recommendations` writes this page. A request is met when the total "
        "error after exposure stays below the requested one, when bake and hand-over stay below "
        "the requested seconds, or when nothing that was measured meets it and the answer is "
        f"`unreachable`; all within one standard error of the measured figure ({doubtful} of "
        f"{len(found)} verdicts hang on that). The goal is nine of ten. The margins were set on "
        "the gallery; the other volumes were not looked at before. Seconds are of a machine that "
        "did other work too. Compositions are tried where they are foreseen to be best."
        # Nobody shall take the page for all of them.
        + (f" Not measured yet: {', '.join(unmeasured)}." if unmeasured else ""),
        "",
        "| | requests | met |",
        "| --- | --- | --- |",
    ]
    for label, chosen in (
        ("gallery", [case for case in found if not case.unseen]),
        ("unseen volumes", [case for case in found if case.unseen]),
        ("errors asked", [case for case in found if case.request.error is not None]),
        ("seconds asked", [case for case in found if case.request.error is None]),
        ("all", found),
    ):
        met = sum(case.met for case in chosen)
        share = f" ({100 * met / len(chosen):.0f} %)" if chosen else ""
        lines.append(f"| {label} | {len(chosen)} | {met}{share} |")
    lines += ["", *foreseen(scenes), "", *missed(found), "", *table(scenes, found)]
    return "\n".join(lines) + "\n"


def foreseen(scenes: Sequence[Found]) -> list[str]:
    """How far predictions are off."""
    errors, times = [], []
    for scene in scenes:
        for each in scene.entries:
            row = scene.rows.get(key(each))
            if row is None:
                continue
            if not row["is_bound"] and each.error > 0:  # 0: below the noise of foreseeing
                errors.append(row["error"] / each.error)
            times.append(row["seconds"] / each.seconds)
    words = []
    for label, ratios in (("errors", errors), ("seconds", times)):
        low, middle, high = np.quantile(ratios, (0.05, 0.5, 0.95))
        words.append(
            f"Measured {label} are {middle:.2f} times the foreseen ones in the median, "
            f"{low:.2f} to {high:.2f} times in nine of ten ({len(ratios)} settings)."
        )
    seconds = [scene.foreseeing_seconds for scene in scenes]
    words.append(f"Foreseeing took {min(seconds):.0f} to {max(seconds):.0f} s a scene.")
    return words


def missed(found: Sequence[Case]) -> list[str]:
    """The requests that were not met, and why."""
    lines = ["## Not met", ""]
    for case in found:
        if not case.met:
            have = ""
            if case.mine is not None:
                have = f" ({percent(case.mine)}, {case.mine['seconds']:.2f} s)"
            lines.append(f"* {case.scene}, {case.asked}: {case.answer}{have}; best: {case.best}")
    return lines if len(lines) > 2 else [*lines, "None."]


def table(scenes: Sequence[Found], found: Sequence[Case]) -> list[str]:
    """Every request beside the best possible choice."""
    lines = ["## All requests", ""]
    lines += ["The best choice is the fastest measured setting that meets an error, or the most "
              "accurate one that meets a time; cost is the ratio of the seconds (of the errors "
              "where seconds were asked).", ""]  # fmt: skip
    for scene in scenes:
        size = " x ".join(map(str, scene.voxels))
        kind = ", unseen" if scene.unseen else ""
        lines += [f"### {scene.name}{kind}", "", f"{scene.summary} {size} voxels; noise of the "
                  f"reference {100 * scene.reference_noise:.3g} %.", "",
                  "| asked | answer | error | seconds | met | best | cost |",
                  "| --- | --- | --- | --- | --- | --- | --- |"]  # fmt: skip
        for case in (each for each in found if each.scene == scene.name):
            seconds = "" if case.mine is None else f"{case.mine['seconds']:.2f}"
            verdict = ("yes" if case.met else "**no**") + (", in doubt" if case.in_doubt else "")
            lines.append(
                f"| {case.asked} | {short(case.answer)} | {percent(case.mine)} | {seconds} | "
                f"{verdict} | {short(case.best)} | {cost(case)} |"
            )
        lines.append("")
    return lines


def cost(case: Case) -> str:
    """The recommended setting's seconds (or error) over the best one's."""
    if case.mine is None or case.best_row is None or not case.met:
        return ""
    measure = "seconds" if case.request.error is not None else "error"
    return f"{case.mine[measure] / case.best_row[measure]:.2f}"


def short(setting: str) -> str:
    """A setting without the punctuation of JSON."""
    return setting.replace('"', "").replace("{", "").replace("}", "").replace(": ", "=").strip()


def percent(row: Row | None) -> str:
    """A setting's measured error."""
    if row is None:
        return ""
    if row["is_bound"]:
        return f"< {100 * row['error']:.2g} %"
    return f"{100 * row['error']:.3g} ± {100 * row['noise']:.1g} %"
