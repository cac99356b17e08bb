"""From a bag and a URDF to the URDF with the calibrated mount, a person's clicks counted; then another rig for it."""

import json
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser, Page, expect

from apexcal.client import Client
from apexcal.documents.machine_marks import MarksView
from apexcal.geometry.frame_tree import urdf_tree
from tests.e2e.conftest import Track
from tests.e2e.effort import Effort, count_effort, effort_of
from tests.e2e.looks import assert_looks
from tests.e2e.marking import Marker
from tests.e2e.test_crops import Confirmer
from tests.e2e.test_workspace import DROP
from tests.support import walks
from tests.support.served import Embedded

# From the sign-in to the first verdict, and from there to the vehicle's own URDF.
MOST = Effort(clicks=8, keys=3)


@pytest.fixture
def owner(served: Embedded) -> Iterator[Client]:
    with Client(served.url, served.token) as client:
        yield client


@pytest.fixture
def page(browser: Browser, served: Embedded, owner: Client) -> Iterator[Page]:
    """Of an engineer of a fleet without vehicles, at their sign-in link."""
    fleet = owner.fleets.create("First page")
    context = browser.new_context(viewport={"width": 1280, "height": 900})
    context.set_default_timeout(15_000)
    count_effort(context)
    page = context.new_page()
    page.goto(owner.fleets.invite(fleet.id, "Runa", "engineer").link)
    complaints: list[str] = []
    page.on("pageerror", lambda error: complaints.append(str(error)))
    yield page
    context.close()
    assert complaints == []


def test_eight_clicks_lead_from_a_bag_to_a_urdf(page: Page, served: Embedded, owner: Client) -> None:
    walk = walks.walk("long")
    page.get_by_role("button", name="Sign in").click()
    expect(page.get_by_label("Recording and URDF")).to_be_visible()
    assert_looks(page)
    # Files are dropped or chosen; then come the clicks.
    page.get_by_label("Recording and URDF").set_input_files([walk / "recording.bag", walk / "vehicle.urdf"])
    expect(page.get_by_role("heading", level=1)).to_have_text("recording.bag")
    card = page.get_by_role("region", name="Rig")
    expect(card).to_contain_text("as the URDF says", timeout=300_000)
    expect(card).to_contain_text("velodyne")
    expect(card).not_to_contain_text("Assumed")
    assert_looks(page)
    card.get_by_role("button", name="Confirm, and find the board").click()
    confirm = page.get_by_role("link", name=re.compile("^Confirm .* of front"))
    expect(confirm).to_be_visible(timeout=300_000)
    (recording,) = [one for one in owner.recordings.list() if str(one.id) in page.url]
    (detection,) = owner.detections.list(recording.id)
    (analysis,) = owner.analyses.list(MarksView, recording_id=recording.id)
    marks = {str(one.vertex_id): one for one in owner.analyses.marks(analysis.id) if one.reason is None}
    expect(page.get_by_role("link", name="Mark frames of front")).to_be_visible()
    assert_looks(page)
    confirm.click()
    expect(page.get_by_role("heading", name="Mark 5 frames yourself first")).to_be_visible()
    before = effort_of(page)

    # Confirming is not counted.
    size = owner.vehicles.rig(recording.rig_id).cameras[0].image_size
    ids = (str(one) for one in (recording.vehicle_id, recording.id, detection.id, recording.rig_id))
    track = Track(served.url, owner, str(recording.fleet_id), *ids, {}, (size[0], size[1]))
    person, marker = Confirmer(page, track, marks), Marker(page, track)
    person.mark_blind(marker)
    person.confirm_all()
    confirming = effort_of(page).minus(before)

    page.get_by_role("button", name="Calibrate front").click()
    expect(page.get_by_role("heading", level=1)).to_contain_text("Calibration of")
    publish = page.get_by_role("button", name="Publish for the vehicle")
    publish.wait_for(timeout=300_000)
    expect(page.get_by_text("Verdict: pass.")).to_be_visible()
    verdict = effort_of(page).minus(confirming)
    print(f"engineer, sign-in to verdict: {verdict}; confirming: {confirming}")
    assert verdict.clicks <= MOST.clicks and verdict.keys <= MOST.keys
    publish.click()
    page.get_by_text("Into your own URDF").click()
    # The URDF that came with the recording is not asked for again.
    with page.expect_download() as download:
        page.get_by_role("button", name="Replace and download").click()
    whole = effort_of(page).minus(confirming)
    print(f"engineer, sign-in to URDF: {whole}")
    assert whole.clicks <= MOST.clicks

    stated, after = ((walk / "vehicle.urdf").read_bytes(), Path(download.value.path()).read_bytes())
    truth = json.loads((walk / "truth.json").read_text())["transform"]
    mount = urdf_tree(after).transform("camera_front_optical", "velodyne")
    off = np.array(truth["rotation"]["matrix"]) @ mount.R.T
    assert np.degrees(np.arccos((np.trace(off) - 1.0) / 2.0)) < 0.3
    assert np.linalg.norm(mount.t - truth["translation_m"]) < 0.03
    assert stated != after and stated.count(b"<joint") == after.count(b"<joint")

    # A wrong mount is corrected afterwards, without a new upload; what was detected stays.
    rig = owner.vehicles.rig(recording.rig_id)
    assert [camera.name for camera in rig.cameras] == ["front"] and rig.cameras[0].joint is not None
    assert owner.vehicles.get(recording.vehicle_id).name == "recording"
    page.goto(f"{served.url}/recordings/{recording.id}?step=region")
    expect(card.get_by_role("button", name="Use this rig")).to_be_visible()
    card.get_by_label("Mount").select_option("looks left")
    with page.expect_response(lambda answer: answer.request.method == "PATCH") as replaced:
        card.get_by_role("button", name="Use this rig").click()
    assert replaced.value.ok
    other = owner.vehicles.rig(owner.recordings.get(recording.id).rig_id)
    assert other.id != rig.id and other.cameras[0].joint is None
    assert len(list(owner.detections.list(recording.id))) == 1

    # A second recording goes into no vehicle unasked, also where there is one only.
    page.goto(served.url)
    expect(page.get_by_role("link", name="recording", exact=True)).to_be_visible()
    page.evaluate(DROP, ["second.bag", "h1"])
    expect(page.get_by_role("dialog", name="Which vehicle recorded second.bag?")).to_be_visible()
