"""Each page at every state of the work that it shows: no text before its value is there, no error, nothing too wide.

States are written into the rows of a real service whose worker is frozen. With ``PICTURES=folder`` each page is
pictured in light and dark at three widths, to be looked at; ``ONLY=calibration,marking`` visits some.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from datetime import timedelta
from pathlib import Path
from typing import Any
from uuid import UUID

import pytest
from playwright.sync_api import ConsoleMessage, Page, expect
from sqlalchemy import select

from apexcal.client import Client
from apexcal.documents.machine_marks import MarksView
from service.platform.db import models
from service.platform.db.base import Base
from service.platform.db.clock import utc_now
from service.platform.db.session import Database
from tests.e2e.conftest import BOARD, SignIn, Track, recorded
from tests.e2e.looks import CROSSED, DRAWN, assert_fits, show
from tests.e2e.test_calibrating import add_cart
from tests.e2e.test_workers import stopped
from tests.faults.jobs import SHORT
from tests.support.served import Embedded

PROBLEM = {
    "code": "damaged_file",
    "detail": "The file ends in the middle of a message, 12 MB from its beginning.",
    "hint": "Copy it again from the vehicle, and compare the sizes.",
}
REFUSAL = "The board's edges were found in 21 of 64 frames only."
# What was no value as it was shown: a name of nothing, a library's own words, nanoseconds or milliseconds since 1970.
UNREADY = (
    r"\bNaN\b|\bundefined\b|\bnull\b|\bNone\b(?! (published )?yet)|\bInvalid Date"
    r"|Value error|\[object |\b1[5-9]\d{8,}"
)
WATCHING = f"""(() => {{
  window.unready = [];
  const look = () => {{
    for (const line of (document.body?.innerText ?? "").split("\\n"))
      if (/{UNREADY}/.test(line) && !window.unready.includes(line)) window.unready.push(line);
  }};
  new MutationObserver(() => requestAnimationFrame(look)).observe(document, {{
    subtree: true, childList: true, characterData: true }});
  const send = window.fetch;
  window.fetch = async (...sent) => {{
    const late = new URLSearchParams(location.hash.slice(1)).get("late");
    const {{ pathname }} = new URL(sent[0].url ?? String(sent[0]), location.href);
    if (late && pathname.endsWith("/" + late)) await new Promise((go) => setTimeout(go, 700));
    return send(...sent);
  }};
}})()"""
# A refusal is an answer; whatever else a browser complains of is not.
REFUSED = re.compile(r"the server responded with a status of 4\d\d")


@dataclass(frozen=True)
class Change:
    """A row as it is while a page is looked at. A job is the newest of its subject's."""

    table: type[Base]
    id: Any
    columns: dict[str, Any]


@dataclass(frozen=True)
class State:
    """A page's address and what it is to be seen with."""

    name: str
    path: str
    changes: tuple[Change, ...] = ()
    says: str = ""
    role: str = "engineer"


@dataclass
class Stage:
    """The rows that the states are written into: of a fleet of their own, for others look at theirs."""

    track: Track
    database: Database
    marks_id: Any
    calibration_id: str
    request_id: str
    states: list[State] = field(default_factory=list)

    def job_of(self, subject_id: Any) -> Any:
        with self.database.reading() as session:
            jobs = (
                select(models.Job.id)
                .where(models.Job.subject_id == UUID(str(subject_id)))
                .order_by(models.Job.id.desc())
            )
            return session.scalars(jobs).first()

    def at_work(
        self, table: type[Base], id: Any, state: str, message: str = "", **columns: Any
    ) -> tuple[Change, ...]:
        """A row and its job, queued or running."""
        running = state != "queued"
        job = {
            "state": "running" if running else "queued",
            "progress": {"fraction": 0.4, "message": message} if running else None,
            "lease_until": utc_now() + timedelta(hours=1) if running else None,
            "started_at": utc_now() if running else None,
            "finished_at": None,
        }
        changes = [Change(table, id, {"state": state, **columns})]
        if (job_id := self.job_of(id)) is not None:
            changes.append(Change(models.Job, job_id, job))
        return tuple(changes)


@contextmanager
def altered(database: Database, change: Change) -> Iterator[None]:
    """A row with other columns for a block."""

    def write(columns: dict[str, Any]) -> dict[str, Any]:
        with database.writing() as session:
            id = change.id if isinstance(change.id, int) else UUID(str(change.id))
            row = session.get_one(change.table, id)
            before = {name: getattr(row, name) for name in columns}
            for name, value in columns.items():
                setattr(row, name, value)
        return before

    before = write(change.columns)
    try:
        yield
    finally:
        write(before)


@pytest.fixture(scope="module")
def track(served: Embedded, simulated: Path) -> Iterator[Track]:
    """In the place of the track that the other pages share: people sign in to this one's fleet."""
    with Client(served.url, served.token) as owner:
        own = recorded(owner, owner.fleets.create("States").id, "Van 8", simulated, machine_marks=True, **BOARD)
        (analysis,) = owner.analyses.list(MarksView, recording_id=own.recording_id)
        owner.wait(analysis)
        yield own


