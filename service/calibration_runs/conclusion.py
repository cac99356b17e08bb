"""The end of a calibration: its state, its summary, and what its fleet request hears of it."""

from __future__ import annotations

from sqlalchemy.orm import Session

from apexcal.documents.states import WorkState
from service.calibration_runs.fleet_request_actions import tell_fleet_request
from service.platform.broker.hints import hint
from service.platform.db.base import Json
from service.platform.db.calibrations import Calibration
from service.platform.db.clock import now


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
