"""The other pages in a browser: signing in, inviting, uploading, trying a region."""

import re
import subprocess
import sys
from pathlib import Path
from uuid import UUID

import pytest
from playwright.sync_api import Browser, Route, expect

from tests.e2e.conftest import SignIn, Track
from tests.e2e.looks import assert_looks
from tests.support.places import FRONTEND
from tests.support.processes import wait_until
from tests.workers.readers.making_recordings import clouds, images, interleaved, png, write_bag


def test_a_link_signs_in_once_and_only_by_its_button(browser: Browser, track: Track) -> None:
    link = track.owner.fleets.invite(track.fleet_id, "Hana", "viewer").link
    context = browser.new_context()
    waits = context.new_page()
    waits.goto(track.url)
    waits.get_by_text("You are not signed in").wait_for()
    page = context.new_page()
    page.goto(link)
    page.reload()  # looking at it, as link previews do, uses nothing up
    page.get_by_role("button", name="Sign in").click()
    page.get_by_role("link", name="Van 7").wait_for()
    for tab in (page, waits):
        expect(tab.get_by_role("banner")).to_contain_text("Hana")
    page.get_by_role("button", name="Sign out").click()
    page.get_by_text("You are not signed in").wait_for()
    page.goto(link)
    page.get_by_role("button", name="Sign in").click()
    expect(page.get_by_role("alert")).to_contain_text("used")
    context.close()


def test_people_read_the_api_without_signing_in(browser: Browser, track: Track) -> None:
    context = browser.new_context()
    page = context.new_page()
    page.goto(f"{track.url}/reference")
    page.get_by_label("Search").fill("rigs.create")
    page.get_by_text("POST /v1/vehicles/{id}/rigs").click()
    group = page.get_by_role("region", name="fleets")
    expect(group).to_contain_text("Describe what a vehicle carries: one LiDAR and its cameras.")
    expect(group.get_by_role("row", name="Idempotency-Key")).to_contain_text("optional")
    expect(group.locator("pre").first).to_contain_text('"lidar"')
    assert_looks(page)
    context.close()


def test_an_engineer_invites_and_sees_a_broken_upload_explained(
    sign_in: SignIn, track: Track, tmp_path: Path
) -> None:
    page = sign_in("Ines", "engineer")
    page.goto(f"{track.url}/fleets/{track.fleet_id}")
    page.get_by_label("Name", exact=True).fill("Jon")
    page.get_by_role("button", name="Make a sign-in link").click()
    field = page.get_by_role("textbox", name="Sign-in link of Jon")
    expect(field).to_have_value(f"{track.url}/sign-in#" + field.input_value().partition("#")[2])

    page.get_by_role("link", name="Van 7").click()
    notes = tmp_path / "notes.bag"
    notes.write_text("This is no bag.\n" * 100)
    page.get_by_label("Recording", exact=True).set_input_files(notes)
    page.get_by_role("button", name="Upload").click()
    expect(page.get_by_role("heading", level=1)).to_have_text("notes.bag")
    # Nobody reloads: the page hears of the change, or asks.
    expect(page.get_by_role("alert")).to_contain_text("text file")
    page.get_by_role("button", name="Read it again").wait_for()


def test_which_topic_is_which_is_asked_and_answered(sign_in: SignIn, track: Track, tmp_path: Path) -> None:
    known = track.owner.vehicles.rig(track.rig_id)
    camera = known.cameras[0].model_dump(mode="json") | {"topic": None}
    rig = track.owner.vehicles.create_rig(
        track.vehicle_id,
        {"name": "without topics", "lidar": {"frame": "velodyne", "topic": None}, "cameras": [camera]},
    )
    frame = png(*camera["image_size"])
    streams = [clouds(), *(images(topic=topic, data=frame) for topic in ("/cam/a", "/cam/b"))]
    bag = write_bag(tmp_path / "two.bag", interleaved(*streams))
    asked = track.owner.recordings.upload(bag, track.vehicle_id, rig.id)
    page = sign_in("Nia", "engineer")
    page.goto(f"{track.url}/recordings/{asked.id}")
    page.get_by_role("heading", name="Which is which?").wait_for()
    expect(page.get_by_label("front")).to_have_value("")
    expect(page.get_by_role("button", name="Read it again")).to_be_disabled()
    page.get_by_label("front").select_option("/cam/b")
    page.get_by_role("button", name="Read it again").click()
    expect(page.get_by_role("cell", name="/cam/b")).to_be_visible()
    page.get_by_text("What the reader found").click()
    expect(page.get_by_text(re.compile(r"\d\d:\d\d:\d\d\.\d{3} UTC")).first).to_be_visible()
    assert track.owner.recordings.get(asked.id).state == "ready"


