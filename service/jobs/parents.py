"""What the end of a job means to the row that it worked for. Done, failed and cancelled all come through here,

so that no recording, detection or calibration ever waits for a child that is dead.
"""

from __future__ import annotations

from collections.abc import Callable
from uuid import UUID

from sqlalchemy import update
from sqlalchemy.orm import Session

from service.broker.hints import hint
from service.calibration_runs.actions import end_calibration, end_run
from service.calibration_runs.conclusion import runs_of
from service.db.base import Json
from service.db.calibrations import Calibration, CalibrationRun
from service.db.clock import now
from service.db.detections import Detection
from service.db.recordings import Recording
from service.db.studies import Study


def tell_parent(session: Session, kind: str, subject_id: UUID, state: str, problem: Json | None) -> None:
    """Advance or end the parent of a job that just ended as ``done``, ``failed`` or ``cancelled``.

    A parent that was deleted meanwhile hears nothing: its job must still be able to end.
    """
    _PARENTS[kind](session, subject_id, state, problem)


def _recording(session: Session, subject_id: UUID, state: str, problem: Json | None) -> None:
    row = session.get(Recording, subject_id)
    if row is None:
        return
    row.state = "ready" if state == "done" else "failed"
    row.problem = problem or (_CANCELLED if state == "cancelled" else None)
    if state != "done":
        row.taken_bytes = row.size
    row.version += 1
    hint(session, row.fleet_id, "recording", row.id)


def _study(session: Session, subject_id: UUID, state: str, problem: Json | None) -> None:
    row = session.get(Study, subject_id)
    if row is None:
        return
    row.state, row.problem = state, problem
    hint(session, row.fleet_id, "recording", row.recording_id)


def _detection(session: Session, subject_id: UUID, state: str, problem: Json | None) -> None:
    """Count one shard down; the last one ends the run, a failed or cancelled one ends it at once."""
    counted = session.execute(
        update(Detection)
        .where(Detection.id == subject_id)
        .values(remaining=Detection.remaining - 1)
        .returning(Detection.remaining, Detection.fleet_id)
        .execution_options(synchronize_session=False)
    ).one_or_none()
    if counted is None or (state == "done" and counted.remaining > 0):
        return
    session.execute(
        update(Detection)
        .where(Detection.id == subject_id, Detection.state.in_(("queued", "running")))
        .values(state=state, problem=problem, finished_at=now())
        .execution_options(synchronize_session=False)
    )
    hint(session, counted.fleet_id, "detection", subject_id)


def _run(session: Session, subject_id: UUID, state: str, problem: Json | None) -> None:
    """A failed or cancelled job ends its run; a done one has said in its own transaction what comes next."""
    run = session.get(CalibrationRun, subject_id) if state != "done" else None
    if run:
        end_run(session, run, state, problem)


def _calibration(session: Session, subject_id: UUID, state: str, problem: Json | None) -> None:
    """A comparison of cameras that failed or was cancelled ends its calibration; a done one has ended it already."""
    calibration = session.get(Calibration, subject_id) if state != "done" else None
    if calibration and calibration.state in ("queued", "running"):
        rig: Json = {"pairs": [], "alarms": [], "problem": problem}
        end_calibration(
            session, calibration, runs_of(session, calibration.id), rig=rig, cancelled=state == "cancelled"
        )


_CANCELLED: Json = {
    "code": "cancelled",
    "detail": "The work was cancelled.",
    "hint": "Ask for it again when you want it.",
}

_PARENTS: dict[str, Callable[[Session, UUID, str, Json | None], None]] = {
    "ingest": _recording,
    "preview": _study,
    "suggestion": _study,
    "clock_offset": _study,
    "detect": _detection,
    "solve": _run,
    "consistency": _calibration,
}
