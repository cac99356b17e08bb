"""Which vertex a person gets next, and the lease on it.

Under one lock per recording, so that people who ask at the same moment never take more vertices than wanted: on
SQLite every writing transaction is alone anyway, on PostgreSQL the recording's row is locked.
"""

from __future__ import annotations

from uuid import UUID

from sqlalchemy import and_, delete, select, update
from sqlalchemy.orm import Session

from service.annotations.answer_queries import has_answered, is_live
from service.annotations.task_queries import Seeker
from service.db.annotations import MarkingFrontier, MarkingTask
from service.db.clock import now
from service.db.detections import Detection, Vertex, VertexFrame
from service.db.recordings import Recording, Sensor
from service.detections.views import marked_corners

# Those ahead run out a little earlier, one after the other: whoever holds several gets them in the same order again.
_APART_S = 0.5


def lock_recording(session: Session, recording_id: UUID) -> Recording:
    """The recording, its hand-out locked until the transaction ends. Rows that refer to it may still be inserted."""
    statement = select(Recording).where(Recording.id == recording_id)
    return session.scalars(statement.with_for_update(key_share=True).execution_options(populate_existing=True)).one()


def next_tasks(
    session: Session,
    detection: Detection,
    camera: Sensor,
    person_id: UUID,
    lease_s: float,
    skip: UUID | None = None,
    ahead: int = 0,
) -> list[MarkingTask]:
    """The tasks that the person holds with fresh leases, and newly leased ones, until there are ``1 + ahead``.

    Fewer where so many are not left for them. What they skipped, or let the lease of run out, comes again after
    everything that they have not seen. The task named by ``skip`` is given back and not returned by this call.
    """
    recording = lock_recording(session, detection.recording_id)
    mine = (MarkingTask.detection_id == detection.id, MarkingTask.person_id == person_id)
    if skip is not None:
        give_back = update(MarkingTask).where(MarkingTask.id == skip, *mine).values(leased_until=now())
        session.execute(give_back.execution_options(synchronize_session=False))
    wanted, corners = recording.marks_per_vertex, marked_corners(detection)
    held = session.execute(
        select(MarkingTask.id, MarkingTask.vertex_id)
        .join(Vertex, Vertex.id == MarkingTask.vertex_id)
        .join(VertexFrame, and_(VertexFrame.vertex_id == Vertex.id, VertexFrame.sensor_id == camera.id))
        .where(*mine, MarkingTask.sensor_id == camera.id, is_live(MarkingTask), ~has_answered(person_id))
        .where(Vertex.corner.in_(corners))
        # One that was taken back comes first.
        .order_by(MarkingTask.leased_until.desc())
        .limit(1 + ahead)
    ).all()
    passed = [one for one in (skip, *(row.id for row in held)) if one is not None]
    tasks: list[MarkingTask] = []
    for place in range(1 + ahead):
        vertex_id = held[place].vertex_id if place < len(held) else None
        if vertex_id is None:
            whose = (session, recording.id, detection.id, camera.id, person_id)
            vertex_id = Seeker(*whose, wanted, corners, passed).seek()
        if vertex_id is None:
            break
        tasks.append(_lease(session, detection.id, vertex_id, camera.id, person_id, lease_s - _APART_S * place))
        passed.append(tasks[-1].id)
    return tasks


def reopen(session: Session, recording_id: UUID) -> None:
    """Say before an answer is taken back that vertices of this recording take answers again."""
    lock_recording(session, recording_id)
    gone = delete(MarkingFrontier).where(MarkingFrontier.recording_id == recording_id)
    session.execute(gone.execution_options(synchronize_session=False))


def _lease(
    session: Session, detection_id: UUID, vertex_id: UUID, camera_id: UUID, person_id: UUID, lease_s: float
) -> MarkingTask:
    task = session.scalar(
        select(MarkingTask).where(
            MarkingTask.vertex_id == vertex_id,
            MarkingTask.sensor_id == camera_id,
            MarkingTask.person_id == person_id,
        )
    )
    if task is None:
        task = MarkingTask(
            detection_id=detection_id, vertex_id=vertex_id, sensor_id=camera_id, person_id=person_id, answered_at=None
        )
        session.add(task)
    task.answered_at = None
    task.leased_until = now(lease_s)  # pyright: ignore[reportAttributeAccessIssue] - the database's own clock
    session.flush()
    session.refresh(task)
    return task
