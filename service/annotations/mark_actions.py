"""Writes marks and verdicts: one row per person and subject, every earlier state kept."""

from __future__ import annotations

from uuid import UUID

from sqlalchemy import select
from sqlalchemy.orm import Session

from apexcal.documents.corners import TOP
from service.db.annotations import AnnotationRevision, Mark, Verdict
from service.db.base import Json
from service.db.clock import utc_now
from service.db.ids import new_id
from service.db.recordings import CameraFrame, Sensor
from service.http.problems import Problem


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
    camera: Sensor,
    frame: CameraFrame,
    u: float,
    v: float,
    *,
    corner: str = TOP,
    reviewed: bool = False,
) -> Mark:
    """Set a person's mark of a corner in a frame, which was ``before``. Saying the same again changes nothing.

    ``reviewed``: something of others' answers had been told to the person before.

    Raises:
        Problem: ``mark_outside_image``.
    """
    check_inside(u, v, frame)
    if before is not None and (before.u, before.v) == (u, v):
        return before
    if before is None:
        whose = {"person_id": person_id, "sensor_id": camera.id, "frame_index": frame.index, "corner": corner}
        mark = Mark(id=new_id(), recording_id=camera.recording_id, version=0, **whose)
        session.add(mark)
    else:
        mark = before
        mark.updated_at = utc_now()
    mark.u, mark.v, mark.reviewed, mark.version = u, v, reviewed, mark.version + 1
    value = {"sensor_id": camera.id.hex, "frame_index": frame.index, "u": u, "v": v}
    if corner != TOP:
        value["corner"] = corner
    _keep_revision(session, "mark", mark, value)
    return mark


def write_verdict(
    session: Session,
    before: Verdict | None,
    person_id: UUID,
    recording_id: UUID,
    apex_id: UUID,
    verdict: str,
    *,
    reviewed: bool = False,
) -> Verdict:
    """Set a person's verdict on an apex, which was ``before``. Saying the same again changes nothing.

    ``reviewed`` as for a mark. Call ``reopen`` first where the verdict changes: a confirmation may lack its mark.
    """
    if before is not None and before.verdict == verdict:
        return before
    if before is None:
        row = Verdict(id=new_id(), recording_id=recording_id, apex_id=apex_id, person_id=person_id, version=0)
        session.add(row)
    else:
        row = before
        row.updated_at = utc_now()
    row.verdict, row.reviewed, row.version = verdict, reviewed, row.version + 1
    _keep_revision(session, "verdict", row, {"apex_id": apex_id.hex, "verdict": verdict})
    return row


def take_back(session: Session, row: Mark | Verdict) -> None:
    """Remove a mark or a verdict, after ``reopen``; that it was there stays in its revisions."""
    subject = "mark" if isinstance(row, Mark) else "verdict"
    row.version += 1
    _keep_revision(session, subject, row, {"taken_back": True})
    session.delete(row)


def _keep_revision(session: Session, subject: str, row: Mark | Verdict, value: Json) -> None:
    whose = {"recording_id": row.recording_id, "person_id": row.person_id, "subject_id": row.id}
    session.add(AnnotationRevision(**whose, subject=subject, version=row.version, value=value))
