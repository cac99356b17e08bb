"""Walks of an annotator, at a laptop and with a thumb, and of an operator, with their clicks and keys counted.

The engineer's is in ``test_whole_walk.py``.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from playwright.sync_api import Browser, Page, expect

from tests.e2e.conftest import Track
from tests.e2e.effort import Effort, count_effort, effort_of
from tests.e2e.looks import assert_fits
from tests.e2e.marking import Marker
from tests.e2e.test_calibrating import add_cart
from tests.faults.jobs import SHORT

Visit = Callable[..., Page]
LAPTOP: dict[str, Any] = {"viewport": {"width": 1280, "height": 800}}
PHONE: dict[str, Any] = {"viewport": {"width": 390, "height": 844}, "has_touch": True, "is_mobile": True}
# A laptop of 1280 x 800 at 200 %.
ZOOMED = {"width": 640, "height": 400}
LEAST_FRAME_PX = 300


@pytest.fixture
def visit(browser: Browser, track: Track) -> Iterator[Visit]:
    """Opens a person's sign-in link on a device, with what they do counted, and signs in."""
    contexts = []

    def open_link(name: str, role: str, device: dict[str, Any]) -> Page:
        context = browser.new_context(**device)
        context.set_default_timeout(60_000)
        contexts.append(context)
        count_effort(context)
        page = context.new_page()
        page.goto(track.owner.fleets.invite(track.fleet_id, name, role).link)
        button = page.get_by_role("button", name="Sign in")
        button.tap() if device.get("has_touch") else button.click()
        expect(page.get_by_role("region", name="Cameras of the fleet")).to_be_visible()
        return page

    yield open_link
    for context in contexts:
        context.close()


@pytest.mark.parametrize("device", [LAPTOP, PHONE], ids=["laptop", "phone"])
def test_an_annotator_comes_to_work_by_one_click(visit: Visit, track: Track, device: dict[str, Any]) -> None:
    touches = bool(device.get("has_touch"))
    page = visit(f"Ann {touches}", "annotator", device)
    assert_fits(page)
    before = effort_of(page)
    work = page.get_by_role("region", name="Your work").locator(f'a.button[href^="/detections/{track.detection_id}"]')
    work.tap() if touches else work.click()
    expect(page).to_have_url(re.compile("/detections/"))
    expect(page.get_by_role("heading", level=1)).to_be_visible()
    cost = effort_of(page).minus(before)
    print(f"annotator, {'phone' if touches else 'laptop'}, to work: {cost}")
    assert cost == Effort(clicks=1, keys=0)

    page.goto(f"{track.url}/detections/{track.detection_id}/mark?camera=front")
    marker = Marker(page, track)
    marker.ready()
    if touches:
        assert_in_reach_of_a_thumb(page)
    before, first = effort_of(page), marker.vertex
    if touches:
        marker.view().tap(position={"x": 150, "y": 120})
        page.get_by_role("button", name="Save mark").tap()
    else:
        marker.view().click(position={"x": 300, "y": 300})
        page.keyboard.press("Enter")
    if page.get_by_text("Is this the corner?").is_visible():
        page.get_by_role("button", name="Keep the mark").click()
        before = Effort(before.clicks + 1, before.keys)
    page.wait_for_function("shown => document.querySelector('.stage')?.dataset.vertex !== shown", arg=first)
    cost = effort_of(page).minus(before)
    print(f"annotator, {'phone' if touches else 'laptop'}, a mark: {cost}")
    assert cost.clicks + cost.keys == 2


def assert_in_reach_of_a_thumb(page: Page) -> None:
    """What marking needs is there without scrolling."""
    assert_fits(page)
    names = ("Save mark", "Reject", "Unsure", "Skip", "Undo", "left", "up", "down", "right")
    for part in (page.locator(".asked"), *(page.get_by_role("button", name=name) for name in names)):
        expect(part.first).to_be_in_viewport(ratio=0.99)
        assert (part.first.bounding_box() or {"height": 0})["height"] >= 44
    expect(page.locator("button kbd:visible")).to_have_count(0)


def test_a_laptop_at_twice_the_size_shows_a_frame_to_mark(visit: Visit, track: Track) -> None:
    page = visit("Zoe", "annotator", {"viewport": ZOOMED})
    page.goto(f"{track.url}/detections/{track.detection_id}/mark?camera=front")
    Marker(page, track).ready()
    assert_fits(page)
    box = page.locator(".work > .stage").bounding_box()
    print(f"at 200 % the frame has {box}")
    assert box and box["height"] >= LEAST_FRAME_PX and box["width"] >= LEAST_FRAME_PX


def test_an_operator_sees_which_cars_wait_for_a_decision_by_one_click(visit: Visit, track: Track) -> None:
    vehicle, pairs = add_cart(track, "Undecided", 40, vertices=1)
    wanted = {"models": ["pinhole"], "folds": 0, "publish": "recommended", "schedule": SHORT}
    track.owner.wait(track.owner.calibrations.create(vehicle, [pairs], **wanted))
    page = visit("Otis", "viewer", LAPTOP)
    before = effort_of(page)
    page.get_by_role("navigation", name="Waits for").get_by_role("link", name=re.compile("a decision")).click()
    expect(page).to_have_url(re.compile("work=decision"))
    rows = page.get_by_role("region", name="Cameras of the fleet").locator("tbody tr")
    expect(rows.filter(has_text="Undecided")).to_have_count(1)
    expect(rows.filter(has_not_text="a decision")).to_have_count(0)
    cost = effort_of(page).minus(before)
    print(f"operator, to what waits for a decision: {cost}")
    assert cost == Effort(clicks=1, keys=0)
