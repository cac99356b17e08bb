"""Pictures of every page in light and dark at three widths: `make screenshots`, to be looked at.

Those of 1280 px go to docs/images/pages, all others to var/screenshots. No page may be wider than its window.
``ONLY=result,vehicle`` makes those of some pages.
"""

import os
import re

import pytest
from PIL import Image
from playwright.sync_api import Page, expect

from apexcal.documents.machine_marks import MachineMark
from tests.e2e.conftest import SignIn, Track
from tests.e2e.marking import Marker
from tests.e2e.test_calibrating import pairs_of_truth
from tests.e2e.test_crops import Confirmer
from tests.e2e.test_marking import ask_marks
from tests.e2e.test_marking_beside import ASIDE_PX, click_corner
from tests.e2e.test_workspace import DRAWERS
from tests.support.places import ROOT

SIZES = {390: 844, 1280: 900, 1920: 1080}
DOCUMENTED = 1280
pytestmark = pytest.mark.timeout(1200)


@pytest.fixture(scope="module")
def paths(track: Track) -> dict[str, str]:
    """Addresses of the pages, by the names of their pictures, with something to see on each."""
    owner = track.owner
    ask_marks(track, 2)
    pairs = owner.correspondence_sets.import_pairs(track.rig_id, "front", pairs_of_truth(track, 130))
    wanted = {"models": ["pinhole", "brown_conrady"], "folds": 3}
    # Earlier results: something to compare with, and lines of drift.
    for count in (110, 120, 125):
        made = owner.correspondence_sets.import_pairs(track.rig_id, "front", pairs_of_truth(track, count))
        plain = {"models": ["brown_conrady"], "folds": 2}
        owner.wait(owner.calibrations.create(track.vehicle_id, [made.id], **plain))
    calibration = owner.wait(owner.calibrations.create(track.vehicle_id, [pairs.id], **wanted))
    front = calibration.summary.cameras["front"]
    # Its marks cover half of the image, so it is not published by itself.
    owner.calibrations.publish(front.models[front.recommended].result_id, "to be looked at", override=True)
    owner.wait(owner.analyses.validate_on_pairs(pairs.id))
    request = owner.fleet_requests.create(track.fleet_id, models=["pinhole"], folds=0)
    owner.wait(request)
    owner.vehicles.create(track.fleet_id, "Van 8")
    return {
        "fleet": f"/fleets/{track.fleet_id}",
        "fleet-requests": f"/fleets/{track.fleet_id}/requests",
        "fleet-request": f"/fleet-requests/{request.id}",
        "vehicle": f"/vehicles/{track.vehicle_id}",
        "recording": f"/recordings/{track.recording_id}",
        **{step: f"/recordings/{track.recording_id}?step={step}" for step in DRAWERS},
        "result": f"/calibrations/{calibration.id}",
        "comparison": f"/calibrations/{calibration.id}",
    }


def take(page: Page, name: str, scheme: str, width: int, *, full: bool) -> None:
    """Write a picture; the page has come to rest."""
    page.wait_for_load_state("networkidle")
    page.wait_for_timeout(1000)  # what is drawn later: points, plots
    assert page.evaluate("document.scrollingElement.scrollWidth") <= width, (name, width)
    documented = width == DOCUMENTED
    folder = ROOT / ("docs/images/pages" if documented else "var/screenshots")
    folder.mkdir(parents=True, exist_ok=True)
    end = scheme if documented else f"{scheme}-{width}"
    file = folder / f"{name}-{end}.png"
    page.screenshot(path=file, full_page=full)
    Image.open(file).convert("RGB").quantize(256).save(file, optimize=True)  # a third of the bytes


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_pages(sign_in: SignIn, track: Track, paths: dict[str, str], scheme: str) -> None:
    page = sign_in(f"Ida {scheme}", "engineer")
    page.emulate_media(color_scheme=scheme)  # pyright: ignore[reportArgumentType]
    only = [name for name in os.environ.get("ONLY", "").split(",") if name]
    for width, height in SIZES.items():
        page.set_viewport_size({"width": width, "height": height})
        for name, path in paths.items():
            if only and name not in only:
                continue
            page.goto(f"{track.url}{path}")
            expect(page.get_by_role("heading", level=1)).to_be_visible()
            if name == "comparison":
                page.get_by_text("Compare with", exact=True).click()
                others = page.get_by_label("This result minus")
                expect(others).to_be_visible()
                others.select_option(index=others.locator("option").count() - 1)  # the oldest
                expect(page.get_by_role("img", name=re.compile("Differences over the image"))).to_be_visible()
            take(page, name, scheme, width, full=True)


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_marking(sign_in: SignIn, marked: tuple[Track, dict[str, MachineMark]], scheme: str) -> None:
    track, marks = marked
    ask_marks(track, 50)
    marker = Marker(sign_in(f"Jan {scheme}", "annotator"), track)
    marker.page.emulate_media(color_scheme=scheme)  # pyright: ignore[reportArgumentType]
    marker.open()
    for _ in range(14):
        click_corner(marker)
        marker.save()
    while marker.vertex not in marks:
        marker.save("u")
    click_corner(marker, ASIDE_PX)
    marker.page.keyboard.press("Enter")
    expect(marker.page.get_by_text("Is this the corner?")).to_be_visible()
    marker.page.keyboard.press("l")
    for width, height in SIZES.items():
        marker.page.set_viewport_size({"width": width, "height": height})
        take(marker.page, "mark", scheme, width, full=False)


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_crops(sign_in: SignIn, marked: tuple[Track, dict[str, MachineMark]], scheme: str) -> None:
    track, marks = marked
    page = sign_in(f"Cora {scheme}", "annotator")
    page.emulate_media(color_scheme=scheme)  # pyright: ignore[reportArgumentType]
    confirmer = Confirmer(page, track, marks)
    confirmer.open()
    confirmer.mark_blind(Marker(page, track))
    confirmer.ready()
    # Told that it accepted everything.
    confirmer.accept()
    confirmer.ready()
    for width, height in SIZES.items():
        page.set_viewport_size({"width": width, "height": height})
        take(page, "crops", scheme, width, full=True)
