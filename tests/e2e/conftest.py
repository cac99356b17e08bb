"""The real service with a real, small recording in it, and a browser to look at it."""

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from uuid import UUID

import pytest
from playwright.sync_api import Browser, Page, expect, sync_playwright

from apexcal.client import Client
from apexcal.documents.machine_marks import MachineMark, MarksView
from apexcal.rigs import read_rig
from tests.e2e.chromium import find_chromium
from tests.support.asking import leave_marks_to_people
from tests.support.places import ROOT
from tests.support.served import Embedded, serving
from tests.support.walks import walk
from workers.simulation.walker import BOARD_EDGES_M

BOARD = {"board_width_m": BOARD_EDGES_M[0], "board_height_m": BOARD_EDGES_M[1]}
SignIn = Callable[[str, str], Page]
WEB = ROOT / "service" / "web" / "index.html"


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if Path(__file__).parent in item.path.parents:
            item.add_marker("e2e")


@dataclass(frozen=True)
class Track:
    """A served fleet with one vehicle, one rig and one recording that has been ingested and searched for vertices."""

    url: str
    owner: Client
    fleet_id: str
    vehicle_id: str
    recording_id: str
    detection_id: str
    rig_id: str
    truth: dict[str, Any]
    image_size: tuple[int, int]


@pytest.fixture(scope="package")
def simulated() -> Path:
    """A folder with recording.bag and rig.json."""
    return walk("plain")


@pytest.fixture(scope="package")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Embedded]:
    """`apexcal serve` on an empty folder."""
    assert WEB.exists(), "the pages are not built: run `make frontend`"
    with serving(tmp_path_factory.mktemp("served") / "data", "--workers", "1") as embedded:
        yield embedded


@pytest.fixture(scope="package")
def track(served: Embedded, simulated: Path) -> Iterator[Track]:
    """The service after an upload, an ingestion and a detection over HTTP."""
    with Client(served.url, served.token) as owner:
        yield recorded(owner, owner.fleets.create("Test track").id, "Van 7", simulated)


def recorded(
    owner: Client, fleet_id: UUID | str, name: str, walk: Path, *, machine_marks: bool = False, **options: float
) -> Track:
    """A vehicle of its own with the walk, read and searched for vertices; marked by the machine if asked."""
    vehicle = owner.vehicles.create(fleet_id, name)
    rig = owner.vehicles.create_rig(vehicle.id, read_rig(walk / "rig.json", "roof"))
    recording = owner.wait(owner.recordings.upload(walk / "recording.bag", vehicle.id, rig.id))
    region = json.loads((walk / "region.json").read_text())
    detection = owner.wait(owner.detections.create(recording.id, region, options=options))
    assert detection.counts.paired >= 10, detection.counts
    if not machine_marks:
        leave_marks_to_people(owner, recording.id)
    width, height = rig.cameras[0].image_size
    ids = (str(id) for id in (fleet_id, vehicle.id, recording.id, detection.id, rig.id))
    return Track(owner.base_url, owner, *ids, json.loads((walk / "truth.json").read_text()), (width, height))


@pytest.fixture(scope="package")
def marked(track: Track, simulated: Path) -> tuple[Track, dict[str, MachineMark]]:
    """A recording of its own whose vertices the machine has marked, and its marks by vertex."""
    owner = track.owner
    own = recorded(owner, track.fleet_id, "Marked by the machine", simulated, machine_marks=True, **BOARD)
    (analysis,) = owner.analyses.list(MarksView, recording_id=own.recording_id)
    analysis = owner.wait(analysis)
    marks = {str(one.vertex_id): one for one in owner.analyses.marks(analysis.id) if one.reason is None}
    assert len(marks) >= 30, analysis.result
    return own, marks


@pytest.fixture(scope="package")
def browser() -> Iterator[Browser]:
    """A Chromium."""
    chromium = find_chromium()
    expect.set_options(timeout=60_000)
    with sync_playwright() as playwright:
        opened = playwright.chromium.launch(
            executable_path=chromium.executable, env=dict(chromium.environment), args=["--no-sandbox"]
        )
        yield opened
        opened.close()


@pytest.fixture
def sign_in(browser: Browser, track: Track) -> Iterator[SignIn]:
    """Signs an invited person in, in a browser context of their own; returns a page of it that shows nothing yet.

    The button that takes a link is tested in ``test_pages.py``. A page that threw an error, or asked for something
    that its content policy forbids, fails the test.
    """
    contexts = []
    complaints: list[str] = []

    def enter(name: str, role: str) -> Page:
        context = browser.new_context(viewport={"width": 1280, "height": 800})
        context.set_default_timeout(60_000)
        contexts.append(context)
        link = track.owner.fleets.invite(track.fleet_id, name, role).link
        answer = context.request.post(f"{track.url}/v1/sign-in", data={"link": link}, headers={"Origin": track.url})
        assert answer.ok, answer.text()
        page = context.new_page()
        page.on("pageerror", lambda error: complaints.append(f"{name}: {error}"))
        page.on("console", lambda said: complaints.append(said.text) if "Content Security" in said.text else None)
        return page

    yield enter
    for context in contexts:
        context.close()
    assert complaints == []
