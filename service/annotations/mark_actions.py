"""Writes marks and verdicts: one row per person and subject, every earlier state kept."""

from __future__ import annotations

from typing import Any
from uuid import UUID

from sqlalchemy import delete, insert, select, update
from sqlalchemy.orm import Session

from apexcal.documents.corners import TOP
from service.platform.db.annotations import AnnotationRevision, Mark, Verdict
from service.platform.db.base import Json
from service.platform.db.clock import utc_now
from service.platform.db.ids import new_id
from service.platform.db.recordings import CameraFrame
from service.platform.http.problems import Problem


def check_inside(u: float, v: float, frame: CameraFrame) -> None:
    """Raises :class:`Problem` 422 ``mark_outside_image`` for a pixel that is not in the frame.

    (0, 0) is the centre of the top-left pixel, so an image reaches from -0.5 to its size minus 0.5.
    """
    if -0.5 <= u <= frame.width - 0.5 and -0.5 <= v <= frame.height - 0.5:
        return
    raise Problem(
        422,
        "mark_outside_image",
        f"The mark ({u:g}, {v:g}) lies outside the image of {frame.width} x {frame.height} pixels.",
        "u goes from -0.5 on the left to width - 0.5, v from -0.5 at the top to height - 0.5.",
    )


def find_mark(session: Session, person_id: UUID, sensor_id: UUID, frame_index: int, corner: str = TOP) -> Mark | None:
    """A person's mark of a corner in a frame."""
    whose = {"person_id": person_id, "sensor_id": sensor_id, "frame_index": frame_index, "corner": corner}
    return session.scalar(select(Mark).filter_by(**whose))


def write_mark(
    session: Session,
    before: Mark | None,
    person_id: UUID,
    recording_id: UUID,
    frame: CameraFrame,
    u: float,
    v: float,
    *,
    corner: str = TOP,
    reviewed: bool = False,
) -> int:
    """Set a person's mark of a corner in a frame, which was ``before``. Saying the same again changes nothing.

    ``reviewed``: something of others' answers had been told to the person before. Returns the mark's version.

    Raises:
        Problem: ``mark_outside_image``.
    """
    check_inside(u, v, frame)
    if before is not None and (before.u, before.v) == (u, v):
        return before.version
    whose = {"recording_id": recording_id, "person_id": person_id}
    at: Json = {"sensor_id": frame.sensor_id, "frame_index": frame.index}
    value = at | {"sensor_id": frame.sensor_id.hex, "u": u, "v": v} | ({"corner": corner} if corner != TOP else {})
    return _write(session, Mark, before, whose, at | {"corner": corner, "u": u, "v": v, "reviewed": reviewed}, value)


def write_verdict(
    session: Session,
    before: Verdict | None,
    person_id: UUID,
    recording_id: UUID,
    apex_id: UUID,
    verdict: str,
    *,
    reviewed: bool = False,
) -> None:
    """Set a person's verdict on an apex, which was ``before``. Saying the same again changes nothing.

    ``reviewed`` as for a mark. Call ``reopen`` first where the verdict changes: a confirmation may lack its mark.
    """
    if before is None or before.verdict != verdict:
        whose = {"recording_id": recording_id, "person_id": person_id}
        columns = {"apex_id": apex_id, "verdict": verdict, "reviewed": reviewed}
        _write(session, Verdict, before, whose, columns, {"apex_id": apex_id.hex, "verdict": verdict})


def take_back(session: Session, row: Mark | Verdict) -> None:
    """Remove a mark or a verdict, after ``reopen``; that it was there stays in its revisions."""
    whose = {"recording_id": row.recording_id, "person_id": row.person_id}
    _keep_revision(session, type(row), row.id, row.version + 1, whose, {"taken_back": True})
    table: Any = type(row).__table__
    session.execute(delete(table).where(table.c.id == row.id))


def _write(
    session: Session,
    kind: type[Mark | Verdict],
    before: Mark | Verdict | None,
    whose: Json,
    columns: Json,
    value: Json,
) -> int:
    """Write a row in place of ``before``, and ``value`` as its revision; returns its version."""
    table: Any = kind.__table__
    if before is None:
        row_id, version = new_id(), 1
        session.execute(insert(table), {"id": row_id, **whose, **columns})
    else:
        row_id, version = before.id, before.version + 1
        changed = {**columns, "version": version, "updated_at": utc_now()}
        session.execute(update(table).where(table.c.id == row_id).values(changed))
    _keep_revision(session, kind, row_id, version, whose, value)
    return version


def _keep_revision(
    session: Session, kind: type[Mark | Verdict], subject_id: UUID, version: int, whose: Json, value: Json
) -> None:
    row = {**whose, "subject": kind.__tablename__, "subject_id": subject_id, "version": version, "value": value}
    session.execute(insert(AnnotationRevision.__table__), row)  # pyright: ignore[reportArgumentType] - it is a table
