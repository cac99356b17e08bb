"""Writes marks and verdicts: one row per person and subject, every earlier state kept."""

from __future__ import annotations

from uuid import UUID

from sqlalchemy import select
from sqlalchemy.orm import Session

from apexcal.documents.corners import TOP
from service.annotations.task_actions import reopen
from service.db.annotations import AnnotationRevision, Mark, Verdict
from service.db.base import Json
from service.db.clock import utc_now
from service.db.detections import Apex
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
    return session.scalar(
        select(Mark).where(
            Mark.person_id == person_id,
            Mark.sensor_id == sensor_id,
            Mark.frame_index == frame_index,
            Mark.corner == corner,
        )
    )


def find_verdict(session: Session, person_id: UUID, apex_id: UUID) -> Verdict | None:
    """A person's verdict on an apex."""
    return session.scalar(select(Verdict).where(Verdict.person_id == person_id, Verdict.apex_id == apex_id))


def write_mark(
    session: Session,
    person_id: UUID,
    camera: Sensor,
    frame: CameraFrame,
    u: float,
    v: float,
    *,
    corner: str = TOP,
    reviewed: bool = False,
) -> Mark:
    """Set a person's mark of a corner in a frame. Saying the same again changes nothing.

    ``reviewed``: something of others' answers had been told to the person before.

    Raises:
        Problem: ``mark_outside_image``.
    """
    check_inside(u, v, frame)
    mark = find_mark(session, person_id, camera.id, frame.index, corner)
    if mark is None:
        mark = Mark(
            recording_id=camera.recording_id,
            person_id=person_id,
            sensor_id=camera.id,
            frame_index=frame.index,
            u=u,
            v=v,
            corner=corner,
            reviewed=reviewed,
            version=1,
        )
        session.add(mark)
    elif (mark.u, mark.v) == (u, v):
        return mark
    else:
        mark.u, mark.v, mark.reviewed = u, v, reviewed
        mark.version, mark.updated_at = mark.version + 1, utc_now()
    session.flush()
    value = {"sensor_id": camera.id.hex, "frame_index": frame.index, "u": u, "v": v}
    if corner != TOP:
        value["corner"] = corner
    _keep_revision(session, "mark", mark, value)
    return mark


def write_verdict(session: Session, person_id: UUID, apex: Apex, verdict: str, *, reviewed: bool = False) -> Verdict:
    """Set a person's verdict on an apex. Saying the same again changes nothing. ``reviewed`` as for a mark."""
    row = find_verdict(session, person_id, apex.id)
    if row is None:
        row = Verdict(
            recording_id=apex.recording_id,
            apex_id=apex.id,
            person_id=person_id,
            verdict=verdict,
            reviewed=reviewed,
            version=1,
        )
        session.add(row)
    elif row.verdict == verdict:
        return row
    else:
        reopen(session, row.recording_id)  # a confirmation may lack its mark
        row.verdict, row.reviewed = verdict, reviewed
        row.version, row.updated_at = row.version + 1, utc_now()
    session.flush()
    _keep_revision(session, "verdict", row, {"apex_id": apex.id.hex, "verdict": verdict})
    return row


def take_back(session: Session, row: Mark | Verdict) -> None:
    """Remove a mark or a verdict; that it was there stays in its revisions."""
    reopen(session, row.recording_id)
    subject = "mark" if isinstance(row, Mark) else "verdict"
    row.version += 1
    _keep_revision(session, subject, row, {"taken_back": True})
    session.delete(row)
    session.flush()


def _keep_revision(session: Session, subject: str, row: Mark | Verdict, value: Json) -> None:
    session.add(
        AnnotationRevision(
            recording_id=row.recording_id,
            person_id=row.person_id,
            subject=subject,
            subject_id=row.id,
            version=row.version,
            value=value,
        )
    )
