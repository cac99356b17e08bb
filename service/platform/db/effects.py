"""Compare the answers to cars before and after each transaction that may change them.

It goes by the rows, whoever changes them: a route, a job or a command. A transaction that changes an answer leaves a
line in the audit, with the answers before and after.
"""

from __future__ import annotations

from collections.abc import Iterable
from importlib import import_module
from typing import Any, Final
from uuid import UUID

from sqlalchemy import event, select
from sqlalchemy.orm import ORMExecuteState, Session, sessionmaker
from sqlalchemy.orm.attributes import get_history

from service.platform.db.calibrations import Calibration, Publication
from service.platform.db.fleets import Fleet, Rig, RigCamera, RigLidar, Vehicle
from service.platform.db.people import AuditEntry
from service.platform.observability import logs, request_ids

ENTRY: Final = "apexcal_audit_entry"
"""Under this name ``session.info`` has the line of the request that a transaction is of."""
_BEFORE: Final = "apexcal_answers_before"
_NAMES: Final = "apexcal_fleet_names_before"
_VEHICLES: Final[dict[type, Any]] = {Calibration: Calibration.vehicle_id, Rig: Rig.vehicle_id, Vehicle: Vehicle.id}
"""Which vehicles the rows of a bulk statement are of. What belongs to them goes with them."""


def watch(writing: sessionmaker[Session]) -> None:
    """Compare in all transactions of these sessions."""
    event.listen(writing, "before_flush", _look_before_rows)
    event.listen(writing, "do_orm_execute", _look_before_statement)
    event.listen(writing, "before_commit", _note_effects)


def effects(session: Session) -> list[str]:
    """Return a sentence for each answer to cars that this transaction changes: `van, front: result 1 -> result 2`."""
    session.flush()
    vehicles, fleets = session.info.pop(_BEFORE, {}), session.info.pop(_NAMES, {})
    return _of_cars(session, "changed_answers", vehicles, fleets) if vehicles or fleets else []


def entry_of_process(words: str = "") -> AuditEntry:
    """A line of the audit for what no request did: a job, a command in these ``words``, or the upkeep."""
    who = logs.who()
    method, path = "SERVICE", "upkeep"
    if "job" in who:
        method, path = "JOB", f"{who['kind']} {who['job']}"
    elif "command" in who:
        method, path = "ADMIN", words or who["command"]
    return AuditEntry(address="", request_id=request_ids.current(), method=method, path=path)


def _look_before_rows(session: Session, *_: object) -> None:
    for row in (*session.new, *session.dirty, *session.deleted):
        if isinstance(row, Publication | Rig):
            _look(session, [row.vehicle_id])
        elif isinstance(row, Vehicle) and row not in session.new:
            _look(session, [row.id])
        elif isinstance(row, RigCamera | RigLidar) and row not in session.new:
            _look(session, [session.get_one(Rig, row.rig_id).vehicle_id])
        elif isinstance(row, Fleet) and (names := get_history(row, "name").deleted):
            session.info.setdefault(_NAMES, {}).setdefault(row.id, names[0])


def _look_before_statement(state: ORMExecuteState) -> None:
    model = state.bind_mapper.class_ if state.bind_mapper and (state.is_delete or state.is_update) else None
    if model in _VEHICLES:
        statement: Any = state.statement
        of_rows = select(_VEHICLES[model]).where(statement.whereclause).distinct()
        _look(state.session, state.session.scalars(of_rows).all())


def _look(session: Session, vehicle_ids: Iterable[UUID]) -> None:
    before = session.info.setdefault(_BEFORE, {})
    for vehicle_id in vehicle_ids:
        if vehicle_id not in before:
            before[vehicle_id] = _of_cars(session, "car_answers", vehicle_id)


def _of_cars(session: Session, function: str, *arguments: Any) -> Any:
    # By name: what cars are answered is above the platform. In a session of its own: rows of this one may differ
    # already from the database's.
    with Session(session.connection()) as rows:
        return getattr(import_module("service.publications.car_answers"), function)(rows, *arguments)


def _note_effects(session: Session) -> None:
    lines = effects(session)
    if lines:
        entry: AuditEntry = session.info.get(ENTRY) or entry_of_process()
        entry.effect = "\n".join(lines)
        session.add(entry)
