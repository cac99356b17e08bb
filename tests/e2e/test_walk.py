"""A new vehicle from nothing to a published calibration, in a browser, by mouse and keys alone."""

import re
from collections.abc import Callable
from pathlib import Path

from playwright.sync_api import Locator, Page, expect

from tests.e2e.conftest import Track
from tests.e2e.effort import count_effort, effort_of
from tests.e2e.test_region import counted, drag
from tests.e2e.test_taking import publish_anyway

MARKS = 24
WRONG, WRONG_PX = 5, 60  # one mark, so far to the side
SignIn = Callable[[str, str], Page]


def test_an_engineer_goes_the_whole_way(sign_in: SignIn, track: Track, simulated: Path) -> None:
    page = sign_in("Nora", "engineer")
    count_effort(page.context)
    page.goto(f"{track.url}/fleets/{track.fleet_id}")
    page.set_viewport_size({"width": 1280, "height": 1000})
    describe(page, "Walker", simulated / "rig.json")
    upload(page, simulated / "recording.bag")
    draw(page)
    apexes = track.truth["frames"]["apex_uv"]
    mark(page, apexes)
    calibrate(page)
    correct(page, apexes)
    publish(page)


def describe(page: Page, name: str, rig: Path) -> None:
    """A vehicle and its rig."""
    page.get_by_role("button", name="New vehicle").click()
    page.get_by_label("New vehicle: name").fill(name)
    page.get_by_role("button", name="Create").click()
    expect(page.get_by_role("heading", level=1)).to_have_text(name)
    page.get_by_role("button", name="New rig").click()
    page.get_by_label("From a rig.json").set_input_files(rig)
    expect(page.locator("summary").filter(has_text="simulated")).to_be_visible()


def upload(page: Page, recording: Path) -> None:
    page.get_by_label("Recording", exact=True).set_input_files(recording)
    page.get_by_role("button", name="Upload").click()
    expect(page.get_by_role("heading", level=1)).to_have_text(recording.name)
    expect(page.get_by_text("ready", exact=True).first).to_be_visible()
    page.get_by_text("Say yourself where the board is").click()


def draw(page: Page) -> None:
    """A region from what moves, its edge then moved by mouse."""
    drawing = page.get_by_role("group", name="The region from above")
    expect(drawing.get_by_role("button", name="x >")).to_be_visible()
    before = counted(page)
    page.get_by_role("button", name="Suggest a region").click()
    expect(page.get_by_text("Somebody walks")).to_be_visible()
    suggested = counted(page)
    assert suggested != before
    drag(page, drawing.get_by_role("button", name=re.compile("^Corner 1 of")).first, -12, 6)
    assert counted(page) != suggested
    page.get_by_role("button", name="Detect", exact=True).click()


def mark(page: Page, apexes: list[list[float]]) -> None:
    """Click where the camera sees the board's corner, frame by frame, but for one. No good mark is asked about."""
    marking = page.get_by_role("link", name="Mark frames of front")
    expect(marking).to_be_visible()
    marking.click()
    stage = page.locator(".stage")
    for number in range(1, MARKS + 1):
        expect(page.get_by_test_id("mine")).to_contain_text(re.compile(rf"^{number - 1} of"))
        vertex = stage.get_attribute("data-vertex")
        page.get_by_role("button", name="Reject").and_(page.locator(":enabled")).wait_for()
        application = page.get_by_role("application", name=re.compile("^Camera frame"))
        said = re.search(r"frame (\d+)", application.get_attribute("aria-label") or "")
        assert said
        u, v = apexes[int(said[1])]
        page.mouse.click(*place_of(application.locator("img"), [u + WRONG_PX * (number == WRONG), v]))
        page.keyboard.press("Enter")
        if number == WRONG and page.get_by_text("Is this the corner?").is_visible():
            page.keyboard.press("k")
        expect(stage).not_to_have_attribute("data-vertex", vertex or "")
    expect(page.get_by_test_id("mine")).to_contain_text(re.compile(rf"^{MARKS} of"))
    page.get_by_role("link", name="Back").click()
    page.get_by_role("button", name="Make pairs").click()
    expect(page.get_by_text(f"{MARKS} pairs")).to_be_visible()
    page.get_by_text("Calibrate with other options").click()


def place_of(image: Locator, pixel: list[float]) -> tuple[float, float]:
    """Where on the page a pixel of a shown frame lies."""
    box = image.bounding_box()
    width, height = image.evaluate("image => [image.naturalWidth, image.naturalHeight]")
    assert box
    return (box["x"] + (pixel[0] + 0.5) * box["width"] / width, box["y"] + (pixel[1] + 0.5) * box["height"] / height)


def calibrate(page: Page) -> None:
    expect(page.get_by_role("checkbox", name=re.compile(f"{MARKS} pairs from annotations"))).to_be_checked()
    for other in ("pinhole", "kannala_brandt"):
        page.get_by_role("checkbox", name=re.compile(other)).uncheck()
    page.get_by_text("Options", exact=True).click()
    page.get_by_label("Folds").fill("2")
    page.get_by_role("button", name="Calibrate", exact=True).click()
    expect(page.get_by_role("heading", level=1)).to_contain_text("Calibration of")
    expect(page.get_by_role("button", name="Publish for the vehicle")).to_be_visible(timeout=300_000)


def correct(page: Page, apexes: list[list[float]]) -> None:
    """From the result to its wrong mark in at most two clicks; two more correct it. Then the fit is good."""
    before = effort_of(page)
    again = page.get_by_role("link", name=re.compile("^Mark pair .* again$"))
    expect(again).to_have_count(1)
    again.click()
    application = page.get_by_role("application", name=re.compile("^Camera frame"))
    application.wait_for()
    assert effort_of(page).minus(before).clicks <= 2
    page.get_by_role("button", name="Reject").and_(page.locator(":enabled")).wait_for()
    said = re.search(r"frame (\d+)", application.get_attribute("aria-label") or "")
    assert said
    reached = effort_of(page)
    page.mouse.click(*place_of(application.locator("img"), apexes[int(said[1])]))
    page.get_by_role("button", name="Save mark").click()
    button = page.get_by_role("button", name="Calibrate again with the marks as they are now")
    expect(button).to_be_visible()
    assert effort_of(page).minus(reached).clicks <= 2
    address = page.url
    button.click()
    expect(page).not_to_have_url(address)
    expect(page.get_by_role("button", name="Publish for the vehicle")).to_be_visible(timeout=300_000)
    expect(again).to_have_count(0)
    row = page.get_by_role("row").filter(has_text="brown_conrady").first
    polished = re.findall(r"[\d.]+ / ([\d.]+)", row.inner_text())[1]
    assert float(polished) < 3  # marks are half a pixel off, and vertices some millimetres


def publish(page: Page) -> None:
    publish_anyway(page, "The first walk with this vehicle.")
    page.get_by_role("link", name="Walker").click()
    expect(page.get_by_text("brown_conrady, published")).to_be_visible()