@pytest.fixture(scope="module")
def stage(track: Track, served: Embedded) -> Iterator[Stage]:
    owner = track.owner
    vehicle, pairs = add_cart(track, "Carriage", 60)
    wanted = {"folds": 3, "publish": "none", "schedule": SHORT}
    calibration = owner.wait(owner.calibrations.create(vehicle, [pairs], ["pinhole"], **wanted))
    request = owner.fleet_requests.create(track.fleet_id, {"vehicle_ids": [vehicle]}, models=["pinhole"], folds=0)
    owner.wait(request)
    database = Database(f"sqlite:///{served.data / 'apexcal.db'}")
    with database.reading() as session:
        of_marks = select(models.Analysis.id).where(
            models.Analysis.kind == "machine_marks", models.Analysis.detection_id == UUID(track.detection_id)
        )
        marks_id = session.scalars(of_marks).first()
    yield Stage(track, database, marks_id, str(calibration.id), str(request.id))
    database.close()


def recordings(stage: Stage) -> Iterator[State]:
    id, vehicle = stage.track.recording_id, f"/vehicles/{stage.track.vehicle_id}"
    path, row = f"/recordings/{id}", models.Recording
    changes = {
        "uploading": (Change(row, id, {"state": "uploading", "size": 0}),),
        "queued": stage.at_work(row, id, "queued"),
        "reading": stage.at_work(row, id, "ingesting", "reading 400 of 900 sweeps"),
        "failed": (Change(row, id, {"state": "failed", "problem": PROBLEM}),),
        "ready": (),
        "thinned": (Change(row, id, {"layers_gone": 3}),),
    }
    for name, change in changes.items():
        yield State(f"recording-{name}", path, change, PROBLEM["detail"] if name == "failed" else "")
        yield State(f"vehicle-{name}", vehicle, change)
    for step in ("region", "calibration", "facts"):
        yield State(f"recording-{step}", f"{path}?step={step}")
    for late in ("sweeps", "frames", "vertices", "progress"):
        yield State(f"recording-late-{late}", f"{path}#late={late}")


def detections(stage: Stage) -> Iterator[State]:
    id, row = stage.track.detection_id, models.Detection
    path = f"/recordings/{stage.track.recording_id}"
    yield State("detection-queued", path, stage.at_work(row, id, "queued"))
    yield State("detection-running", path, stage.at_work(row, id, "running", "looking at sweep 30 of 120"))
    yield State(
        "detection-failed", path, (Change(row, id, {"state": "failed", "problem": PROBLEM}),), PROBLEM["hint"]
    )
    yield State("detection-cancelled", path, (Change(row, id, {"state": "cancelled"}),), "was cancelled")
    empty = {"accepted": 0, "sweeps": 120, "paired": 0}
    yield State("detection-empty", path, (Change(row, id, {"counts": empty}),), "The board was not found.")


def marking(stage: Stage) -> Iterator[State]:
    """The machine at work, and what it says where it ends, on each page of marks."""
    id, row = stage.marks_id, models.Analysis
    refused = {"corners": 64, "marked": 0, "reasons": {"no_mount": 64}, "refusal": REFUSAL, "sigma_px": None}
    none: dict[str, Any] = {"result": None}
    changes = {
        "queued": (stage.at_work(row, id, "queued", **none), "waiting for a worker"),
        "running": (stage.at_work(row, id, "running", "looking for the board's edges", **none), "board's edges"),
        "refused": ((Change(row, id, {"result": refused | {"marks": {}}}),), REFUSAL),
        "failed": ((Change(row, id, {"state": "failed", "problem": PROBLEM, **none}),), PROBLEM["detail"]),
        "done": ((), ""),
    }
    pages = {
        "recording": f"/recordings/{stage.track.recording_id}",
        "marking": f"/detections/{stage.track.detection_id}/mark?camera=front",
        "crops": f"/detections/{stage.track.detection_id}/crops?camera=front",
    }
    for name, (change, says) in changes.items():
        for page, path in pages.items():
            yield State(f"{page}-machine-{name}", path, change, says)
    for late in ("next", "progress", "expected-corners"):
        yield State(f"marking-late-{late}", f"{pages['marking']}#late={late}")


