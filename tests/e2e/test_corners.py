"""Marking several corners of the board in one frame."""

import pytest
from playwright.sync_api import expect

from tests.e2e.conftest import BOARD, SignIn, Track, recorded
from tests.e2e.marking import Marker
from tests.support.walks import walk


@pytest.fixture
def sized(track: Track) -> Track:
    """A short recording of its own, with a detection that was told the board's size."""
    return recorded(track.owner, track.fleet_id, "Cart with a board of known size", walk("short"), **BOARD)


def test_two_corners_of_a_frame_are_marked_one_after_the_other(sign_in: SignIn, sized: Track) -> None:
    ida = Marker(sign_in("Ida", "engineer"), sized)
    page = ida.page
    page.goto(f"{sized.url}/recordings/{sized.recording_id}?detection={sized.detection_id}")
    panel = page.locator("section.panel", has=ida.link())
    left = panel.get_by_label("left corner")
    expect(panel.get_by_label("top corner")).to_be_checked()
    expect(panel.get_by_label("top corner")).to_be_disabled()
    with page.expect_response("**/v1/detections/*") as asked:
        left.click()
    assert asked.value.ok, asked.value.json()
    expect(left).to_be_checked()

    ida.link().click()
    ida.frame().wait_for()
    ida.ready()
    said = page.locator(".asked")
    seen: list[tuple[str, str]] = []
    clicked: dict[str, tuple[float, float]] = {}
    for turn in range(4):
        corner = said.get_attribute("data-corner") or ""
        expect(said).to_have_text(
            {"top": "Mark the board's top corner", "left": "Mark the board's left corner"}[corner]
        )
        expect(said.locator("circle.filled")).to_have_count(1)
        frame = page.get_by_role("application").get_attribute("aria-label") or ""
        assert ("top corner" if corner == "top" else "left corner") in frame
        seen.append((frame.partition(":")[0], corner))
        clicked[ida.vertex] = ida.click(0.3 + 0.08 * turn, 0.4)
        ida.save()
    assert [corner for _, corner in seen] == ["top", "left", "top", "left"]
    assert seen[0][0] == seen[1][0] != seen[2][0] == seen[3][0]
    stored = ida.own_marks()
    assert stored.keys() == clicked.keys()
    for vertex, pixel in clicked.items():
        assert (stored[vertex]["mark"]["u"], stored[vertex]["mark"]["v"]) == pytest.approx(pixel, abs=0.51)
    ida.undo()
    assert said.get_attribute("data-corner") == "left"

    built = sized.owner.correspondence_sets.build(sized.detection_id, "front")
    pairs = sized.owner.correspondence_sets.get(built.id).pairs
    assert [one.corner for one in pairs].count("left") == 1
    assert len({one.group for one in pairs}) == 2
