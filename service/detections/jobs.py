"""Jobs that look for vertices, each in a shard of a recording's sweeps; and those that make vertices of corners."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from uuid import UUID

from sqlalchemy import delete, func, select, update
from sqlalchemy.orm import Session

from apexcal.documents.states import UNENDED, WorkState
from service.detections.corner_vertices import make_corners
from service.platform.broker.hints import hint
from service.platform.db.base import Json
from service.platform.db.clock import now
from service.platform.db.detections import Detection, Vertex
from service.platform.db.jobs import Job
from service.platform.db.recordings import Recording, Sensor
from service.platform.jobs.bundles import cut, shards
from service.platform.jobs.kinds import CannotRetryError, Kind, failed_subject
from service.platform.jobs.queue import enqueue_all, live_processes

AT_ONCE = 250
"""Tips whose corners one transaction makes. With three corners and two cameras these are 3000 rows: about half a
second on a busy machine, in which SQLite lets nobody else write."""


def queue_detection(session: Session, row: Detection) -> list[Job]:
    """Queue a detection's shards, which are together all sweeps of its recording."""
    lidar = select(Sensor.count).where(Sensor.id == row.lidar_id)
    parts = shards(max(session.scalar(lidar) or 0, 1), live_processes(session, "detect"))
    row.remaining = len(parts)
    payloads = [{"first": part.start, "stop": part.stop} for part in parts]
    jobs = enqueue_all(session, kind="detect", fleet_id=row.fleet_id, subject_id=row.id, payloads=payloads)
    hint(session, row.fleet_id, "detection", row.id)
    return jobs


def queue_corners(session: Session, row: Detection) -> list[Job]:
    """Queue what makes the asked corners' vertices of all ranks that are not made at once."""
    last = session.scalar(select(func.max(Vertex.rank)).where(Vertex.detection_id == row.id))
    parts = cut((-1 if last is None else last) + 1, AT_ONCE)[1:]
    payloads = [{"first": part.start, "stop": part.stop} for part in parts]
    return enqueue_all(session, kind="corners", fleet_id=row.fleet_id, subject_id=row.id, payloads=payloads)


def _end_corners(session: Session, detection_id: UUID, state: WorkState, problem: Json | None) -> None:
    """The detection stays done, whatever became of its corners; its page counts them anew."""
    fleet_id = session.scalar(select(Detection.fleet_id).where(Detection.id == detection_id))
    if fleet_id is not None:
        hint(session, fleet_id, "detection", detection_id)


def _take_corners(session: Session, detection_id: UUID, ranks: range) -> None:
    """Make the vertices of the corners that are asked for now."""
    recording = select(Detection.recording_id).where(Detection.id == detection_id).scalar_subquery()
    lock = select(Recording.id).where(Recording.id == recording).with_for_update(key_share=True)
    if session.execute(lock).one_or_none() is not None:
        make_corners(session, session.get_one(Detection, detection_id, populate_existing=True), ranks)


def _retry_corners(session: Session, job: Job) -> Sequence[Job]:
    """All ranks again: what is there already is not made twice."""
    row = session.get(Detection, job.subject_id, with_for_update=True)
    if row is None:
        raise CannotRetryError("its detection is deleted")
    return queue_corners(session, row)


def _end(session: Session, detection_id: UUID, state: WorkState, problem: Json | None) -> None:
    """Count one shard down; the last one ends the run, a failed or cancelled one ends it at once."""
    counted = session.execute(
        update(Detection)
        .where(Detection.id == detection_id)
        .values(remaining=Detection.remaining - 1)
        .returning(Detection.remaining, Detection.fleet_id)
    ).one_or_none()
    if counted is None or (state == WorkState.DONE and counted.remaining > 0):
        return
    session.execute(
        update(Detection)
        .where(Detection.id == detection_id, Detection.state.in_(UNENDED))
        .values(state=state, problem=problem, finished_at=now())
    )
    hint(session, counted.fleet_id, "detection", detection_id)


def _retry(session: Session, job: Job) -> Sequence[Job]:
    """All shards again: a failed one ended the run, and what the others found later was dropped."""
    row = failed_subject(session, job, Detection, "detection")
    shards_before = {
        payload.get("first", 0): payload
        for payload in session.scalars(select(Job.payload).where(Job.subject_id == row.id, Job.kind == "detect"))
    }
    session.execute(delete(Vertex).where(Vertex.detection_id == row.id))
    row.state, row.problem, row.finished_at = WorkState.QUEUED, None, None
    row.remaining, row.counts = len(shards_before), {}
    session.flush()
    hint(session, row.fleet_id, "detection", row.id)
    payloads = [shards_before[first] for first in sorted(shards_before)]
    return enqueue_all(session, kind="detect", fleet_id=row.fleet_id, subject_id=row.id, payloads=payloads)


def kinds(take: Callable[[Session, UUID, Detection], object]) -> tuple[Kind, ...]:
    """Return the kinds of detections. ``take`` asks for what follows one whose vertices have frames."""
    return (
        Kind("detect", "detect", _end, _retry, take=take),
        Kind("corners", "detect", _end_corners, _retry_corners, take=_take_corners),
    )
