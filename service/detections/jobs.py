"""Jobs that look for vertices, each in a shard of a recording's sweeps."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from uuid import UUID

from sqlalchemy import delete, select
from sqlalchemy.orm import Session

from apexcal.documents.states import WorkState
from service.platform.broker.hints import hint
from service.platform.db.base import Json
from service.platform.db.detections import Detection, Vertex
from service.platform.db.jobs import Job
from service.platform.db.recordings import Sensor
from service.platform.jobs.bundles import shards
from service.platform.jobs.kinds import Kind, failed_subject
from service.platform.jobs.queue import enqueue_all, live_processes
from service.platform.jobs.tree import count_down, end


def queue_detection(session: Session, row: Detection) -> list[Job]:
    """Queue a detection's shards, which are together all sweeps of its recording."""
    lidar = select(Sensor.count).where(Sensor.id == row.lidar_id)
    parts = shards(max(session.scalar(lidar) or 0, 1), live_processes(session, "detect"))
    return _queue_shards(session, row, [{"first": part.start, "stop": part.stop} for part in parts])


def _queue_shards(session: Session, row: Detection, payloads: Sequence[Json]) -> list[Job]:
    row.remaining = len(payloads)
    hint(session, row.fleet_id, "detection", row.id)
    return enqueue_all(session, kind="detect", fleet_id=row.fleet_id, subject_id=row.id, payloads=payloads)


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
    return (Kind("detect", "detect", _end, _retry, take=take),)
