"""The parts of a plot as inline SVG: no library, any theme.

Colours and fonts come from plot.css and the page's palette, so that plots follow light and dark;
`standalone` puts the light palette in, for files of their own.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

from .metrics import Figure

STYLE = Path(__file__).with_name("plot.css")
PALETTE = Path(__file__).with_name("page.html")
# Colours of series, one after another.
COLOURS = 7
# Least distance of two labels.
LINE = 17


@dataclass(frozen=True)
class Axis:
    """An axis from `low` to `high`, drawn from pixel `begin` to `end`; logarithmic unless told."""

    low: float
    high: float
    begin: float
    end: float
    logarithmic: bool = True

    def place(self, value: float) -> float:
        """The pixel of a value, kept inside the axis."""
        inside = min(max(value, self.low), self.high)
        if self.logarithmic:
            share = math.log(inside / self.low) / math.log(self.high / self.low)
        else:
            share = (inside - self.low) / (self.high - self.low)
        return self.begin + share * (self.end - self.begin)

    def ticks(self) -> Iterator[float]:
        """1, 2, 5 times powers of ten; powers alone on long axes. On a linear axis 4 to 10 steps
        of such a size."""
        if not self.logarithmic:
            span = self.high - self.low
            power = 10.0 ** math.floor(math.log10(span / 4))
            step = next(s * power for s in (5, 2, 1) if s * power <= span / 4)
            for number in range(math.ceil(self.low / step), math.floor(self.high / step) + 1):
                yield number * step
            return
        steps = (1, 2, 5) if self.high / self.low < 1000 else (1,)
        for exponent in range(
            math.floor(math.log10(self.low)), math.ceil(math.log10(self.high)) + 1
        ):
            for one in steps:
                value = one * 10.0**exponent
                if self.low <= value <= self.high:
                    yield value


def svg(width: float, height: float, words: str, parts: Sequence[str]) -> str:
    """The <svg> element; `words` say to those who do not see it what it shows."""
    return (
        f'<svg viewBox="0 0 {width:g} {height:g}" role="img" class="plot" '
        f'aria-label="{escape(words)}">' + "".join(parts) + "</svg>"
    )


def grid(x: Axis, y: Axis, across: str, up: str, percent: bool = True) -> Iterator[str]:
    """Lines and numbers of both axes, and what they are; `percent` of y."""
    low, high = max(y.begin, y.end), min(y.begin, y.end)
    for value in x.ticks():
        at = x.place(value)
        yield path("grid", f"M{at:.1f} {high:.1f}V{low:.1f}")
        yield text(at, low + 18, f"{value:g}", "middle")
    for value in y.ticks():
        at = y.place(value)
        yield path("grid", f"M{x.begin:.1f} {at:.1f}H{x.end:.1f}")
        yield text(x.begin - 8, at + 4, f"{100 * value if percent else value:.4g}", "end")
    yield text((x.begin + x.end) / 2, low + 40, across, "middle")
    yield (
        f'<text text-anchor="middle" transform="translate(16 {(low + high) / 2:g}) rotate(-90)">'
        f"{escape(up)}</text>"
    )


def path(kind: str, steps: str) -> str:
    """A line of the classes `kind`."""
    return f'<path class="{kind}" d="{steps}"/>'


def polyline(kind: str, points: Sequence[tuple[float, float]]) -> str:
    """A line through points."""
    return path(kind, "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in points))


def text(x: float, y: float, words: str, anchor: str = "start", kind: str = "") -> str:
    """Words beside a point."""
    place = f'x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}"'
    return f'<text {place} class="{kind}">{escape(words)}</text>'


def mark(shape: str, x: float, y: float, kind: str, size: float = 5) -> str:
    """A circle, square or diamond, of the classes `kind`."""
    if shape == "circle":
        return f'<circle class="{kind}" cx="{x:.1f}" cy="{y:.1f}" r="{size:g}"/>'
    r = size * (0.9 if shape == "square" else 1.25)
    steps = (
        f"M{x - r:.1f} {y - r:.1f}h{2 * r:.1f}v{2 * r:.1f}h{-2 * r:.1f}z"
        if shape == "square"
        else f"M{x:.1f} {y - r:.1f}l{r:.1f} {r:.1f}l{-r:.1f} {r:.1f}l{-r:.1f} {-r:.1f}z"
    )
    return path(kind, steps)


def noise_bar(axis: Axis, across: float, error: Figure, upright: bool = True) -> str:
    """A figure's standard error as a bar along `axis`, or the arrow of a bound downward."""
    at = axis.place(error.relative_rmse)
    low = axis.low if error.is_bound else max(error.relative_rmse - error.noise, axis.low)
    ends = [axis.place(low)] + ([] if error.is_bound else
                                [axis.place(error.relative_rmse + error.noise)])  # fmt: skip
    if error.is_bound:
        end = ends[0]
        steps = (
            f"M{across:.1f} {at:.1f}V{end:.1f}m-4 -6l4 6l4 -6"
            if upright
            else f"M{at:.1f} {across:.1f}H{end:.1f}m6 -4l-6 4l6 4"
        )
    elif upright:
        steps = f"M{across:.1f} {ends[0]:.1f}V{ends[1]:.1f}" + "".join(
            f"M{across - 4:.1f} {end:.1f}h8" for end in ends
        )
    else:
        steps = f"M{ends[0]:.1f} {across:.1f}H{ends[1]:.1f}" + "".join(
            f"M{end:.1f} {across - 4:.1f}v8" for end in ends
        )
    return path("bar", steps)


def apart(heights: Sequence[float], low: float, high: float) -> list[float]:
    """Labels' heights moved as little as it takes for no two to be closer than a line, between
    `low` and `high` as far as they fit."""
    order = sorted(range(len(heights)), key=heights.__getitem__)
    groups: list[tuple[list[float], float]] = []  # wishes, and where the first of them stands
    for index in order:
        wishes, start = [heights[index]], heights[index]
        while groups and start < groups[-1][1] + LINE * len(groups[-1][0]):
            wishes = groups.pop()[0] + wishes
            start = sum(wish - LINE * place for place, wish in enumerate(wishes)) / len(wishes)
        groups.append((wishes, start))
    placed = [start + LINE * place for wishes, start in groups for place in range(len(wishes))]
    for place, at in enumerate(placed):
        placed[place] = max(at, low + LINE * place)
    for place in reversed(range(len(placed))):
        placed[place] = min(placed[place], high - LINE * (len(placed) - 1 - place))
    result = [0.0] * len(heights)
    for index, at in zip(order, placed, strict=True):
        result[index] = at
    return result


def standalone(element: str) -> str:
    """The element as an SVG file of its own, in the light palette, on white."""
    palette = PALETTE.read_text(encoding="utf-8").partition(":root {")[2].partition("}")[0]
    colours = dict(re.findall(r"--([\w-]+): ([^;]+);", palette)) | {"paper": "#ffffff"}
    style = re.sub(
        r"var\(--([\w-]+)\)",
        lambda found: colours[found[1]],
        STYLE.read_text(encoding="utf-8").replace("width: 100%; height: auto; ", ""),
    )
    width, height = re.findall(r'viewBox="0 0 (\S+) (\S+)"', element)[0]
    opening = f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" '
    head, _, body = element.partition(">")
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        f"{head.replace('<svg ', opening)}><style>{style}</style>"
        f'<rect width="{width}" height="{height}" fill="#ffffff"/>{body}\n'
    )
