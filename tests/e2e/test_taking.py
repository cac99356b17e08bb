"""How a calibration comes to its users, in a browser: withdrawals, aliases, copies, gates, serials, other files."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from playwright.sync_api import Page, Response, Route, expect

from apexcal.documents.copies import CopyView
from apexcal.errors import ApiError
from tests.e2e.conftest import SignIn, Track
from tests.e2e.looks import assert_looks
from tests.e2e.test_calibrating import add_cart
from tests.faults.jobs import LEVEL_RIG, SHORT
from tests.workers.readers.making_recordings import START_NS, TYPES, clouds, images, interleaved, png, write_bag
from tests.workers.readers.making_transforms import CAMERA, LIDAR, TF, message
from tests.workers.readers.viewing.reading_viewer_files import messages


@dataclass(frozen=True)
class Given:
    """A vehicle with a recording, and its calibrations, the second of which is current."""

    vehicle: str
    recording: str
    calibrations: list[str]
    results: list[str]


def is_dry(answer: Response) -> bool:
    """Whether it only says what cars would get."""
    return "dry-run" in answer.request.headers


@pytest.fixture(scope="module")
def given(track: Track, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Given]:
    vehicle, pairs = add_cart(track, "Coach", 60)
    wanted = {"folds": 3, "publish": "recommended", "schedule": SHORT}
    calibrations = [
        track.owner.wait(track.owner.calibrations.create(vehicle, [pairs], ["pinhole"], seed=seed, **wanted))
        for seed in (1, 2)
    ]
    results = [str(one.summary.cameras["front"].models["pinhole"].result_id) for one in calibrations]
    frames = list(images(4, "/camera/compressed", png(*LEVEL_RIG["cameras"][0]["image_size"])))
    poses = [("/tf_static", TF, START_NS, message(TYPES, [LIDAR, CAMERA]))]
    file = write_bag(tmp_path_factory.mktemp("coach") / "coach.bag", interleaved(poses, clouds(4), frames))
    (rig,) = track.owner.vehicles.rigs(vehicle)
    recording = track.owner.wait(track.owner.recordings.upload(file, vehicle, rig.id))
    yield Given(vehicle, str(recording.id), [str(one.id) for one in calibrations], results)


def test_an_alias_is_moved_back_and_removed(sign_in: SignIn, track: Track, given: Given) -> None:
    first, second = given.results
    owner = track.owner.calibrations
    for result, why in ((first, "Two cars try it."), (second, "The next one.")):
        owner.publish(result, why, override=True, alias="canary")
    page = sign_in("Ulla", "reviewer")
    page.goto(f"{track.url}/vehicles/{given.vehicle}")
    page.get_by_text("Aliases", exact=True).click()
    page.get_by_role("button", name="canary", exact=True).click()
    back = page.get_by_role("button", name=re.compile("^Publish again: pinhole"))
    expect(back).to_have_count(1)
    back.focus()
    page.keyboard.press("Enter")
    dialog = page.get_by_role("dialog")
    expect(dialog).to_contain_text("Let canary lead to this pinhole for front?")
    expect(dialog.get_by_role("button", name="Publish")).to_be_disabled()
    dialog.get_by_role("textbox").fill("The next one is off.")
    assert_looks(page)
    dialog.get_by_role("button", name="Publish").click()
    expect(page.get_by_text("The next one is off.").first).to_be_visible()
    assert str(owner.current(given.vehicle, "front", "canary").result_id) == first
    (newest, *_) = owner.publications(given.vehicle, "front", "canary")
    assert (newest.reason, newest.published_by) == ("The next one is off.", "Ulla")
    page.get_by_role("button", name=re.compile("^Withdraw: pinhole")).click()
    dialog.get_by_role("textbox").fill("The test is over.")
    dialog.get_by_role("button", name="Withdraw", exact=True).click()
    expect(page.get_by_text("The test is over.").first).to_be_visible()
    with pytest.raises(ApiError, match="The test is over"):
        owner.current(given.vehicle, "front", "canary")
    viewer = sign_in("Vera", "viewer")
    viewer.goto(f"{track.url}/vehicles/{given.vehicle}")
    viewer.get_by_text("Aliases", exact=True).click()
    viewer.get_by_role("button", name="canary", exact=True).click()
    expect(viewer.get_by_text("The next one is off.")).to_be_visible()
    expect(viewer.get_by_role("button", name=re.compile("^Publish again"))).to_have_count(0)


def test_a_result_is_compared_with_a_file_and_given_an_alias(
    sign_in: SignIn, track: Track, given: Given, tmp_path: Path
) -> None:
    page = sign_in("Wim", "reviewer")
    page.goto(f"{track.url}/calibrations/{given.calibrations[0]}")
    page.get_by_text("Compare with", exact=True).click()
    page.get_by_role("button", name="another program's calibration").click()
    export = page.request.get(f"{track.url}/v1/results/{given.results[0]}?format=opencv")
    file = tmp_path / "front.yaml"
    file.write_bytes(export.body())
    page.get_by_label(re.compile("camera_info, OpenCV")).set_input_files(file)
    page.get_by_role("button", name="Compare with this result").click()
    expect(page.get_by_text("It agrees in its direction.")).to_be_visible()
    expect(page.get_by_role("row", name="turned by")).to_contain_text("0.000°")
    other = tmp_path / "other.yaml"
    other.write_text("hello: world\n")
    page.get_by_label(re.compile("camera_info, OpenCV")).set_input_files(other)
    expect(page.get_by_role("alert")).to_be_visible()
    page.get_by_role("button", name="Set an alias…").click()
    dialog = page.get_by_role("dialog")
    dialog.get_by_label("Alias", exact=True).fill("yard")
    dialog.get_by_label(re.compile("^Why")).fill("For the yard.")
    assert_looks(page)
    dialog.get_by_role("button", name="Publish").click()
    expect(dialog).to_have_count(0)
    found = track.owner.calibrations.current(given.vehicle, "front", "yard")
    assert (str(found.result_id), found.reason) == (given.results[0], "For the yard.")


def test_a_copy_is_asked_for_downloaded_and_deleted(
    sign_in: SignIn, track: Track, given: Given, tmp_path: Path
) -> None:
    page = sign_in("Xaver", "engineer")
    page.goto(f"{track.url}/recordings/{given.recording}?step=facts")
    page.get_by_label(re.compile("MCAP file for Foxglove")).check()
    page.get_by_role("button", name="Make the copy").click()
    link = page.get_by_role("link", name="Download", exact=True)
    link.wait_for()
    assert_looks(page)
    with page.expect_download() as coming:
        link.click()
    file = tmp_path / coming.value.suggested_filename
    coming.value.save_as(file)
    assert file.name == "coach-for-viewers.mcap" and len(messages(file, "/front/undistorted/image")) == 4
    page.get_by_role("button", name=re.compile("^Delete coach-for-viewers")).click()
    expect(link).to_have_count(0)
    assert list(track.owner.analyses.list(CopyView, recording_id=given.recording)) == []


def test_a_rig_of_the_recordings_tree_its_serials_and_gates(sign_in: SignIn, track: Track, given: Given) -> None:
    # The fleet's page, which an admin looks at below on a phone, has a row for each person.
    track.owner.fleets.invite(track.fleet_id, "Maximiliana Featherstonehaugh-Throckmorton", "annotator")
    page = sign_in("Yrsa", "admin")
    take_proposed_rig(page, track, given.recording, "coach.bag,")
    page.goto(f"{track.url}/vehicles/{given.vehicle}")
    # By the keyboard: panels above it load meanwhile and move it from under a pointer.
    page.locator("summary").filter(has_text="coach.bag,").press("Enter")
    panel = page.locator("details").filter(has_text="coach.bag,")
    panel.get_by_label("LiDAR", exact=True).fill("L-77")
    panel.get_by_label("Mean error of held-out pairs").fill("0.8")
    assert_looks(page)
    # The second form is saved while the page still reads what the first one made.
    held: list[Route] = []
    holds = True  # nothing is read meanwhile; what is asked for late is not held for ever
    page.route(re.compile(r"/rigs(\?.*)?$"), lambda route: held.append(route) if holds else route.continue_())
    # Cars may ask by the new serial number: the page says so first.
    page.once("dialog", lambda dialog: dialog.accept())
    with page.expect_response(lambda answer: answer.url.endswith("/serials") and not is_dry(answer)):
        panel.get_by_role("button", name="Save the serial numbers").click()
    with page.expect_response(re.compile("/policy$")) as saved:
        panel.get_by_role("button", name="Save the policy").click()
    assert saved.value.ok and held
    holds = False
    for route in held:
        route.continue_()
    expect(panel.get_by_role("button", name="Save the serial numbers")).to_be_disabled()
    expect(panel.get_by_role("button", name="Discard changes")).to_have_count(0)
    (rig,) = [one for one in track.owner.vehicles.rigs(given.vehicle) if one.name.startswith("coach.bag,")]
    assert rig.lidar.serial == "L-77" and rig.policy and rig.policy.heldout_mean_px == 0.8
    assert rig.cameras[0].joint is not None and rig.cameras[0].nominal.from_frame == "velodyne"

    page.goto(f"{track.url}/fleets/{track.fleet_id}")
    page.get_by_label("Share of the image with pairs").fill("0.01")
    assert_looks(page)
    page.get_by_role("button", name="Save the policy").click()
    expect(page.get_by_role("button", name="Discard changes")).to_have_count(0)
    assert track.owner.fleets.get(track.fleet_id).policy.coverage == 0.01
    page.get_by_label("Share of the image with pairs").fill("")
    page.get_by_role("button", name="Save the policy").click()
    expect(page.get_by_role("button", name="Discard changes")).to_have_count(0)
    assert track.owner.fleets.get(track.fleet_id).policy is None


def take_proposed_rig(page: Page, track: Track, recording: str, name: str) -> None:
    """The recording's own tree instead of the rig that it was uploaded with. Four sweeps are too few for a region."""
    page.goto(f"{track.url}/recordings/{recording}?step=region")
    card = page.get_by_role("region", name="Rig")
    expect(card).to_contain_text("as the recording says")
    assert_looks(page)
    with page.expect_response(lambda answer: answer.request.method == "PATCH") as replaced:
        card.get_by_role("button", name="Confirm, and find the board").click()
    assert replaced.value.ok
    expect(card.get_by_role("alert")).to_be_visible()
    rig = track.owner.vehicles.rig(track.owner.recordings.get(recording).rig_id)
    assert rig.name.startswith(name) and rig.cameras[0].joint is not None


