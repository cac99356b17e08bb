"""A recording as the steps of the work, an empty vehicle, a dropped file, and moving between pages by keys."""

import re

import pytest
from playwright.sync_api import Page, expect

from tests.e2e.conftest import SignIn, Track
from tests.e2e.looks import CROSSED, ONCE, View, assert_accessible, assert_fits, show

DRAWERS = ("facts", "region", "calibration")
DROP = """([name, where]) => {
  const data = new DataTransfer();
  data.items.add(new File(["This is no bag.\\n".repeat(50)], name));
  const at = document.querySelector(where);
  for (const type of ["dragenter", "dragover", "drop"]) {
    at.dispatchEvent(new DragEvent(type, { dataTransfer: data, bubbles: true, cancelable: true }));
  }
}"""


def test_the_next_step_is_at_the_top_and_all_else_in_drawers(sign_in: SignIn, track: Track) -> None:
    page = sign_in("Cora", "engineer")
    page.goto(f"{track.url}/recordings/{track.recording_id}")
    # Vertices were found already: their frames are to be marked, and how many more is said at the top.
    step = page.get_by_role("region", name="Next step")
    expect(step).to_contain_text(re.compile(r"Mark \d+ more frames? .*a fit needs 33 marks|Enough for a calibration"))
    expect(step.get_by_role("link", name="Mark frames of front")).to_be_in_viewport()
    for name, there in (
        ("What the recording holds", page.get_by_role("heading", name="What it holds")),
        ("It found the wrong thing", page.get_by_role("heading", name="Find the corners")),
        ("Calibrate with other options", page.get_by_role("heading", name="Calibrate", exact=True)),
    ):
        expect(there).to_have_count(0)
        drawer = page.locator("summary").filter(has_text=name)
        drawer.focus()
        page.keyboard.press("Enter")
        expect(there).to_be_visible()
        expect(drawer).to_be_focused()

    annotator = sign_in("Dag", "annotator")
    annotator.goto(f"{track.url}/recordings/{track.recording_id}")
    expect(annotator.get_by_role("link", name="Mark frames of front")).to_be_in_viewport()
    expect(annotator.get_by_text("It found the wrong thing")).to_have_count(0)


def until(page: Page, condition: str) -> None:
    """Wait for a condition; the pages' content policy keeps Playwright's own way of it out."""
    for _ in range(600):
        if page.evaluate(condition):
            return
        page.wait_for_timeout(50)
    raise AssertionError(f"never: {condition}")


def test_pages_keep_focus_and_scroll(sign_in: SignIn, track: Track) -> None:
    page = sign_in("Elin", "viewer")
    page.set_viewport_size({"width": 1280, "height": 250})
    page.goto(f"{track.url}/fleets/{track.fleet_id}")
    expect(page.get_by_role("link", name="Van 7")).to_be_visible()
    page.keyboard.press("Tab")
    expect(page.get_by_role("link", name="Skip to the content")).to_be_focused()
    page.keyboard.press("Enter")
    expect(page.get_by_role("main")).to_be_focused()
    page.goto(f"{track.url}/vehicles/{track.vehicle_id}")
    link = page.get_by_role("link", name="recording.bag").first
    link.focus()
    page.evaluate("scrollTo(0, 120)")
    until(page, "history.state?.scroll === 120")
    page.keyboard.press("Enter")
    expect(page.get_by_role("heading", level=1)).to_have_text("recording.bag")
    expect(page.get_by_role("main")).to_be_focused()
    assert page.evaluate("scrollY") == 0
    page.go_back()
    expect(page.get_by_role("heading", level=1)).to_have_text("Van 7")
    until(page, "scrollY === 120")


def test_an_empty_vehicle_asks_for_what_comes_first(sign_in: SignIn, track: Track) -> None:
    vehicle = track.owner.vehicles.create(track.fleet_id, "Sled")
    page = sign_in("Finn", "engineer")
    page.goto(f"{track.url}/vehicles/{vehicle.id}")
    expect(page.get_by_text("its rig comes from it")).to_be_visible()
    expect(page.get_by_role("heading", name="Recordings")).to_have_count(0)
    known = track.owner.vehicles.rig(track.rig_id)
    camera = known.cameras[0].model_dump(mode="json")
    rig = {"name": "roof", "lidar": {"frame": "velodyne", "topic": None}, "cameras": [camera]}
    track.owner.vehicles.create_rig(vehicle.id, rig)
    page.reload()
    expect(page.get_by_text("Upload a recording of somebody")).to_be_visible()

    page.evaluate(DROP, ["dropped.bag", "h1"])
    expect(page.get_by_role("heading", level=1)).to_have_text("dropped.bag")
    expect(page.get_by_role("alert")).to_contain_text("text file")
    expect(page.get_by_role("region", name="Next step")).to_have_count(0)  # nothing else can be done with it


