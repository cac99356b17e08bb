"""The page: its points are the document's, it needs nothing else, and no name gets out of its place."""

import base64
import json
import re
import time
from html.parser import HTMLParser

import cv2
import numpy as np
import pytest

from tests.workers.reports.material import made, steady
from workers.reports.contents import contents
from workers.reports.material import FrameImage
from workers.reports.page import page
from workers.reports.plots import column, rows_of, sections_of

GROUP = r'<g id="{}-points".*?</g></g>|<g id="{}-points".*?</g>'


@pytest.fixture(scope="module")
def report():
    return contents(made())


@pytest.fixture(scope="module")
def text(report):
    return page(report)


def drawn(text: str, name: str) -> list[tuple[float, float]]:
    """SVG coordinates of the points of a plot, in their order."""
    begin = text.index(f'<g id="{name}-points"')
    figure = text[begin : text.index("</svg>", begin)]
    arrows = re.findall(r'<path d="M([-\d.]+) ([-\d.]+)L[-\d. ]+"/>', figure)
    if arrows:
        return [(float(x), float(y)) for x, y in arrows]
    href = re.search(r'<use xlink:href="#(\w+)"', figure)[1]
    return [
        (float(x), float(y)) for x, y in re.findall(rf'<use xlink:href="#{href}" x="([-\d.]+)" y="([-\d.]+)"', figure)
    ]


def test_every_point_of_every_plot_lies_where_the_document_has_it(report, text):
    plots = [plot for section in sections_of(report) for plot in section.plots if plot.y]
    # Residuals, people, maps of each model, the search, and yaw and pitch of a drive's score.
    assert len(plots) == 5 + 2 + 2 * len(report["models"]) + 1 + 2
    embedded = json.loads(re.search(r'<script type="application/json" id="data">(.*?)</script>', text, re.DOTALL)[1])
    assert embedded["pairs"] == report["pairs"] and embedded["checks"] == report["checks"]
    for plot in plots:
        rows = embedded["plots"][plot.name]
        assert rows == rows_of(plot, report)
        at = np.array(drawn(text, plot.name))
        x, y = (steady(column(report, path)) for path in (plot.x, plot.y))
        assert len(at) == (len(rows) if plot.points else len(y)), plot.name
        y = np.log(y) if plot.is_log else y
        kept = np.isfinite(x) & np.isfinite(y)
        for values, shown in ((x[kept], at[:, 0]), (y[kept], at[:, 1])):
            # Data and picture differ by a scale and a shift; the file keeps a hundredth (arrows: a tenth) of a point.
            fit = np.polyfit(values, shown, 1)
            assert np.abs(np.polyval(fit, values) - shown).max() < (0.06 if plot.to_x else 0.011), plot.name


def colours_of(values: np.ndarray, most: float) -> np.ndarray:
    """(..., 3) of the viridis palette from 0 to most, by OpenCV: red, green, blue."""
    # A palette of 256 colours: of each the values up to the next.
    level = np.clip(np.floor(256 * np.asarray(values) / most), 0, 255).astype(np.uint8)
    return cv2.applyColorMap(level, cv2.COLORMAP_VIRIDIS)[..., ::-1].reshape(*level.shape, 3).astype(int)


