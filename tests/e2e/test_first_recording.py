"""From a bag and a URDF on the first page to a vertex to mark; and another rig for a recording that was read."""

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, Page, expect

from apexcal.client import Client
from tests.e2e.looks import assert_looks


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("first") / "walk"
    command = [sys.executable, "-m", "workers.simulation", "--out", str(folder), "--seconds", "12"]
    subprocess.run([*command, "--camera-info", "raw", "--camera-hz", "5"], check=True, stdout=subprocess.DEVNULL)
    return folder


@pytest.fixture
def owner(served: dict[str, Any]) -> Iterator[Client]:
    with Client(served["url"], Path(served["owner_token_file"]).read_text().strip()) as client:
        yield client


@pytest.fixture
def page(browser: Browser, served: dict[str, Any], owner: Client) -> Iterator[Page]:
    """Of an engineer of a fleet without vehicles."""
    fleet = owner.fleets.create("First page")
    context = browser.new_context(viewport={"width": 1280, "height": 900})
    context.set_default_timeout(15_000)
    link = owner.fleets.invite(fleet.id, "Runa", "engineer").link
    assert context.request.post(
        f"{served['url']}/v1/sign-in", data={"link": link}, headers={"Origin": served["url"]}
    ).ok
    page = context.new_page()
    complaints: list[str] = []
    page.on("pageerror", lambda error: complaints.append(str(error)))
    yield page
    context.close()
    assert complaints == []


@pytest.mark.timeout(400)
def test_two_clicks_lead_from_a_bag_to_its_first_mark(
    page: Page, served: dict[str, Any], owner: Client, walk: Path
) -> None:
    page.goto(served["url"])
    assert_looks(page)
    # Files are dropped or chosen; then come the clicks.
    page.get_by_label("Recording and URDF").set_input_files([walk / "recording.bag", walk / "vehicle.urdf"])
    expect(page.get_by_role("heading", level=1)).to_have_text("recording.bag", timeout=60_000)
    page_of = page.url
    card = page.get_by_role("region", name="Rig")
    expect(card).to_contain_text("as the URDF says", timeout=90_000)
    expect(card).to_contain_text("velodyne")
    expect(card).not_to_contain_text("Assumed")
    assert_looks(page)
    card.get_by_role("button", name="Confirm, and find the board").click()
    mark = page.get_by_role("link", name="Mark frames of front")
    expect(mark).to_be_visible(timeout=200_000)
    assert_looks(page)
    mark.click()
    expect(page.get_by_role("application")).to_be_visible(timeout=60_000)
    (recording,) = [one for one in owner.recordings.list() if str(one.id) in page_of]
    rig = owner.vehicles.rig(recording.rig_id)
    assert [camera.name for camera in rig.cameras] == ["front"] and rig.cameras[0].joint is not None
    assert owner.vehicles.get(recording.vehicle_id).name == "recording"

    # A wrong mount is corrected afterwards, without a new upload; what was detected stays.
    page.goto(f"{served['url']}/recordings/{recording.id}?step=region")
    expect(card.get_by_role("button", name="Use this rig")).to_be_visible()
    card.get_by_label("Mount").select_option("looks left")
    with page.expect_response(lambda answer: answer.request.method == "PATCH") as replaced:
        card.get_by_role("button", name="Use this rig").click()
    assert replaced.value.ok
    other = owner.vehicles.rig(owner.recordings.get(recording.id).rig_id)
    assert other.id != rig.id and other.cameras[0].joint is None
    assert len(list(owner.detections.list(recording.id))) == 1
