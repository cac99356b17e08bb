"""A region drawn over the points by mouse and by keys, and typed: one document, and a worker's counts."""

import json
import re
from typing import Any

import numpy as np
from playwright.sync_api import Locator, Page, expect

from apexcal.sweeps import unpack
from tests.e2e.conftest import SignIn, Track
from tests.e2e.looks import assert_accessible
from workers.vertices.region import Region


def open_drawing(page: Page, track: Track) -> Locator:
    """The recording's page, once its region is drawn from above."""
    page.set_viewport_size({"width": 1280, "height": 1200})
    page.goto(f"{track.url}/recordings/{track.recording_id}?step=region")
    drawing = page.get_by_role("group", name="The region from above")
    expect(drawing.get_by_role("button", name="x >")).to_be_visible()
    return drawing


def typed(page: Page) -> dict[str, Any]:
    """The region as its text says it."""
    page.get_by_role("button", name="Edit as JSON").click()
    region = json.loads(page.get_by_label("Region as JSON").input_value())
    page.get_by_role("button", name="Edit as a list").click()
    return region


def counted(page: Page) -> tuple[int, int]:
    """How many points the page says are kept and cut."""
    found = re.search(r"([\d,]+) points kept, ([\d,]+) cut", page.get_by_test_id("kept").inner_text())
    assert found
    return int(found[1].replace(",", "")), int(found[2].replace(",", ""))


def kept_of(page: Page, track: Track, region: dict[str, Any]) -> tuple[int, int]:
    """The same counts by the kernel that detections use, over the sweeps that the page shows."""
    stage = page.get_by_role("application", name="The region over")
    shown = [int(one) for one in (stage.get_attribute("data-sweeps") or "").split()]
    points = np.concatenate([unpack(track.owner.recordings.sweep(track.recording_id, one)).xyz for one in shown])
    mask = Region.from_document(region).mask(points.astype(np.float32))
    return int(mask.sum()), int((~mask).sum())


def drag(page: Page, handle: Locator, right: float, down: float) -> None:
    handle.scroll_into_view_if_needed()
    box = handle.locator("circle").first.bounding_box()
    assert box
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + right / 2, y + down / 2)
    page.mouse.move(x + right, y + down)
    page.mouse.up()


def test_the_drawing_and_the_text_are_one_region(sign_in: SignIn, track: Track) -> None:
    page = sign_in("Pia", "engineer")
    drawing = open_drawing(page, track)
    assert_accessible(page, "section:has([role=group] > polyline)")
    before = counted(page)
    assert before == kept_of(page, track, typed(page))

    # By mouse: the line of x > 2 to the right. The number beside it follows, and so do the counts.
    value = page.get_by_label("Value").first
    drag(page, drawing.get_by_role("button", name="x >"), 60, 0)
    expect(value).not_to_have_value("2")
    assert float(value.input_value()) > 2.5
    assert counted(page) == kept_of(page, track, typed(page)) != before

    # Typed: the line follows.
    value.fill("3.5")
    expect(drawing.get_by_role("button", name="x >: x 3.50")).to_be_visible()

    # By keys: 0.1 m, with shift 1 m.
    line = drawing.get_by_role("button", name="x >")
    line.press("ArrowRight")
    line.press("Shift+ArrowRight")
    expect(value).to_have_value("4.6")

    # From the side, the ground's line upwards.
    page.locator("form").get_by_role("group", name="View").get_by_role("button", name="Side").click()
    side = page.get_by_role("group", name="The region from the side")
    ground = page.get_by_label("Value").last
    drag(page, side.get_by_role("button", name="z >"), 0, -5)
    expect(ground).not_to_have_value("-1.7")
    assert float(ground.input_value()) > -1.7
    assert counted(page) == kept_of(page, track, typed(page))


def test_shapes_are_drawn_moved_and_cut_out(sign_in: SignIn, track: Track) -> None:
    page = sign_in("Quinn", "engineer")
    drawing = open_drawing(page, track)
    page.get_by_role("button", name="Add a polygon").click()
    drag(page, drawing.get_by_role("button", name="Corner 1 of the polygon"), -10, 25)
    drag(page, drawing.get_by_role("button", name="New corner after corner 2"), 40, 5)
    page.get_by_role("button", name="Cut out a box").click()
    drag(page, drawing.get_by_role("button", name="Turn the box"), 0, -40)
    drag(page, drawing.get_by_role("button", name="Corner 3 of the box"), 30, -20)
    region = typed(page)
    polygon, cut = region["all"][-1], region["none"][-1]["box"]
    assert len(polygon["polygon"]) == 5 and polygon["polygon"][0] != [3, -4]
    assert cut["yaw_deg"] > 5 and max(cut["max"][axis] - cut["min"][axis] for axis in (0, 1)) > 2.5
    assert counted(page) == kept_of(page, track, region)
    corner = drawing.get_by_role("button", name="Corner 2 of the polygon")
    corner.press("Delete")
    expect(drawing.get_by_role("button", name="Corner 5 of the polygon")).to_have_count(0)

    # What was drawn is what is detected in.
    region = typed(page)
    listed = page.get_by_role("navigation", name="Detections").get_by_role("link")
    before = len(list(track.owner.detections.list(track.recording_id)))
    page.get_by_role("button", name="Detect", exact=True).click()
    expect(listed).to_have_count(before + 1)
    newest = next(iter(track.owner.detections.list(track.recording_id)))
    assert newest.region == Region.from_document(region).document
