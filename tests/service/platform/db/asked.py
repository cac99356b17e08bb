"""The product's functions that run all the time: of the sweep, of the upkeep, and behind the requests."""

from __future__ import annotations

from collections.abc import Callable
from datetime import timedelta
from typing import Any
from uuid import UUID

from sqlalchemy.orm import Session

from apexcal.documents.fleet_requests import VehicleFilter
from service.annotations.task_actions import next_tasks
from service.calibrations.actions import waiting_runs
from service.calibrations.routes import list_calibrations
from service.fleet_requests.routes import list_request_vehicles
from service.fleet_requests.vehicle_queries import choose
from service.fleets.routes import get_vehicles
from service.pairs.routes import list_sets
from service.platform.auth.access import Access, Identity
from service.platform.auth.retention import remove_ended
from service.platform.db.calibrations import current_publication
from service.platform.db.clock import utc_now
from service.platform.db.models import Detection, Person, Sensor, Vehicle
from service.platform.db.session import Database
from service.platform.http.pages import Window
from service.platform.job_status.routes import get_jobs
from service.platform.jobs.reaper import reap
from service.platform.jobs.retention import forget_jobs
from service.platform.storage.store import Store
from service.publications.camera_queries import published_cameras
from service.publications.health_queries import fleet_health
from service.publications.selection import Selection
from service.publications.state_queries import state_of_vehicle
from service.recordings.retention import delete_overdue
from service.recordings.routes import get_recordings
from tests.service.platform.db import history

Asked = Callable[[], Any]
_LONG_AGO = timedelta(days=3650)


def periodic(database: Database, store: Store) -> dict[str, Asked]:
    """What nobody asks for: every two seconds and every ten minutes."""
    return {
        "a sweep": lambda: reap(database, store),
        "upkeep of recordings": lambda: delete_overdue(database),
        "upkeep of sign-ins": lambda: remove_ended(database),
        "upkeep of jobs": lambda: forget_jobs(database),
    }


def fleet_requests(database: Database) -> dict[str, Asked]:
    """What a fleet request begins with; it looks at each vehicle."""

    def choosing(**wanted: Any) -> Asked:
        return _reading(database, lambda session: choose(session, history.FLEET, VehicleFilter(**wanted)))

    return {
        "vehicles of a fleet": choosing(),
        "vehicles with new pairs": choosing(new_pairs=True),
        "vehicles not calibrated": choosing(not_calibrated_since=utc_now() - _LONG_AGO),
    }


def health(database: Database) -> dict[str, Asked]:
    """What the page of a fleet shows: it looks at each vehicle."""

    def in_order(order: str) -> Asked:
        return _reading(database, lambda session: fleet_health(session, history.FLEET, Window(), order=order))

    return {order: in_order(order) for order in ("vehicle", "-error_20m_mm", "recorded_at")}


def requests(database: Database) -> dict[str, Asked]:
    """What single requests ask, of an engineer in two fleets, one of which has had no work."""
    page, quiet, vehicle = Window(), history.QUIET_FLEET, history.VEHICLE
    request = history.newest(database, "fleet_request")

    def asking(function: Callable[[Access], Any]) -> Asked:
        def ask(session: Session) -> Any:
            roles: Any = {history.FLEET: "engineer", quiet: "engineer"}
            return function(Access(session, Identity(session.get_one(Person, history.PERSON), roles, "")))

        return _reading(database, ask)

    def given_now(session: Session) -> Any:
        return published_cameras(session, session.get_one(Vehicle, vehicle), Selection(["front"]))

    def look() -> Any:
        with database.alone() as connection:
            statement = state_of_vehicle(connection.dialect.name)
            return connection.execute(statement, {"vehicle": vehicle, "alias": "current"}).all()

    return {
        "runs that wait": _reading(database, lambda session: waiting_runs(session, 8)),
        "jobs": asking(lambda access: get_jobs(access, page, None, None)),
        "jobs of a quiet fleet": asking(lambda access: get_jobs(access, page, quiet, None)),
        "failed jobs": asking(lambda access: get_jobs(access, page, None, "failed")),
        "recordings": asking(lambda access: get_recordings(access, page, None, None, None)),
        "failed recordings": asking(lambda access: get_recordings(access, page, None, None, "failed")),
        "recordings of a vehicle": asking(lambda access: get_recordings(access, page, None, vehicle, None)),
        "vehicles": asking(lambda access: get_vehicles(history.FLEET, access, page)),
        "calibrations": asking(lambda access: list_calibrations(vehicle, access, page)),
        "sets": asking(lambda access: list_sets(history.RIG, access, page)),
        "vehicles of a request": asking(lambda access: list_request_vehicles(request, access, page, None)),
        "the current calibration": _reading(database, given_now),
        "what decides the current calibration": look,
        "the current publication": _reading(database, lambda session: current_publication(session, vehicle, "front")),
    }


def marking(database: Database) -> dict[str, Asked]:
    """The next task of who has answered nearly all, and of a second person, who may answer what is left."""

    def asking(person: int) -> Asked:
        person_id = UUID(int=history.PERSON.int + person)

        def ask() -> Any:
            with database.writing() as session:
                detection = session.get_one(Detection, history.DETECTION)
                camera = session.get_one(Sensor, history.CAMERA)
                return next_tasks(session, detection, camera, person_id, 0.0)

        return ask

    return {"the next task": asking(0), "the next task of a second person": asking(1)}


def _reading(database: Database, function: Callable[[Session], Any]) -> Asked:
    def ask() -> Any:
        with database.reading() as session:
            return function(session)

    return ask
