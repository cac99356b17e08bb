"""The end of a calibration: its state, its summary, and what its fleet request hears of it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple
from uuid import UUID

from sqlalchemy import bindparam, select
from sqlalchemy.orm import Session

from apexcal.documents.states import WorkState
from service.calibration_runs.fleet_request_actions import tell_fleet_request
from service.platform.broker.hints import hint
from service.platform.db.base import Json
from service.platform.db.calibrations import Calibration, CalibrationRun
from service.platform.db.clock import now


class RunRow(NamedTuple):
    """What the end of a calibration reads of each of its runs; ``fold`` is FULL for a fit to all pairs."""

    fold: int
    state: str
    failure: Json | None


# Built once: SQLAlchemy takes longer to build such a statement than to run it.
_RUNS = select(*(getattr(CalibrationRun, name) for name in RunRow._fields)).where(
    CalibrationRun.calibration_id == bindparam("calibration")
)


def runs_of(session: Session, calibration_id: UUID) -> Sequence[RunRow]:
    """Return the calibration's runs as they stand in the database, whatever this session has loaded of them."""
    return [RunRow(*row) for row in session.connection().execute(_RUNS, {"calibration": calibration_id})]


def end_calibration(
    session: Session,
    calibration: Calibration,
    state: WorkState,
    problem: Json | None,
    summary: Json | None = None,
) -> None:
    """End a calibration whose runs have all ended, and count it in its fleet request."""
    calibration.state, calibration.problem, calibration.summary = state, problem, summary
    calibration.finished_at = now()
    tell_fleet_request(session, calibration)
    hint(session, calibration.fleet_id, "calibration", calibration.id)
