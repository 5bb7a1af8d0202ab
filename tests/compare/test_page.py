"""report.html: well-formed, self-contained, and right in a real browser."""

import html
import json
import re
import shutil
import subprocess
from html.parser import HTMLParser
from pathlib import Path

import pytest
from comparisons import synthetic_comparison
from expected_skips import skip

from volillum_addon.compare import table
from volillum_addon.compare.page import page
from volillum_addon.compare.plot import LINE, Axis, _apart
from volillum_addon.compare.results import Comparison

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
# Run in the page: decode every image, sort by two columns, and leave what was found in the page.
PROBE = """
<script>
const complaints = [];
addEventListener("error", event => complaints.push(String(event.message)));
addEventListener("load", () => {
  const headers = [...document.querySelectorAll("#table thead th")];
  const order = () => [...document.querySelectorAll("#table tbody tr")]
    .map(row => row.cells[0].innerText.trim());
  const header = name => headers.find(one => one.innerText.trim().startsWith(name));
  const press = name => {
    const button = header(name).querySelector("button");
    button.focus();
    button.click();
    return document.activeElement === button;
  };
  const opaque = image => {
    const canvas = document.createElement("canvas");
    canvas.width = image.naturalWidth;
    canvas.height = image.naturalHeight;
    const context = canvas.getContext("2d");
    context.drawImage(image, 0, 0);
    const pixels = context.getImageData(0, 0, canvas.width, canvas.height).data;
    return pixels.every((value, index) => index % 4 < 3 || value === 255);
  };
  const images = [...document.images];
  const found = {
    images: images.length,
    painted: images.filter(image => image.complete && opaque(image)).length,
    wide: document.documentElement.scrollWidth > innerWidth,
    focused: press("Total error"),
    ascending: order(),
    sort: header("Total error").getAttribute("aria-sort"),
  };
  press("Total error");
  found.descending = order();
  press("Model");
  found.byName = order();
  found.resources = performance.getEntriesByType("resource")
    .map(entry => entry.name).filter(name => !name.startsWith("data:"));
  found.complaints = complaints;
  const result = document.createElement("script");
  result.type = "application/json";
  result.id = "found";
  result.textContent = JSON.stringify(found);
  document.body.append(result);
});
</script>
"""


@pytest.fixture(scope="module")
def comparison() -> Comparison:
    return synthetic_comparison()


class Reader(HTMLParser):
    """Collects addresses and checks that elements are closed in order."""

    VOID = ("meta", "link", "img", "br")
    SVG_ENDED = ("line", "circle", "path")

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


@pytest.mark.parametrize("width", [1280, 420])
def test_a_browser_shows_it(comparison: Comparison, tmp_path: Path, width: int) -> None:
    browser = next((path for path in map(shutil.which, BROWSERS) if path), None)
    if browser is None:
        skip("browser")
    path = tmp_path / "report.html"
    path.write_text(page(comparison).replace("<head>", "<head>" + PROBE, 1), encoding="utf-8")
    run = subprocess.run(
        [browser, "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
         "--disable-background-networking", "--disable-component-update", "--disable-sync",
         "--enable-logging=stderr", "--v=0", f"--user-data-dir={tmp_path / 'profile'}",
         f"--window-size={width},900", "--dump-dom", path.as_uri()],
        capture_output=True, text=True, timeout=60, check=True,
    )  # fmt: skip
    assert "CONSOLE" not in run.stderr, [
        line for line in run.stderr.splitlines() if "CONSOLE" in line
    ]
    held = re.search(r'<script type="application/json" id="found">(.*?)</script>', run.stdout)
    assert held is not None, run.stdout[-500:]
    found = json.loads(held[1])
    assert found["complaints"] == []
    assert found["resources"] == []
    assert found["painted"] == found["images"] == 3 + 6 * len(comparison.measured)
    assert not found["wide"], "the page is wider than the window"
    errors = {m.label: f.errors["total"].relative_rmse for m, f in comparison.measured}
    ascending = sorted(errors, key=lambda label: errors[label])
    assert found["ascending"] == ascending
    assert found["descending"] == ascending[::-1]
    assert found["byName"] == sorted(errors)
    assert found["sort"] == "ascending"
    assert found["focused"]


def test_labels_of_close_points_do_not_overlap() -> None:
    moved = _apart([100.0, 102.0, 40.0, 101.0])
    assert moved[2] == 40
    assert moved[0] == 100
    assert sorted(moved) == [40, 100, 100 + LINE, 100 + 2 * LINE]


def test_axes_place_and_tick_logarithmically() -> None:
    axis = Axis(0.1, 10.0, 0.0, 100.0)
    assert [axis.place(value) for value in (0.1, 1.0, 10.0, 99.0)] == [0, 50, 100, 100]
    assert list(axis.ticks()) == pytest.approx([0.1, 0.2, 0.5, 1, 2, 5, 10])
    assert list(Axis(0.001, 100.0, 0, 1).ticks()) == pytest.approx([0.001, 0.01, 0.1, 1, 10, 100])
