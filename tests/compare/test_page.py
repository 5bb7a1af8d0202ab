"""report.html: well-formed, self-contained, and right in a real browser."""

import html
import re
from html.parser import HTMLParser
from itertools import pairwise
from xml.etree import ElementTree

import browser
import pytest
from browser import Browser
from comparisons import synthetic_comparison
from expected_skips import skip

from volillum_addon.compare import table
from volillum_addon.compare.figures import summary
from volillum_addon.compare.page import page
from volillum_addon.compare.plot import LINE, Axis, apart, standalone
from volillum_addon.compare.plots import all_plots
from volillum_addon.compare.results import Comparison

# What a page tells of itself, run in it.
PICTURES = """
const opaque = image => {
  const canvas = document.createElement("canvas");
  [canvas.width, canvas.height] = [image.naturalWidth, image.naturalHeight];
  const context = canvas.getContext("2d");
  context.drawImage(image, 0, 0);
  const pixels = context.getImageData(0, 0, canvas.width, canvas.height).data;
  return pixels.every((value, index) => index % 4 < 3 || value === 255);
};
return [document.images.length, [...document.images].filter(i => i.complete && opaque(i)).length];
"""
# Pairs of words of one plot that touch, as a person sees them.
TOUCHING = """
const found = [];
for (const plot of document.querySelectorAll("svg.plot")) {
  const texts = [...plot.querySelectorAll("text")]
    .map(text => [text, text.getBoundingClientRect()]);
  const frame = plot.getBoundingClientRect();
  for (const [text, box] of texts) {
    if (box.left < frame.left - 1 || box.right > frame.right + 1) found.push(text.textContent);
  }
  texts.forEach(([one, a], index) => texts.slice(index + 1).forEach(([other, b]) => {
    if (a.left < b.right && b.left < a.right && a.top + 3 < b.bottom && b.top + 3 < a.bottom)
      found.push(one.textContent + " | " + other.textContent);
  }));
}
return found;
"""
# WCAG contrast of the words, links and series with the paper.
CONTRAST = """
const light = colour => {
  const linear = colour.match(/[0-9.]+/g).slice(0, 3).map(v => v / 255)
    .map(v => v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
  return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2];
};
const paper = light(getComputedStyle(document.body).backgroundColor);
const contrast = element => {
  const own = light(getComputedStyle(element).color);
  return (Math.max(own, paper) + 0.05) / (Math.min(own, paper) + 0.05);
};
const least = selector => Math.min(...[...document.querySelectorAll(selector)].map(contrast));
return {paper, words: least("p, th, td, summary, figcaption, dd, dt"), series: least(".dot")};
"""
ORDER = """
return [...document.querySelectorAll(`#${arguments[0]} tbody tr`)]
  .map(row => row.cells[0].innerText.trim());
"""
FOCUS = """
const headers = [...document.querySelectorAll("#table thead th")];
const header = headers.find(one => one.innerText.trim().startsWith(arguments[0]));
headers[headers.indexOf(header) - 1].querySelector("button").focus();
"""
FOCUSED = """
const place = document.activeElement;
return [place.innerText.trim(), place.parentElement.getAttribute("aria-sort"),
        getComputedStyle(place).outlineStyle];
"""


@pytest.fixture(scope="module")
def comparison() -> Comparison:
    return synthetic_comparison()


class Reader(HTMLParser):
    """Collects addresses and checks that elements are closed in order."""

    VOID = ("meta", "link", "img", "br")
    SVG_ENDED = ("circle", "image", "path")

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.addresses: list[str] = []
        self.alternatives: list[str | None] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        self.addresses += [given[name] or "" for name in ("src", "href") if name in given]
        if tag == "img":
            self.alternatives.append(given.get("alt"))
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        assert tag in self.SVG_ENDED

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def test_the_page_is_well_formed_and_loads_nothing(comparison: Comparison) -> None:
    text = page(comparison)
    reader = Reader()
    reader.feed(text)
    assert reader.open == []
    assert all(address.startswith("data:") for address in reader.addresses)
    assert all(reader.alternatives)
    assert "@import" not in text
    assert not re.search(r"url\((?!data:)", text)


def test_names_are_escaped(comparison: Comparison) -> None:
    text = page(comparison)
    assert "<b>" not in text
    assert "ball &lt;b&gt; &amp; co" in text
    assert "leaves out &lt;the sky&gt;" in text


def test_every_figure_stands_on_the_page_with_its_noise(comparison: Comparison) -> None:
    text = html.unescape(page(comparison))
    for model, found in comparison.measured:
        assert model.citation in text
        for figure in found.errors.values():
            assert table.percent(figure) in text
    for model in comparison.models:
        assert model.reason is None or model.reason in text


