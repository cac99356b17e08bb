"""The page: one file that needs nothing else, out of which no name gets, small and quick for many pairs."""

import time
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest

from tests.support.reports import data_of
from tests.workers.reports.material import made
from workers.readers.recording import ReadError
from workers.reports import page as module
from workers.reports.contents import contents
from workers.reports.material import FrameImage
from workers.reports.page import page


class Elements(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.found: list[tuple[str, dict[str, str | None]]] = []

    def handle_starttag(self, tag, attrs):
        self.found.append((tag, dict(attrs)))


def test_it_opens_without_a_network_and_names_stay_data():
    document = contents(made())
    text = page(document)
    assert data_of(text) == document | {"pictures": {}}
    parser = Elements()
    parser.feed(text)
    for tag, attributes in parser.found:
        assert not {"src", "href", "xlink:href"} & set(attributes), tag
    assert "@import" not in text and "url(http" not in text
    # The scripts are the data and ours: nothing in them ends or hides one.
    scripts = [attributes for tag, attributes in parser.found if tag == "script"]
    assert [one.get("type") for one in scripts] == ["text/plain", "module"]
    assert text.count("</script>") == 2 and "<!--" not in text.partition("</head>")[2]
    # Not a word of the document stands in the page, which has none of its own.
    for name in ("van </script>", "Ben </script>$x$", "drive <b>.bag"):
        assert name not in text


def test_outliers_have_their_frames_as_long_as_there_is_room():
    document = contents(made())
    first, second, third = (one["index"] for one in document["result"]["outliers"][:3])
    frames = {
        first: FrameImage("image/png", b"small", 1280, 960),
        second: FrameImage("image/png", bytes(10**6), 1, 1),
        third: FrameImage("image/png", b"little", 1, 1),
    }
    pictures = data_of(page(document, frames))["pictures"]
    assert list(pictures) == [str(first), str(third)]
    assert pictures[str(first)] == {"address": "data:image/png;base64,c21hbGw=", "width": 1280, "height": 960}


def test_a_worker_without_the_built_page_says_what_to_do(monkeypatch, tmp_path):
    monkeypatch.setattr(module, "files", lambda _: tmp_path)
    with pytest.raises(ReadError) as raised:
        page(contents(made()))
    assert raised.value.code == "pages_not_built" and "make frontend" in raised.value.hint


def test_fifty_thousand_pairs_are_small_and_quick():
    material, count = made(), 50_000
    rng = np.random.default_rng(1)
    points = rng.uniform((4, -8, -2), (30, 8, 2), (count, 3))
    pixels = rng.uniform((0, 0), (1280, 960), (count, 2))
    problem = replace(material.problem, points=points, pixels=pixels, weights=np.ones(count))
    columns = dict(zip("xyzuv", (*points.T.tolist(), *pixels.T.tolist()), strict=True))
    columns |= {"stamp_ns": (10**18 + 100_000_000 * np.arange(count)).tolist(), "frame_index": list(range(count))}
    columns |= {"group": rng.integers(0, 100, count).tolist(), "marks": [3] * count}
    began = time.process_time()
    text = page(contents(replace(material, problem=problem, pairs=columns, marks=())))
    assert time.process_time() - began < 10.0
    assert len(text) < 3_000_000, len(text)
    assert len(data_of(text)["pairs"]["u"]) == count