def test_every_cell_and_point_of_a_map_has_the_colour_of_its_number(report, text):
    for name in report["models"]:
        found = report["models"][name]
        measured = steady(found["measured_px"])
        wanted = colours_of(measured, np.nanquantile(measured, 0.98))
        for plot in (f"ground-measured-{name}", f"image-measured-{name}"):
            begin = text.index(f'<g id="{plot}-points"')
            figure = text[begin : text.index("</svg>", begin)]
            fills = re.findall(
                r'<use xlink:href="#\w+" x="[-\d.]+" y="[-\d.]+" style="fill:#([0-9a-f]{6})"/>', figure
            )
            drawn = np.array([[int(fill[i : i + 2], 16) for i in (0, 2, 4)] for fill in fills])
            assert np.abs(drawn - wanted).max() <= 3, plot
        for place in ("ground", "image"):
            table = np.array(found[place]["sigma_px"], np.float64)
            figure = re.search(rf'<figure id="plot-{place}-predicted-{name}"(.*?)</figure>', text, re.DOTALL)[1]
            # The plot's first picture is the map, the second the palette beside it. It is stored upside down.
            data = re.search(r'<image [^>]*base64,([^"]+)"[^>]*', figure)
            assert "scale(1 -1)" in data[0]
            raster = cv2.imdecode(np.frombuffer(base64.b64decode(data[1]), np.uint8), cv2.IMREAD_UNCHANGED)[::-1]
            shown = np.isfinite(table)
            # On the ground y points up, in the image v points down.
            shown, table = (shown[::-1], table[::-1]) if place == "ground" else (shown, table)
            at = [middles(shown.any(axis=1 - axis), raster.shape[axis]) for axis in (0, 1)]
            cells = np.ix_(*(cells for cells, _ in at))
            drawn = raster[np.ix_(*(pixels for _, pixels in at))].astype(int)
            assert np.array_equal(drawn[..., 3] > 0, shown[cells])
            wanted = colours_of(np.nan_to_num(table[cells]), np.nanquantile(table, 0.98))
            assert np.abs(drawn[..., 2::-1] - wanted)[shown[cells]].max() <= 3, (name, place)


def middles(used: np.ndarray, length: int) -> tuple[np.ndarray, np.ndarray]:
    """The cells from the first used one to the last, and the pixel of a picture of them that is each one's middle."""
    first, last = np.flatnonzero(used)[[0, -1]]
    cells = np.arange(first, last + 1)
    return cells, np.floor((cells - first + 0.5) * length / len(cells)).astype(int)


class Elements(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.found: list[tuple[str, dict[str, str | None]]] = []

    def handle_starttag(self, tag, attrs):
        self.found.append((tag, dict(attrs)))


def test_it_opens_without_a_network_and_names_stay_text(text):
    parser = Elements()
    parser.feed(text)
    for tag, attributes in parser.found:
        for name in ("src", "href", "xlink:href"):
            value = attributes.get(name)
            assert value is None or value.startswith(("#", "data:")), (tag, value)
    assert "@import" not in text and "url(http" not in text
    # The scripts are the data and ours: a name ends neither.
    assert [attributes.get("type") for tag, attributes in parser.found if tag == "script"] == [
        "application/json",
        None,
    ]
    assert text.count("</script>") == 2
    ids = [attributes["id"] for _, attributes in parser.found if attributes.get("id")]
    assert len(ids) == len(set(ids))


def test_every_plot_has_words_axes_with_units_and_a_place_for_the_keyboard(report, text):
    for section in sections_of(report):
        for plot in section.plots:
            figure = re.search(rf'<figure id="plot-{re.escape(plot.name)}"(.*?)</figure>', text, re.DOTALL)[1]
            assert plot.x_label in figure and plot.y_label in figure
            assert ", " in plot.x_label or plot.x_label in ("iteration", "number of the pair")
            assert "aria-label=" in figure and ('tabindex="0"' in figure) == bool(plot.points)


def test_outliers_are_shown_in_their_frames_as_long_as_there_is_room(report):
    first, second = (one["index"] for one in report["result"]["outliers"][:2])
    frames = {
        first: FrameImage("image/png", b"small", 1280, 960),
        second: FrameImage("image/png", bytes(10**6), 1, 1),
    }
    text = page(report, frames)
    assert text.count("<image ") == 1 + text.count("<image xlink") and "data:image/png;base64,c21hbGw=" in text


def test_a_thousand_pairs_are_small_and_quick():
    material = made(1000, 20)
    contents(made())
    page(contents(made()))
    began = time.process_time()
    text = page(contents(material))
    assert time.process_time() - began < 5.0
    assert len(text.encode()) < 2_000_000
