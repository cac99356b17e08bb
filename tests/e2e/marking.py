"""A person at the marking page, as the tests drive one."""

from __future__ import annotations

import math
from typing import Any

from playwright.sync_api import Page, Response

from tests.e2e.conftest import Track


class Marker:
    """The marking page of one person. Everything that their browser is told from ``open`` on is kept."""

    def __init__(self, page: Page, track: Track) -> None:
        self.page = page
        self.track = track
        self._responses: list[Response] = []
        # Marks that the page asked about.
        self.kept = 0
        # Bodies are read later: a handler that waits for one would keep other events from whoever waits for them.
        page.on("response", lambda response: self._responses.append(response))

    def open(self) -> None:
        """Go to the recording and follow its link."""
        self.page.goto(f"{self.track.url}/recordings/{self.track.recording_id}?detection={self.track.detection_id}")
        self._responses.clear()
        self.link().click()
        self.frame().wait_for()
        self.ready()

    def received(self) -> list[str]:
        """Every JSON text that the browser has got."""
        told = [one for one in self._responses if "application/json" in one.headers.get("content-type", "")]
        return [one.text() for one in told]

    def link(self) -> Any:
        """The link on the recording's page that leads to the track's own detection."""
        return self.page.locator(f'a[href^="/detections/{self.track.detection_id}/mark"]')

    def leased(self) -> set[str]:
        """Every vertex that the person was given, those ahead included."""
        asked = [one for one in self._responses if one.url.endswith("/tasks/next") and one.status == 200]
        told = [one.json() for one in asked]
        return {one["vertex"]["id"] for first in told for one in (first, *first["ahead"])}

    @property
    def vertex(self) -> str:
        """The vertex that is shown."""
        return self.page.locator(".work > .stage").get_attribute("data-vertex") or ""

    def view(self) -> Any:
        """Where the frame is shown and marked."""
        return self.page.get_by_role("application", name="Camera frame")

    def frame(self) -> Any:
        """The camera frame's element."""
        return self.view().locator("img")

    def pixel(self, x: float, y: float) -> tuple[float, float]:
        """What lies at page position (x, y), by the image element alone: p / scale - 0.5 (SPEC.md)."""
        box = self.frame().bounding_box()
        width, height = self.track.image_size
        return (x - box["x"]) / box["width"] * width - 0.5, (y - box["y"]) / box["height"] * height - 0.5

    def whole(self) -> None:
        """Show the whole frame."""
        frame, view = self.frame().bounding_box(), self.view().bounding_box()
        if frame["width"] > 1.01 * view["width"] or frame["height"] > 1.01 * view["height"]:
            self.page.keyboard.press("0")

    def click(self, across: float, down: float, *, exact: bool = False) -> tuple[float, float]:
        """Click at a fraction of the viewport, and return the pixel that lies there.

        A frame that opened about an expected corner is clicked near it unless ``exact``, so that nothing is asked.
        """
        box = self.view().bounding_box()
        assert box is not None
        if not exact and self.view().get_attribute("data-near"):
            across, down = 0.5 + 0.1 * (across - 0.5), 0.5 + 0.1 * (down - 0.5)
        x, y = math.floor(box["x"] + across * box["width"]), math.floor(box["y"] + down * box["height"])
        self.page.mouse.click(x, y)
        return self.pixel(x, y)

    def click_pixel(self, u: float, v: float) -> tuple[float, float]:
        """Click where a pixel of the frame is shown, and return the pixel that was clicked."""
        width, height = self.track.image_size
        frame, view = self.frame().bounding_box(), self.view().bounding_box()
        x = frame["x"] + (u + 0.5) * frame["width"] / width
        y = frame["y"] + (v + 0.5) * frame["height"] / height
        return self.click((x - view["x"]) / view["width"], (y - view["y"]) / view["height"], exact=True)

    def reload(self) -> None:
        """Load the page anew and wait until it takes an answer."""
        self.page.reload()
        self.frame().wait_for()
        self.ready()

    def shown(self) -> int:
        """How many marks lie on the shown frame."""
        return self.view().locator("svg g.ink").count()

    def save(self, key: str = "Enter") -> dict[str, Any]:
        """Press a key that answers; wait for the answer and for the next task. Returns the answer's body."""
        with self.page.expect_response("**/answer") as answered:
            self.page.keyboard.press(key)
            self.keep(key)
        body: dict[str, Any] = answered.value.json()
        assert answered.value.ok, body
        self.ready()
        return body

    def keep(self, key: str = "Enter") -> None:
        """Keep a mark that the page asks about."""
        if key == "Enter" and self.page.get_by_text("Is this the corner?").is_visible():
            self.page.keyboard.press("k")
            self.kept += 1

    def undo(self) -> None:
        """Take the last answer back."""
        with self.page.expect_response("**/undo") as undone:
            self.page.keyboard.press("z")
        assert undone.value.ok, undone.value.json()
        self.page.get_by_text("was taken back").wait_for()
        self.ready()

    def ready(self) -> None:
        """Wait until the page takes an answer."""
        self.page.get_by_role("button", name="Reject").and_(self.page.locator(":enabled")).wait_for()

    def own_marks(self) -> dict[str, dict[str, Any]]:
        """The person's stored marks, as the API tells them, by vertex."""
        answer = self.page.request.get(f"{self.track.url}/v1/detections/{self.track.detection_id}/marks?camera=front")
        return {item["vertex_id"]: item for item in answer.json()["items"]}
