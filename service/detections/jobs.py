"""Jobs that look for vertices: each in a shard of a recording's sweeps."""

from __future__ import annotations

from collections.abc import Sequence
from uuid import UUID

from sqlalchemy import delete, select, update
from sqlalchemy.orm import Session

from apexcal.documents.states import UNENDED, WorkState
from service.broker.hints import hint
from service.db.base import Json
from service.db.clock import now
from service.db.detections import Detection, Vertex
from service.db.jobs import Job
from service.db.recordings import Sensor
from service.jobs.bundles import shards
from service.jobs.kinds import CannotRetryError, Kind
from service.jobs.queue import enqueue_all


def queue_detection(session: Session, row: Detection, workers: int) -> list[Job]:
    """Queue a detection's shards, which are together all sweeps of its recording."""
    lidar = select(Sensor.count).where(Sensor.recording_id == row.recording_id, Sensor.kind == "lidar")
    parts = shards(max(session.scalar(lidar) or 0, 1), workers)
    row.remaining = len(parts)
    payloads = [{"first": part.start, "stop": part.stop} for part in parts]
    jobs = enqueue_all(session, kind="detect", fleet_id=row.fleet_id, subject_id=row.id, payloads=payloads)
    hint(session, row.fleet_id, "detection", row.id)
    return jobs


def _end(session: Session, detection_id: UUID, state: WorkState, problem: Json | None) -> None:
    """Count one shard down; the last one ends the run, a failed or cancelled one ends it at once."""
    counted = session.execute(
        update(Detection)
        .where(Detection.id == detection_id)
        .values(remaining=Detection.remaining - 1)
        .returning(Detection.remaining, Detection.fleet_id)
        .execution_options(synchronize_session=False)
    ).one_or_none()
    if counted is None or (state == WorkState.DONE and counted.remaining > 0):
        return
    session.execute(
        update(Detection)
        .where(Detection.id == detection_id, Detection.state.in_(UNENDED))
        .values(state=state, problem=problem, finished_at=now())
        .execution_options(synchronize_session=False)
    )
    hint(session, counted.fleet_id, "detection", detection_id)


def _retry(session: Session, job: Job) -> Sequence[Job]:
    """All shards again: a failed one ended the run, and what the others found later was dropped."""
    row = session.get(Detection, job.subject_id, with_for_update=True)
    if row is None or row.state != WorkState.FAILED:
        raise CannotRetryError(f"its detection is {row.state if row else 'deleted'}, no longer failed")
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


KINDS = (Kind("detect", "detect", _end, _retry),)