@pytest.fixture(scope="module")
def address(comparison: Comparison, tmp_path_factory: pytest.TempPathFactory) -> str:
    """The page as a file's address."""
    if browser.found() is None:
        skip("browser")
    path = tmp_path_factory.mktemp("page") / "report.html"
    path.write_text(page(comparison), encoding="utf-8")
    return path.as_uri()


@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
@pytest.mark.parametrize("width", [1280, 390])
def test_a_browser_shows_it(comparison: Comparison, address: str, width: int, dark: bool) -> None:
    with Browser(width, dark=dark) as window:
        window.open(address)
        assert window.complaints() == []
        resources = window.run("return performance.getEntriesByType('resource').map(e => e.name)")
        assert all(name.startswith("data:") for name in resources)
        baselines = [entry for entry in comparison.baselines if entry.measured is not None]
        pictures = 3 + 6 * len(comparison.measured) + len(baselines)
        assert window.run(PICTURES) == [pictures, pictures]
        assert window.run("return document.querySelectorAll('svg.plot').length") == 3
        assert window.run(TOUCHING) == []
        assert window.run("return document.documentElement.scrollWidth") <= width
        wide = "return [...document.querySelectorAll('.scroll')].map(e => e.scrollWidth)"
        room = wide.replace("scrollWidth", "clientWidth")
        if width == 1280:
            assert window.run(wide) == window.run(room), "a table needs sideways scrolling"
        contrast = window.run(CONTRAST)
        assert (contrast["paper"] < 0.1) == dark
        assert contrast["words"] >= 4.5
        assert contrast["series"] >= 3


def test_the_table_sorts_by_keys_and_clicks(comparison: Comparison, address: str) -> None:
    errors = {m.label: f.errors["total"].relative_rmse for m, f in comparison.measured}
    ascending = sorted(errors, key=lambda label: errors[label])
    with Browser(1280) as window:
        window.open(address)
        window.run(FOCUS, "Total error")
        window.press(browser.TAB)
        assert window.run(FOCUSED)[0] == "Total error, %"
        window.press(browser.ENTER)
        assert window.run(ORDER, "table") == ascending
        name, order, outline = window.run(FOCUSED)
        assert (name, order) == ("Total error, %", "ascending")
        assert outline != "none", "the focus is not seen"
        window.press(browser.SPACE)
        assert window.run(ORDER, "table") == ascending[::-1]
        window.run("document.querySelector('#table thead button').click()")
        assert window.run(ORDER, "table") == sorted(errors)
        # Another table has its own order: what is not reached comes last.
        before = window.run(ORDER, "reach")
        window.run("document.querySelectorAll('#reach thead button')[1].click()")
        after = window.run(ORDER, "reach")
        found = summary(comparison)
        reached = [
            one.label
            for one, reaches in zip(found.series, found.reaches, strict=True)
            if reaches[0].seconds is not None
        ]
        assert sorted(after) == sorted(before)
        assert sorted(after[: len(reached)]) == sorted(reached)
        assert window.run(ORDER, "table") == sorted(errors)
        assert window.complaints() == []


def test_labels_of_close_points_do_not_overlap() -> None:
    moved = apart([100.0, 102.0, 40.0, 101.0], 0, 500)
    # As little as it takes: the three around their mean.
    assert moved == [101 - LINE, 101 + LINE, 40, 101]
    assert apart([10.0, 490.0], 0, 500) == [10, 490]
    for wishes in ([3.0, 4.0, 5.0, 6.0], [498.0, 499.0, 480.0], [0.0, 500.0, 250.0, 255.0]):
        placed = sorted(apart(wishes, 0, 500))
        assert placed[0] >= 0
        assert placed[-1] <= 500
        assert all(b - a >= LINE - 1e-9 for a, b in pairwise(placed))


def test_a_plot_of_its_own_is_an_svg_file_with_colours(comparison: Comparison) -> None:
    for name, element in all_plots(comparison).items():
        tree = ElementTree.fromstring(standalone(element))
        assert tree.tag == "{http://www.w3.org/2000/svg}svg", name
        text = ElementTree.tostring(tree, encoding="unicode")
        assert "var(" not in text
        assert "currentColor" in text  # which the classes below set
        assert ".series-0 { color: #" in text


def test_axes_place_and_tick_logarithmically() -> None:
    axis = Axis(0.1, 10.0, 0.0, 100.0)
    assert [axis.place(value) for value in (0.1, 1.0, 10.0, 99.0)] == [0, 50, 100, 100]
    assert list(axis.ticks()) == pytest.approx([0.1, 0.2, 0.5, 1, 2, 5, 10])
    linear = Axis(0.0, 37.0, 0.0, 100.0, logarithmic=False)
    assert list(linear.ticks()) == [0, 5, 10, 15, 20, 25, 30, 35]
    assert linear.place(18.5) == 50
    assert list(Axis(0.001, 100.0, 0, 1).ticks()) == pytest.approx([0.001, 0.01, 0.1, 1, 10, 100])
