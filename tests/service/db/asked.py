"""The product's functions that run all the time: of the sweep, of the upkeep, and behind the requests."""

from __future__ import annotations

from collections.abc import Callable
from datetime import timedelta
from typing import Any
from uuid import UUID

from sqlalchemy import select
from sqlalchemy.orm import Session

from service.annotations.handout import next_task
from service.annotations.progress import progress
from service.auth.expiry import remove_ended
from service.calibration_runs.publishing import against_publishing
from service.calibrations import published_routes
from service.calibrations.routes import list_calibrations
from service.calibrations.runs import waiting_runs
from service.calibrations.set_routes import list_sets
from service.db.clock import utc_now
from service.db.models import Calibration, Detection, Person, Sensor
from service.db.session import Database
from service.fleet_requests.choosing import choose
from service.fleet_requests.routes import list_fleet_requests, list_request_vehicles
from service.fleet_requests.schemas import VehicleFilter
from service.fleets.routes import get_vehicles
from service.http.jobs import get_jobs
from service.http.pages import Window
from service.jobs.retention import forget_jobs, overdue_jobs
from service.jobs.sweep import sweep
from service.recordings.retention import delete_overdue
from service.recordings.routes import get_recordings
from service.storage.store import Store
from service.auth.access import Access, Identity
from tests.service.db import history

Asked = Callable[[], Any]


class _Unconditional:
    """A request without If-Match."""

    def offer(self, *_: Any, **__: Any) -> None:
        return


def asked(database: Database, store: Store) -> dict[str, Asked]:
    """Each by what it is for; all on a database that :mod:`tests.service.db.history` has filled."""

    def reading(function: Callable[[Session], Any]) -> Asked:
        def ask() -> Any:
            with database.reading() as session:
                return function(session)

        return ask

    def writing(function: Callable[[Session], Any]) -> Asked:
        def ask() -> Any:
            with database.writing() as session:
                return function(session)

        return ask

    def listing(function: Callable[[Access], Any]) -> Asked:
        def ask() -> Any:
            with database.reading() as session:
                roles: Any = {history.FLEET: "engineer", history.QUIET_FLEET: "engineer"}
                identity = Identity(session.get_one(Person, history.PERSON), roles, "")
                return function(Access(session, identity))

        return ask

    def marking(person: UUID) -> Callable[[Session], Any]:
        return lambda session: next_task(
            session,
            session.get_one(Detection, history.DETECTION),
            session.get_one(Sensor, history.CAMERA),
            person,
            0.0,
            None,
        )

    second = UUID(int=history.PERSON.int + 1)
    vehicles: Any = VehicleFilter
    request = history.newest(database, "fleet_request")
    calibration = history.newest(database, "calibration")
    current: Any = published_routes.read_current
    page = Window()
    return {
        "sweep": lambda: sweep(database, store),
        "upkeep: recordings": lambda: delete_overdue(database),
        "upkeep: sign-in": lambda: remove_ended(database),
        "upkeep: jobs": lambda: forget_jobs(database),
        "overdue jobs": reading(overdue_jobs),
        "waiting runs": reading(lambda session: waiting_runs(session, 2)),
        "choose": reading(lambda session: choose(session, history.FLEET, vehicles())),
        "choose new pairs": reading(lambda session: choose(session, history.FLEET, vehicles(new_pairs=True))),
        "choose not calibrated": reading(
            lambda session: choose(
                session, history.FLEET, vehicles(not_calibrated_since=utc_now() - timedelta(days=3650))
            )
        ),
        "next task": writing(marking(history.PERSON)),
        "next task again": writing(marking(history.PERSON)),
        "next task of a second": writing(marking(second)),
        "progress": reading(
            lambda session: progress(
                session,
                session.get_one(Detection, history.DETECTION),
                session.get_one(Sensor, history.CAMERA),
                history.PERSON,
            )
        ),
        "jobs": listing(lambda access: get_jobs(access, page, None, None)),
        "jobs of a quiet fleet": listing(lambda access: get_jobs(access, page, history.QUIET_FLEET, None)),
        "failed jobs": listing(lambda access: get_jobs(access, page, None, "failed")),
        "recordings": listing(lambda access: get_recordings(access, page, None, None, None)),
        "failed recordings": listing(lambda access: get_recordings(access, page, history.FLEET, None, "failed")),
        "recordings of a vehicle": listing(lambda access: get_recordings(access, page, None, history.VEHICLE, None)),
        "vehicles": listing(lambda access: get_vehicles(history.FLEET, access, page)),
        "calibrations": listing(lambda access: list_calibrations(history.VEHICLE, access, page)),
        "sets": listing(lambda access: list_sets(history.RIG, access, page)),
        "fleet requests": listing(lambda access: list_fleet_requests(history.FLEET, access, page)),
        "its vehicles": listing(lambda access: list_request_vehicles(request, access, page, None)),
        "running vehicles": listing(lambda access: list_request_vehicles(request, access, page, "running")),
        "current calibration": listing(
            lambda access: published_routes._current(access.session, history.VEHICLE, "front")
        ),
        "held-out error": reading(
            lambda session: __import__("service.calibration_runs.publishing", fromlist=["x"])._current_held_out(
                session, history.VEHICLE, "front"
            )
        ),
    }
