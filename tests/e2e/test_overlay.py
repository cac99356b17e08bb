"""A sweep drawn into its frame on a calibration's page: the points that belong there, blinking, saved, by keys."""

import re
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Locator, Page, expect

from apexcal.geometry.se3 import from_document
from apexcal.sweeps import unpack
from tests.e2e.conftest import SignIn, Track
from tests.e2e.looks import PHONE, assert_accessible, assert_fits, show
from tests.e2e.test_calibrating import pairs_of_truth
from tests.faults.jobs import SHORT
from workers.geometry.projection import project

MOVE = "move board and holder to the frame's time"


@pytest.fixture(scope="module")
def calibration_id(track: Track) -> str:
    """A calibration of the simulated camera, from pairs as the truth has them."""
    pairs = track.owner.correspondence_sets.import_pairs(track.rig_id, "front", pairs_of_truth(track, 130))
    wanted = {"models": ["brown_conrady"], "folds": 0, "schedule": SHORT}
    made = track.owner.wait(track.owner.calibrations.create(track.vehicle_id, [pairs.id], **wanted))
    return str(made.id)


def open_overlay(page: Page, track: Track, calibration_id: str) -> Locator:
    page.goto(f"{track.url}/calibrations/{calibration_id}")
    overlay = page.get_by_role("region", name="Points in the frame")
    expect(overlay.locator("canvas")).to_have_attribute("data-points", re.compile("[1-9]"))
    return overlay


def inside_the_image(track: Track, calibration_id: str, sweep: int) -> int:
    """How many points of a sweep the result's lens maps into the image, by workers/geometry."""
    found = track.owner.calibrations.get(calibration_id)
    assert found.summary
    result = track.owner.calibrations.result(found.summary.cameras["front"].models["brown_conrady"].result_id)
    lens = result.intrinsics.model_dump(exclude={"model", "image_size"}, exclude_none=True)
    points = unpack(track.owner.recordings.sweep(track.recording_id, sweep)).xyz
    mounted = from_document(result.transform.model_dump()).apply(points)
    pixels, violation = project("brown_conrady", lens, mounted)
    width, height = track.image_size
    u, v = pixels[violation == 0].T
    return int(((u > -0.5) & (v > -0.5) & (u < width - 0.5) & (v < height - 0.5)).sum())


def test_the_points_of_a_sweep_lie_in_its_frame(sign_in: SignIn, track: Track, calibration_id: str) -> None:
    page = sign_in("Vera", "reviewer")
    overlay = open_overlay(page, track, calibration_id)
    overlay.get_by_label(MOVE).uncheck()
    canvas = overlay.locator("canvas")
    for key in ("ArrowRight", "PageDown"):
        before = canvas.get_attribute("data-frame")
        overlay.get_by_role("slider").press(key)
        expect(canvas).not_to_have_attribute("data-frame", before or "")
    shown = int(canvas.get_attribute("data-points") or 0)
    said = re.search(r"([\d,]+) points, ([\d,]+) more are hidden", overlay.get_by_role("status").inner_text())
    assert said
    drawn, hidden = (int(one.replace(",", "")) for one in said.groups())
    assert drawn == shown > 500
    assert drawn + hidden == inside_the_image(track, calibration_id, int(canvas.get_attribute("data-sweep") or -1))
    # The sweep is the one that was measured nearest to the frame: within half of its 100 ms.
    late = re.search(r"measured ([\d.]+) ms", overlay.get_by_role("status").inner_text())
    assert late and float(late[1]) <= 51


def test_the_board_is_where_it_was_at_the_frames_time(sign_in: SignIn, track: Track, calibration_id: str) -> None:
    page = sign_in("Uwe", "reviewer")
    overlay = open_overlay(page, track, calibration_id)
    said = overlay.get_by_text(re.compile("Board and holder are drawn where they were"))
    expect(said).to_be_visible()
    canvas = overlay.locator("canvas")
    frame, index = (int(canvas.get_attribute(name) or -1) for name in ("data-frame", "data-sweep"))
    moment = next(
        one.stamp_ns for one in track.owner.recordings.frames(track.recording_id, "front") if one.index == frame
    )
    done = [one for one in track.owner.detections.list(track.recording_id) if one.state == "done"]
    detection = max(done, key=lambda one: one.counts.accepted)
    vertices = sorted(track.owner.detections.vertices(detection.id), key=lambda one: one.time_ns)
    after = next(place for place, one in enumerate(vertices) if one.time_ns > moment)
    first, second = ((np.array([one.x, one.y, one.z]), one.time_ns) for one in vertices[after - 1 : after + 1])
    velocity = (second[0] - first[0]) / (second[1] - first[1])
    corner = first[0] + velocity * (moment - first[1])

    sweep = unpack(track.owner.recordings.sweep(track.recording_id, index))
    stamp = next(one.stamp_ns for one in track.owner.recordings.sweeps(track.recording_id) if one.index == index)
    later = moment - (stamp + sweep.offset_ns)
    there = sweep.xyz + later[:, None] * velocity
    above = there[:, 2] - corner[2]
    board = (np.linalg.norm(there[:, :2] - corner[:2], axis=1) <= 0.55) & (above <= 0.1) & (above >= -1.1)
    farthest = np.abs(later[board]).max() * np.linalg.norm(velocity)
    found = re.search(r"([\d,]+) points moved by up to\s+([\d.]+) cm", said.inner_text(), re.DOTALL)
    assert found and int(found[1].replace(",", "")) == pytest.approx(board.sum(), abs=1)
    assert float(found[2]) == pytest.approx(100 * farthest, abs=0.11)
    overlay.get_by_label(MOVE).uncheck()
    expect(said).to_have_count(0)


def test_the_mounts_blink(sign_in: SignIn, track: Track, calibration_id: str) -> None:
    page = sign_in("Walt", "reviewer")
    overlay = open_overlay(page, track, calibration_id)
    picture = overlay.get_by_role("img")
    ways = overlay.get_by_role("group", name="Drawn through")
    ways.get_by_role("button", name="Nominal mount").focus()
    page.keyboard.press("Enter")
    expect(picture).to_have_attribute("aria-label", re.compile("Nominal mount"))
    ways.get_by_role("button", name="Frame alone").click()
    expect(overlay.locator("canvas")).to_have_attribute("data-points", "0")
    ways.get_by_role("button", name="This result").click()
    overlay.get_by_role("button", name="Blink").click()
    for pressed in ("Frame alone", "This result", "Frame alone"):
        expect(ways.get_by_role("button", pressed=True)).to_have_text(pressed)
    overlay.get_by_role("button", name="Stop").click()
    with page.expect_download() as saved:
        overlay.get_by_role("button", name="Save as PNG").click()
    assert Path(saved.value.path()).read_bytes().startswith(b"\x89PNG")
    for view in PHONE:
        show(page, view)
        assert_accessible(page, "section[aria-labelledby=overlay]")
    assert_fits(page)


def test_annotators_are_not_shown_where_the_board_is(sign_in: SignIn, track: Track, calibration_id: str) -> None:
    page = sign_in("Xena", "annotator")
    page.goto(f"{track.url}/calibrations/{calibration_id}")
    expect(page.get_by_role("heading", name=re.compile("^[a-z]+: brown_conrady$"))).to_be_visible()
    page.wait_for_load_state("networkidle")
    expect(page.get_by_role("region", name="Points in the frame")).to_have_count(0)