def calibrations(stage: Stage) -> Iterator[State]:
    id, row = stage.calibration_id, models.Calibration
    path = f"/calibrations/{id}"
    with stage.database.reading() as session:
        summary = session.get_one(row, UUID(id)).summary or {}
        results = session.scalars(select(models.Result).where(models.Result.calibration_id == UUID(id))).all()
        runs = [
            *session.scalars(select(models.CalibrationRun.id).where(models.CalibrationRun.calibration_id == UUID(id)))
        ]
        checks = {result.id: result.checks or [] for result in results}
    unended = {"summary": None, "finished_at": None, "remaining": 1}
    for state in ("queued", "running"):
        of_runs = tuple(Change(models.CalibrationRun, run, {"state": state, "finished_at": None}) for run in runs)
        yield State(f"calibration-{state}", path, (Change(row, id, {"state": state, **unended}), *of_runs))
    failed = {"state": "failed", "problem": PROBLEM, "summary": None}
    yield State("calibration-failed", path, (Change(row, id, failed),), PROBLEM["detail"])
    yield State("calibration-cancelled", path, (Change(row, id, {"state": "cancelled", "summary": None}),))
    for verdict in ("pass", "look", "stop", "not_checked"):
        changes: list[Change] = []
        graver = verdict if verdict != "not_checked" else "pass"
        for result, stored in checks.items():
            ones = [check | {"verdict": verdict if at == 0 else "pass"} for at, check in enumerate(stored)]
            changes.append(Change(models.Result, result, {"checks": ones, "verdict": graver}))
        front = summary["cameras"]["front"]
        entries = {name: entry | {"verdict": graver} for name, entry in front["models"].items()}
        judged = {"cameras": {"front": front | {"models": entries}}}
        changes.append(Change(row, id, {"summary": summary | judged}))
        yield State(f"calibration-{verdict}", path, tuple(changes))
    yield State("calibration-late", f"{path}#late={id}")


def fleets(stage: Stage) -> Iterator[State]:
    fleet, id, row = stage.track.fleet_id, stage.request_id, models.FleetRequest
    path, listed = f"/fleet-requests/{id}", f"/fleets/{fleet}/requests"
    yield State("fleet", f"/fleets/{fleet}")
    yield State("fleet-none", f"/fleets/{fleet}?name=nothing+is+named+so")
    yield State("fleet-annotator", f"/fleets/{fleet}", role="annotator")
    yield State("fleet-viewer", f"/fleets/{fleet}", role="viewer")
    with stage.database.reading() as session:
        (vehicle,) = session.scalars(
            select(models.FleetRequestVehicle.id).where(models.FleetRequestVehicle.fleet_request_id == UUID(id))
        ).all()
    of_states = {"running": "queued", "done": "done", "done_with_failures": "failed", "cancelled": "cancelled"}
    for state, of_vehicle in of_states.items():
        problem = PROBLEM if of_vehicle == "failed" else None
        changes = (
            Change(row, id, {"cancel_requested": state == "cancelled"}),
            Change(models.FleetRequestVehicle, vehicle, {"state": of_vehicle, "problem": problem}),
        )
        yield State(f"fleet-request-{state}", path, changes)
        yield State(f"fleet-requests-{state}", listed, changes)
    yield State("reference", "/reference")
    yield State("unknown", "/nothing/is/here")


ROOMS = {room.__name__: room for room in (recordings, detections, marking, calibrations, fleets)}


def take(page: Page, name: str) -> None:
    """Write pictures, where they are wanted."""
    folder = os.environ.get("PICTURES")
    for view in CROSSED if folder else ():
        show(page, view)
        page.wait_for_timeout(300)
        page.screenshot(path=Path(folder or "") / f"{name}-{view[0]}-{view[1]}.png", full_page=True)


@pytest.mark.slow
@pytest.mark.parametrize("room", ROOMS)
@pytest.mark.timeout(3600)
def test_each_page_at_each_state(sign_in: SignIn, stage: Stage, served: Embedded, room: str) -> None:
    only = [word for word in os.environ.get("ONLY", "").split(",") if word]
    states = [one for one in ROOMS[room](stage) if not only or any(word in one.name for word in only)]
    pages: dict[str, Page] = {}
    complaints: list[str] = []
    looked_at = ""

    def note(said: ConsoleMessage) -> None:
        if said.type == "error" and not REFUSED.search(said.text):
            complaints.append(f"{looked_at}: {said.text}")

    for state in states:
        if state.role not in pages:
            pages[state.role] = sign_in(f"{state.role} of {room}", state.role)
            pages[state.role].add_init_script(WATCHING)
            pages[state.role].on("console", note)
        page, looked_at = pages[state.role], state.name
        with stopped(served), ExitStack() as changes:
            for change in state.changes:
                changes.enter_context(altered(stage.database, change))
            show(page, ("light", 390))
            page.goto(stage.track.url + state.path)
            page.reload()
            expect(page.get_by_role("heading", level=1).first).to_be_visible()
            if state.says:
                expect(page.locator("main").get_by_text(state.says).first).to_be_visible()
            page.wait_for_load_state("networkidle")
            page.evaluate(DRAWN)
            complaints += [f"{state.name}: {line}" for line in page.evaluate("window.unready")]
            try:
                assert_fits(page)
            except AssertionError:
                complaints.append(f"{state.name}: it is wider than a phone")
            take(page, state.name)
    assert complaints == []