def test_a_region_is_tried_before_it_is_used(sign_in: SignIn, track: Track) -> None:
    page = sign_in("Kim", "engineer")
    page.goto(f"{track.url}/recordings/{track.recording_id}?step=region")
    page.get_by_role("button", name="Preview the region").click()
    expect(page.get_by_text("Keeps")).to_contain_text("sweeps")
    page.get_by_role("button", name="Suggest a region").click()
    corner = page.get_by_role("group", name="The region from above").get_by_role("button", name="Corner 1 of")
    expect(corner).to_be_visible()
    page.get_by_role("button", name="Edit as JSON").click()
    page.get_by_label("Region as JSON").fill('{"all": [{"quantity": "w", "op": ">", "value": 0}]}')
    expect(page.get_by_role("alert")).to_contain_text("region.all[0].quantity")
    expect(page.get_by_role("button", name="Detect", exact=True)).to_be_disabled()
    page.get_by_label("Region as JSON").fill('{"all": [{"quantity": "x", "op": ">", "value": 500}]}')
    page.get_by_role("button", name="Detect", exact=True).click()
    expect(page.get_by_role("alert")).to_contain_text("region")


def test_what_a_cameras_images_are_is_corrected_on_the_rigs_panel(sign_in: SignIn, track: Track) -> None:
    described = track.owner.vehicles.rig(track.rig_id)
    vehicle = track.owner.vehicles.create(track.fleet_id, "Stereo")
    camera = described.cameras[0].model_dump(mode="json") | {"images": None}
    document = {"name": "Stereo", "lidar": {"frame": "velodyne"}, "cameras": [camera]}
    rig = track.owner.vehicles.create_rig(vehicle.id, document)
    page = sign_in("Lars", "engineer")
    for choice, kind in (("rectified", "rectified"), ("raw", "raw"), ("as the next recording tells", None)):
        page.goto(f"{track.url}/vehicles/{vehicle.id}")
        page.locator("summary").filter(has_text="LiDAR velodyne").press("Enter")
        page.get_by_label("Images of front").select_option(choice)
        wait_until(lambda kind=kind: kind_of_images(track, rig.id) == kind, f"{choice} is stored")
        expect(page.get_by_label("Images of front").locator("option:checked")).to_have_text(choice)


def kind_of_images(track: Track, rig_id: UUID) -> str | None:
    images = track.owner.vehicles.rig(rig_id).cameras[0].images
    return images and images.kind