def test_a_file_is_dropped_anywhere(sign_in: SignIn, track: Track) -> None:
    page = sign_in("Fritz", "engineer")
    title = page.get_by_role("heading", level=1)
    # On the recording's page: to its vehicle and rig.
    page.goto(f"{track.url}/recordings/{track.recording_id}")
    expect(title).to_have_text("recording.bag")
    page.evaluate(DROP, ["again.bag", "h1"])
    expect(title).to_have_text("again.bag")
    expect(page.get_by_role("link", name="Van 7")).to_be_visible()
    # On the fleet's page: to the vehicle under it, else to the one that is chosen.
    vehicle = track.owner.vehicles.create(track.fleet_id, "Handcart")
    camera = track.owner.vehicles.rig(track.rig_id).cameras[0].model_dump(mode="json")
    rig = {"name": "roof", "lidar": {"frame": "velodyne", "topic": None}, "cameras": [camera]}
    track.owner.vehicles.create_rig(vehicle.id, rig)
    page.goto(f"{track.url}/fleets/{track.fleet_id}")
    expect(page.get_by_role("link", name="Handcart")).to_be_visible()
    page.evaluate(DROP, ["onto.bag", f'[data-vehicle="{vehicle.id}"]'])
    expect(title).to_have_text("onto.bag")
    page.goto(f"{track.url}/fleets/{track.fleet_id}")
    expect(page.get_by_role("link", name="Handcart")).to_be_visible()
    page.evaluate(DROP, ["beside.bag", "h1"])
    dialog = page.get_by_role("dialog", name="Which vehicle recorded beside.bag?")
    dialog.get_by_label("Vehicle").select_option("Handcart")
    dialog.get_by_role("button", name="Upload").click()
    expect(title).to_have_text("beside.bag")
    assert {one.name for one in track.owner.recordings.list(vehicle_id=vehicle.id)} == {"onto.bag", "beside.bag"}
    (again,) = [one for one in track.owner.recordings.list(vehicle_id=track.vehicle_id) if one.name == "again.bag"]
    track.owner.recordings.delete(again.id)


def pages_of(track: Track) -> list[str]:
    paths = [f"/recordings/{track.recording_id}?step={step}" for step in DRAWERS]
    return [
        *paths,
        f"/fleets/{track.fleet_id}",
        f"/fleets/{track.fleet_id}/requests",
        f"/vehicles/{track.vehicle_id}",
    ]


def assert_looks_as_loaded(page: Page, address: str, views: tuple[View, ...]) -> None:
    """Accessible and no wider than the window in the view that it is loaded in, and in others that follow."""
    show(page, views[0])
    page.goto(address)
    expect(page.get_by_role("heading", level=1)).to_be_visible()
    page.wait_for_load_state("networkidle")
    for view in views:
        show(page, view)
        assert_accessible(page)
        assert_fits(page)


def test_every_page_is_accessible_and_fits(sign_in: SignIn, track: Track) -> None:
    page = sign_in("Gry", "engineer")
    # Each page is loaded in one of the views, so each view has pages that were loaded in it.
    for number, path in enumerate(pages_of(track)):
        first = number % len(ONCE)
        assert_looks_as_loaded(page, f"{track.url}{path}", ONCE[first:] + ONCE[:first])


@pytest.mark.slow
@pytest.mark.parametrize("view", CROSSED, ids=[f"{scheme}-{width}" for scheme, width in CROSSED])
def test_every_page_is_accessible_and_fits_as_it_is_loaded(sign_in: SignIn, track: Track, view: View) -> None:
    page = sign_in(f"Gry {view}", "engineer")
    for path in pages_of(track):
        assert_looks_as_loaded(page, f"{track.url}{path}", (view,))


def test_a_page_that_loads_shows_shapes(sign_in: SignIn, track: Track) -> None:
    page = sign_in("Hedda", "viewer")
    page.route(re.compile(r"/v1/recordings/[^/]+$"), lambda route: None)  # never answered
    page.goto(f"{track.url}/recordings/{track.recording_id}")
    expect(page.get_by_role("main").get_by_text("Loading")).to_be_attached()
    page.unroute_all()
