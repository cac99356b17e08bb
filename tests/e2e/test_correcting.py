"""From a result in a browser to the mark that spoils it, and to a fit without it; making a vehicle and its rig."""

import re
from pathlib import Path
from typing import Any
from uuid import uuid4

from playwright.sync_api import Locator, Page, expect

from tests.e2e.conftest import SignIn, Track, recorded
from tests.e2e.effort import count_effort, effort_of

MARKS = 24
WRONG, WRONG_PX = 5, 60  # one mark, so far to the side


def test_a_vehicle_and_its_rig_are_made(sign_in: SignIn, track: Track, simulated: Path) -> None:
    page = sign_in("Nils", "engineer")
    page.goto(f"{track.url}/fleets/{track.fleet_id}")
    page.get_by_role("button", name="New vehicle").click()
    page.get_by_label("New vehicle: name").fill("Walker")
    page.get_by_role("button", name="Create").click()
    expect(page.get_by_role("heading", level=1)).to_have_text("Walker")
    page.get_by_role("button", name="New rig").click()
    page.get_by_label("From a rig.json").set_input_files(simulated / "rig.json")
    expect(page.locator("summary").filter(has_text="simulated")).to_be_visible()


def test_a_wrong_mark_is_reached_from_the_result_and_corrected(
    sign_in: SignIn, track: Track, simulated: Path
) -> None:
    own = recorded(track.owner, track.fleet_id, "Corrected", simulated)
    page = sign_in("Nora", "engineer")
    count_effort(page.context)
    page.set_viewport_size({"width": 1280, "height": 1000})
    apexes = own.truth["frames"]["apex_uv"]
    mark(page, own, apexes)
    page.goto(f"{own.url}/recordings/{own.recording_id}")
    page.get_by_role("button", name="Make pairs").click()
    expect(page.get_by_text(f"{MARKS} pairs")).to_be_visible()
    page.get_by_text("Calibrate with other options").click()
    calibrate(page)
    correct(page, apexes)


def mark(page: Page, track: Track, apexes: list[list[float]]) -> None:
    """Mark, as the page's person, where the camera sees the board's corner, frame by frame, but for one."""

    def ask(path: str, body: dict[str, Any]) -> dict[str, Any]:
        answer = page.request.post(f"{track.url}/v1{path}", data=body, headers={"Origin": track.url})
        assert answer.ok, answer.text()
        return answer.json()

    for number in range(1, MARKS + 1):
        task = ask(f"/detections/{track.detection_id}/tasks/next", {"camera": "front"})
        u, v = apexes[task["frame"]["index"]]
        said = {"verdict": "confirmed", "mark": {"u": u + WRONG_PX * (number == WRONG), "v": v}}
        ask(f"/tasks/{task['task_id']}/answer", {"id": str(uuid4()), "version": 0, **said})


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
