"""Jobs that look for vertices, each in a shard of a recording's sweeps; and those that make vertices of corners."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from uuid import UUID

from sqlalchemy import delete, func, select
from sqlalchemy.orm import Session

from apexcal.documents.states import WorkState
from service.detections.corner_vertices import make_corners
from service.platform.broker.hints import hint
from service.platform.db.base import Json
from service.platform.db.detections import Detection, Vertex
from service.platform.db.jobs import Job
from service.platform.db.recordings import Recording, Sensor
from service.platform.jobs.bundles import cut, shards
from service.platform.jobs.kinds import CannotRetryError, Kind, existing, failed_subject
from service.platform.jobs.queue import enqueue_all, live_processes
from service.platform.jobs.tree import count_down, end

AT_ONCE = 250
"""Tips whose corners one transaction makes. With three corners and two cameras these are 3000 rows: about half a
second on a busy machine, in which SQLite lets nobody else write."""


def queue_detection(session: Session, row: Detection) -> list[Job]:
    """Queue a detection's shards, which are together all sweeps of its recording."""
    lidar = select(Sensor.count).where(Sensor.id == row.lidar_id)
    parts = shards(max(session.scalar(lidar) or 0, 1), live_processes(session, "detect"))
    return _queue_shards(session, row, [{"first": part.start, "stop": part.stop} for part in parts])


def _queue_shards(session: Session, row: Detection, payloads: Sequence[Json]) -> list[Job]:
    row.remaining = len(payloads)
    hint(session, row.fleet_id, "detection", row.id)
    return enqueue_all(session, kind="detect", fleet_id=row.fleet_id, subject_id=row.id, payloads=payloads)


def queue_corners(session: Session, row: Detection) -> list[Job]:
    """Queue what makes the asked corners' vertices of all ranks that are not made at once."""
    last = session.scalar(select(func.max(Vertex.rank)).where(Vertex.detection_id == row.id))
    parts = cut((-1 if last is None else last) + 1, AT_ONCE)[1:]
    payloads = [{"first": part.start, "stop": part.stop} for part in parts]
    return enqueue_all(session, kind="corners", fleet_id=row.fleet_id, subject_id=row.id, payloads=payloads)


def _end_corners(session: Session, ids: Collection[UUID], state: WorkState, problem: Json | None) -> None:
    """The detections stay done, whatever became of their corners; their pages count them anew."""
    for row in existing(session, Detection, ids):
        hint(session, row.fleet_id, "detection", row.id)


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


def _end(session: Session, ids: Collection[UUID], state: WorkState, problem: Json | None) -> None:
    """The last shard ends its detection; a failed or cancelled one ends it at once."""
    last = count_down(session, Detection, ids) if state == WorkState.DONE else ids
    end(session, Detection, last, state, problem)


def _retry(session: Session, job: Job) -> Sequence[Job]:
    """All shards again: a failed one ended the run, and what the others found later was dropped."""
    row = failed_subject(session, job, Detection, "detection")
    before = session.scalars(select(Job.payload).where(Job.subject_id == row.id, Job.kind == "detect"))
    shards_before = {payload.get("first", 0): payload for payload in before}
    session.execute(delete(Vertex).where(Vertex.detection_id == row.id))
    row.reopen(WorkState.QUEUED)
    row.counts = {}
    return _queue_shards(session, row, [shards_before[first] for first in sorted(shards_before)])


def kinds(take: Callable[[Session, UUID, Detection], object]) -> tuple[Kind, ...]:
    """Return the kinds of detections. ``take`` asks for what follows one whose vertices have frames."""
    return (
        Kind("detect", "detect", _end, _retry, take=take),
        Kind("corners", "detect", _end_corners, _retry_corners, take=_take_corners),
    )
