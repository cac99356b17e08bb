"""Confirming the machine's marks in a browser: who looks comes to the end, who does not is told so."""

import re
from itertools import pairwise
from math import dist
from typing import Any

from playwright.sync_api import Page, Response, expect

from apexcal.documents.machine_marks import MachineMark
from tests.e2e.conftest import SignIn, Track
from tests.e2e.marking import Marker


class Confirmer:
    """A person at the page of crops, who knows where the machine's marks are."""

    def __init__(self, page: Page, track: Track, marks: dict[str, MachineMark]) -> None:
        self.page, self.track, self.marks = page, track, marks
        self.sheets: list[Response] = []
        page.on("response", self._note)

    def _note(self, response: Response) -> None:
        if response.url.endswith("/crops/next") and response.status == 200:
            self.sheets.append(response)

    def open(self) -> None:
        """Go to the crops by the link in the detection's panel."""
        self.page.goto(f"{self.track.url}/recordings/{self.track.recording_id}?step=detection")
        self.page.get_by_role("link", name=re.compile("^Confirm")).click()

    def mark_blind(self, marker: Marker) -> None:
        """Mark frames, where the machine does, until the page shows crops. Where a frame opens is drawn."""
        for count in range(12):
            # Where the machine has no mark, a blind one measures nothing: then the page asks for more.
            expect(
                self.page.get_by_role("button", name="Accept").or_(self.page.get_by_text("yourself first"))
            ).to_be_visible()
            if not self.page.get_by_text("yourself first").is_visible():
                break
            self.page.keyboard.press("Enter")
            for _ in range(1 if count else 5):
                marker.frame().wait_for()
                marker.ready()
                shown = marker.vertex
                if mark := self.marks.get(shown):
                    marker.click_pixel(mark.u or 0.0, mark.v or 0.0)
                else:
                    marker.click(0.5, 0.5)
                with self.page.expect_response("**/answer") as answered:
                    self.page.keyboard.press("Enter")
                    marker.keep()
                assert answered.value.ok and not answered.value.json()["reviewed"]
                self.page.wait_for_function(
                    "shown => document.querySelector('.stage')?.dataset.vertex !== shown", arg=shown
                )

    def ready(self) -> None:
        """Wait until the page takes an answer."""
        expect(self.page.get_by_role("button", name="Accept")).to_be_enabled()

    def shifted(self) -> list[str]:
        """The vertices of the shown page whose marks are not where the machine has them."""
        crops = self.sheets[-1].json()["crops"]
        marks = [self.marks[one["vertex_id"]] for one in crops]
        own = {str(mark.vertex_id): (mark.u or 0.0, mark.v or 0.0) for mark in marks}
        # The page rounds to a thousandth of a pixel.
        return [one["vertex_id"] for one in crops if dist((one["u"], one["v"]), own[one["vertex_id"]]) > 0.01]

    def tile(self, vertex: str) -> Any:
        """The crop of a vertex."""
        return self.page.locator(f'[data-vertex="{vertex}"]')

    def accept(self) -> dict[str, Any]:
        """Press Enter; the service's verdict."""
        with self.page.expect_response("**/crop-pages/*/answer") as answered:
            self.page.keyboard.press("Enter")
        verdict: dict[str, Any] = answered.value.json()
        assert answered.value.ok, verdict
        return verdict

    def confirm_all(self) -> None:
        """Go through the pages to the end with the keyboard: a key for each crop, one more for each shifted mark."""
        accept, ended = self.page.get_by_role("button", name="Accept"), self.page.get_by_text("No mark is left")
        self.page.evaluate("window.keys = 0; addEventListener('keydown', key => void (keys += key.isTrusted), true)")
        allowed = 0
        for _ in range(15):
            expect(accept.and_(self.page.locator(":enabled")).or_(ended)).to_be_visible()
            if ended.is_visible():
                print("keys:", self.page.evaluate("keys"), "of", allowed)
                assert 0 < self.page.evaluate("keys") <= allowed
                return
            crops = [one["vertex_id"] for one in self.sheets[-1].json()["crops"]]
            expect(self.tile(crops[0])).to_be_focused()
            shifted = self.shifted()
            for before, vertex in pairwise([crops[0], *shifted]):
                for _ in range(crops.index(vertex) - crops.index(before)):
                    self.page.keyboard.press("Tab")
                expect(self.tile(vertex)).to_be_focused()
                self.page.keyboard.press(" ")
            allowed += len(crops) + len(shifted)
            assert self.accept()["accepted"]
        raise AssertionError("the pages of crops do not end")


def test_who_accepts_everything_is_told_so_and_who_looks_comes_to_the_end(
    sign_in: SignIn, marked: tuple[Track, dict[str, MachineMark]]
) -> None:
    track, marks = marked
    page = sign_in("Cora", "annotator")
    cora, marker = Confirmer(page, track, marks), Marker(page, track)
    cora.open()
    # Other tests may have marked some of its frames blind before.
    address = f"{track.url}/v1/detections/{track.detection_id}/crops?camera=front"
    if needed := page.request.get(address).json()["blind_needed"]:
        expect(page.get_by_role("heading", name=f"Mark {needed} frames yourself first")).to_be_visible()
    cora.mark_blind(marker)
    cora.ready()
    first = cora.shifted()
    verdict = cora.accept()
    assert (verdict["accepted"], verdict["missed"]) == (False, len(first))
    expect(page.get_by_test_id("verdict")).to_contain_text("You accepted every mark of the page, but the service had")
    assert "shifted" not in cora.sheets[0].text()

    cora.ready()
    # A long press opens the frame of a crop; from there to its marking and back.
    opened, *others = cora.shifted()
    cora.tile(opened).click(delay=700)
    expect(page.get_by_role("dialog").get_by_role("application")).to_be_visible()
    page.keyboard.press("m")
    marker.frame().wait_for()
    marker.ready()
    assert marker.vertex == opened
    marker.click(0.5, 0.5)
    page.keyboard.press("Enter")
    marker.keep()
    cora.ready()
    expect(cora.tile(opened)).to_have_attribute("data-wrong", "true")
    assert marker.own_marks()[opened]["reviewed"]
    # One tap flags, another takes that back.
    by_mouse, *by_keyboard = others
    for flagged in ("true", "false", "true"):
        cora.tile(by_mouse).click()
        expect(cora.tile(by_mouse)).to_have_attribute("data-wrong", flagged)
    for vertex in by_keyboard:
        cora.tile(vertex).focus()
        page.keyboard.press("w")
    expect(page.get_by_test_id("wrong")).to_contain_text(f"{1 + len(others)} of ")
    page.reload()
    cora.ready()
    expect(page.get_by_test_id("wrong")).to_contain_text(f"{1 + len(others)} of ")
    page.context.set_offline(True)
    page.keyboard.press("Enter")
    expect(page.get_by_text("The service does not answer.")).to_be_visible()
    expect(page.get_by_text("Your answer is kept in this browser.")).to_be_visible()
    page.context.set_offline(False)
    assert cora.accept()["accepted"]
    cora.confirm_all()
    # Cora's, and those of other tests.
    given = track.owner.marking.marks(track.detection_id, "front")
    by_hand = {str(one.vertex_id) for one in given if one.verdict == "confirmed" and not one.is_machine}
    progress = track.owner.marking.crop_progress(track.detection_id, "front")
    assert progress.judged == progress.marks == len(marks)

    built = track.owner.correspondence_sets.build(track.detection_id, "front")
    pairs = track.owner.correspondence_sets.get(built.id).pairs
    assert sum(bool(pair.confirmed) for pair in pairs) == len(marks) - len(by_hand & marks.keys())
