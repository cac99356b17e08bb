"""A detection judged sweep by sweep: found, uncertain and refused, the corner in 3D, the frame beside it."""

import re

import pytest
from playwright.sync_api import Locator, Page, expect

from apexcal.documents.detectors import DETECTORS
from tests.e2e.conftest import SignIn, Track
from tests.e2e.looks import PHONE, assert_accessible, assert_fits, show


@pytest.fixture(scope="module")
def narrow_id(track: Track) -> str:
    """A detection by the paper's rule, which refuses many sweeps, in a region that the board leaves."""
    whole = track.owner.detections.get(track.detection_id).region
    region = whole | {"all": [*whole["all"], {"quantity": "y", "op": ">", "value": 0}]}
    made = track.owner.detections.create(track.recording_id, region, detector="strict")
    done = track.owner.wait(made)
    assert done.counts.accepted > 0 and done.counts.rejected
    return str(done.id)


def open_judged(page: Page, track: Track, detection_id: str) -> Locator:
    """The time axis of a recording, as one of its detections has it."""
    page.goto(f"{track.url}/recordings/{track.recording_id}?detection={detection_id}")
    axis = page.locator("section[data-sweep]")
    expect(axis.get_by_role("slider", name="Sweep")).to_be_visible()
    return axis


def test_every_sweep_has_its_verdict(sign_in: SignIn, track: Track, narrow_id: str) -> None:
    page = sign_in("Zoe", "viewer")
    panel = open_judged(page, track, narrow_id)
    counts = track.owner.detections.get(narrow_id).counts
    kinds = panel.get_by_role("group", name="Next sweep of a kind").get_by_role("button")
    # Each is told by a shape, a word and a colour.
    texts = [text.split(None, 1)[1] for text in kinds.all_inner_texts()]
    said = {name: int(count) for name, count in (text.rsplit(None, 1) for text in texts)}
    assert {name: count for name, count in said.items() if name.startswith("refused")} == {
        f"refused: {reason.replace('_', ' ')}": count for reason, count in counts.rejected.items()
    }
    assert sum(said.values()) == counts.sweeps

    reason, runs = next(iter(counts.refused_sweeps.items()))
    refused = panel.get_by_role("button", name=f"refused: {reason.replace('_', ' ')}")
    refused.click()
    status = panel.get_by_role("status").first
    expect(status).to_contain_text(f"refused: {reason.replace('_', ' ')}")
    expect(status).to_contain_text(DETECTORS["strict"].reasons[reason])
    shown = int(panel.get_attribute("data-sweep") or -1)
    assert any(first <= shown <= last for first, last in runs)
    # Also a refused sweep is seen, with the frame of its moment.
    expect(panel.get_by_role("application")).to_have_attribute("data-sweeps", str(shown))
    expect(panel.get_by_role("img", name=re.compile("^Frame"))).to_be_visible()


def test_a_click_on_the_track_shows_sweep_corner_and_frame(sign_in: SignIn, track: Track) -> None:
    page = sign_in("Arne", "annotator")
    panel = open_judged(page, track, track.detection_id)
    plot = panel.get_by_role("img", name="Verdicts of the sweeps")
    box = plot.bounding_box()
    assert box
    plot.click(position={"x": 0.6 * box["width"], "y": 0.4 * box["height"]})
    first = min(one.sweep_index for one in track.owner.detections.vertices(track.detection_id))
    expect(panel).not_to_have_attribute("data-sweep", str(first))
    shown = int(panel.get_attribute("data-sweep") or -1)
    vertices = {one.sweep_index: one for one in track.owner.detections.vertices(track.detection_id)}
    vertex = vertices[shown]
    status = panel.get_by_role("status").first
    expect(status).to_contain_text(f"Corner at x {vertex.x:.3f}, y {vertex.y:.3f}, z {vertex.z:.3f} m")
    assert vertex.covariance
    expect(status).to_contain_text(f"{1000 * vertex.covariance[2][2] ** 0.5:.1f} mm along it")
    expect(panel.get_by_role("img", name=f"Frame {vertex.frames['front'].index} of front")).to_be_visible()
    expect(panel.get_by_role("application")).to_have_attribute("data-sweeps", str(shown))
    # The plot's axes say what they are, in which unit.
    for title in ("x, m", "y, m", "z, m", "time into the recording, s"):
        expect(panel.get_by_text(title, exact=True)).to_be_visible()
    panel.get_by_role("slider", name="Sweep").press("ArrowRight")
    expect(panel).to_have_attribute("data-sweep", str(shown + 1))
    for view in PHONE:
        show(page, view)
        assert_accessible(page, "section[data-sweep]")
    assert_fits(page)
