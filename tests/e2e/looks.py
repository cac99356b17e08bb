"""What every page owes: nothing that axe finds, and nothing that is wider than the window."""

from __future__ import annotations

import itertools
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

import pytest
from playwright.sync_api import Page, expect

from apexcal.documents.checks import Check

AXE = Path(__file__).parents[2] / "frontend" / "node_modules" / "axe-core" / "axe.min.js"
WIDTHS = (390, 1280, 1920)
Scheme = Literal["light", "dark"]
View = tuple[Scheme, int]
VERDICTS = {
    "pass": "It passes its checks.",
    "look": "Look at these checks before it is used.",
    "stop": "It should not be used as it is.",
}

# Colours depend on the scheme, places on the width: each of them once, and all of them together in the long form.
ONCE: tuple[View, ...] = (("light", 390), ("dark", 1280), ("light", 1920))
PHONE: tuple[View, ...] = (("light", 390), ("dark", 390))
CROSSED: tuple[View, ...] = tuple(itertools.product(("light", "dark"), WIDTHS))
each_view = pytest.mark.parametrize(
    "views", [pytest.param(ONCE, id="once"), pytest.param(CROSSED, marks=pytest.mark.slow, id="crossed")]
)

# What is wider than its place is told to the browser in the frame after a change.
DRAWN = "() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))"
# Of what passed, axe would make a list as well.
_RUN = "(inside) => axe.run(inside ?? document, { resultTypes: ['violations'] })"


def assert_accessible(page: Page, inside: str | None = None) -> None:
    """Nothing that axe finds on the page, or inside of a selector's elements, as it is shown now."""
    if not page.evaluate("() => 'axe' in window"):
        page.evaluate(AXE.read_text())
    page.evaluate(DRAWN)
    found = page.evaluate(_RUN, inside)
    said = [(one["id"], [node["html"][:200] for node in one["nodes"]]) for one in found["violations"]]
    assert said == [], (page.url, page.viewport_size, json.dumps(said, indent=1))


def assert_fits(page: Page) -> None:
    """No wider than the window."""
    window = page.viewport_size
    assert window
    if page.evaluate("document.scrollingElement.scrollWidth") > window["width"]:
        raise AssertionError((page.url, window, page.evaluate(_TOO_WIDE)))


def show(page: Page, view: View) -> None:
    """Change the colours and the window's width."""
    scheme, width = view
    page.emulate_media(color_scheme=scheme)
    page.set_viewport_size({"width": width, "height": 900})


_TOO_WIDE = """[...document.querySelectorAll("*")]
    .filter((element) => element.getBoundingClientRect().right > innerWidth + 1)
    .slice(0, 9)
    .map((element) => `${element.tagName}.${element.className}: ${element.textContent.trim().slice(0, 60)}`)
"""


def assert_looks(page: Page, views: tuple[View, ...] = PHONE) -> None:
    """Accessible in these views, and no wider than the window at any width; light and 1280 px wide afterwards."""
    for view in views:
        show(page, view)
        assert_accessible(page)
    for width in WIDTHS:
        show(page, ("light", width))
        assert_fits(page)
    show(page, ("light", 1280))


def assert_verdict_at_once(page: Page, verdict: str | None, checks: Sequence[Check | dict[str, Any]] | None) -> None:
    """A result's verdict and its gravest reason stand on the first screen of a phone and of a laptop."""
    assert verdict and checks
    failing = [check for check in map(Check.model_validate, checks) if check.verdict == verdict != "pass"]
    reasons = [check.sentence for check in sorted(failing, key=lambda check: check.scope == "mount_alone")[:1]]
    for width, height in ((390, 844), (1280, 800)):
        page.set_viewport_size({"width": width, "height": height})
        page.evaluate("scrollTo(0, 0)")
        for sentence in (VERDICTS[verdict], *reasons):
            expect(page.get_by_text(sentence).first).to_be_in_viewport(ratio=1)