def test_a_reviewer_withdraws_and_everybody_is_told(sign_in: SignIn, track: Track, given: Given) -> None:
    """Last, because nothing is current afterwards."""
    page = sign_in("Zoe", "reviewer")
    page.goto(f"{track.url}/vehicles/{given.vehicle}")
    page.get_by_text("All publications").click()
    ask = page.get_by_role("button", name=re.compile("^Withdraw: pinhole")).first
    ask.focus()
    page.keyboard.press("Enter")
    dialog = page.get_by_role("dialog")
    expect(dialog).to_contain_text("The one before does not come back by itself.")
    expect(dialog.get_by_role("button", name="Withdraw", exact=True)).to_be_disabled()
    assert_looks(page)
    page.keyboard.press("Escape")
    expect(dialog).to_have_count(0)
    expect(ask).to_be_focused()
    assert str(track.owner.calibrations.current(given.vehicle, "front").result_id) == given.results[1]
    page.keyboard.press("Enter")
    dialog.get_by_role("textbox").fill("The mast\nwas bent.")
    dialog.get_by_role("button", name="Withdraw", exact=True).click()
    expect(dialog).to_have_count(0)
    expect(page.get_by_role("alert")).to_contain_text("by Zoe")
    expect(page.get_by_role("alert")).to_contain_text("The mast was bent.")
    expect(page.get_by_text("Withdrawn", exact=False).first).to_be_visible()
    expect(page.get_by_role("link", name="Download JSON")).to_have_count(0)
    with pytest.raises(ApiError) as refused:
        track.owner.calibrations.current(given.vehicle, "front")
    assert refused.value.code == "calibration_withdrawn"
    # The way back.
    page.get_by_role("button", name=re.compile("^Publish again")).last.click()
    dialog.get_by_role("textbox").fill("The older one holds.")
    dialog.get_by_role("button", name="Publish").click()
    expect(page.get_by_role("alert")).to_have_count(0)
    assert str(track.owner.calibrations.current(given.vehicle, "front").result_id) == given.results[0]