def test_the_pages_own_modules() -> None:
    """The tests beside the modules of the pages, by Node's own runner, in one process."""
    node = Path(sys.executable).parent / "node"
    command = [node, "--test", "--test-isolation=none", "src/**/*.test.ts"]
    done = subprocess.run(command, cwd=FRONTEND, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout


def test_a_link_opens_the_frame_of_an_outlier_with_its_mark(sign_in: SignIn, track: Track) -> None:
    page = sign_in("Rita", "reviewer")
    page.goto(f"{track.url}/recordings/{track.recording_id}?camera=front&frame=5&u=99.5&v=49.5")
    expect(page.get_by_text("frame 5 of")).to_be_visible()
    mark = page.get_by_title("mark at 99.5, 49.5")
    expect(mark).to_be_visible()
    width = track.image_size[0]
    assert float(mark.evaluate("node => parseFloat(node.style.left)")) == pytest.approx(100 * 100 / width, rel=1e-4)
    page.get_by_label("Frame of front").press("ArrowRight")
    expect(mark).to_have_count(0)


def test_a_page_whose_code_is_gone_says_so(sign_in: SignIn, track: Track) -> None:
    page = sign_in("Olga", "viewer")
    page.goto(f"{track.url}/fleets/{track.fleet_id}")
    page.route(re.compile(r"/assets/Vehicle-.*\.js"), lambda route: route.fulfill(status=404))
    page.get_by_role("link", name="Van 7").click()
    expect(page.get_by_role("alert")).to_contain_text("could not be loaded")
    page.unroute_all()
    page.get_by_role("button", name="Load the page again").click()
    expect(page.get_by_role("heading", level=1)).to_have_text("Van 7")


def test_a_page_that_was_refused_its_stream_of_hints_asks_again(sign_in: SignIn, track: Track) -> None:
    page = sign_in("Otto", "engineer")
    refused: list[str] = []

    def refuse(route: Route) -> None:
        refused.append(route.request.url)
        if len(refused) <= 2:
            route.fulfill(status=503, json={"code": "too_many_streams"})
        else:
            route.continue_()

    page.route("**/events", refuse)
    page.goto(f"{track.url}/fleets/{track.fleet_id}")
    # A browser gives up after the first 503; the page asks again, and has all that changed meanwhile.
    page.get_by_role("link", name="Van 7").wait_for()
    track.owner.vehicles.create(track.fleet_id, "Van 8")
    expect(page.get_by_role("link", name="Van 8")).to_be_visible()
    assert len(refused) == 3
    track.owner.vehicles.create(track.fleet_id, "Van 9")
    expect(page.get_by_role("link", name="Van 9")).to_be_visible()


def test_a_fleet_at_a_glance(sign_in: SignIn, track: Track) -> None:
    lorries = [track.owner.vehicles.create(track.fleet_id, f"Lorry {number}") for number in (10, 2, 1)]
    camera = track.owner.vehicles.rig(track.rig_id).cameras[0].model_dump(mode="json")
    lidar = {"frame": "velodyne", "topic": None}
    track.owner.vehicles.create_rig(lorries[1].id, {"name": "roof", "lidar": lidar, "cameras": [camera]})
    page = sign_in("Gita", "viewer")
    page.goto(f"{track.url}/fleets/{track.fleet_id}")
    cameras = page.get_by_role("region", name="Cameras of the fleet")
    rows = cameras.locator("tbody tr")
    expect(cameras.get_by_role("link", name="Van 7")).to_be_visible()
    cameras.get_by_role("searchbox").fill("lorry")
    expect(rows).to_have_text(
        [re.compile(words) for words in (r"Lorry 1\b.*no camera", r"Lorry 2 front.*recording$", "Lorry 10")]
    )
    # A vehicle without cameras is in the table, and is no camera.
    tiles = page.get_by_role("navigation", name="The car gets")
    expect(tiles.get_by_role("link")).to_have_text([re.compile("All 1"), re.compile(r"○\s*1\s*none")])
    work = page.get_by_role("navigation", name="Waits for")
    expect(work.get_by_role("link")).to_have_text([re.compile("All 1"), re.compile(r"1\s*a recording")])
    expect(cameras.get_by_role("status")).to_have_text("1 camera")
    # By keys: the work, then the order. The address keeps all three.
    work.get_by_role("link", name="1 a recording").press("Enter")
    expect(work.get_by_role("link", name="1 a recording")).to_have_attribute("aria-current", "page")
    cameras.get_by_role("link", name="Vehicle", exact=True).press("Enter")
    expect(rows.first).to_contain_text("Lorry 10")
    page.reload()
    expect(rows.first).to_contain_text("Lorry 10")
    expect(cameras.get_by_role("columnheader", name="Vehicle")).to_have_attribute("aria-sort", "descending")
    expect(cameras.get_by_role("searchbox")).to_have_value("lorry")
    assert page.url.partition("?")[2] == "name=lorry&work=recording&order=-vehicle"
    table = page.request.get(f"{track.url}{cameras.get_by_role('link', name='Download CSV').get_attribute('href')}")
    assert [line.split(",")[1] for line in table.text().splitlines()] == ["vehicle", "Lorry 10", "Lorry 2", "Lorry 1"]
    assert_looks(page)
    for lorry in lorries:
        track.owner.vehicles.delete(lorry.id)
    expect(cameras).to_contain_text("No camera matches.")


def test_help_is_a_page(sign_in: SignIn, track: Track) -> None:
    """Headings, tables and links of the documents, and every link within one leads to something."""
    page = sign_in("Nina", "viewer")
    page.goto(track.url)
    page.goto(f"{track.url}{page.get_by_role('link', name='Help').get_attribute('href')}")
    expect(page.get_by_role("heading", level=1)).to_be_visible()
    expect(page.get_by_role("table").first).to_be_visible()
    assert page.evaluate("getComputedStyle(document.body).maxWidth") != "none"
    documents = page.get_by_role("navigation", name="All documents").get_by_role("link")
    for name in [document.get_attribute("href") for document in documents.all()]:
        page.goto(f"{track.url}/docs/{name}")
        lost = page.evaluate(
            "[...document.querySelectorAll('main a[href^=\"#\"]')].map(a => a.hash.slice(1))"
            ".filter(id => !document.getElementById(decodeURIComponent(id)))"
        )
        assert lost == [], (name, lost)
        assert page.evaluate("document.scrollingElement.scrollWidth <= innerWidth"), name
