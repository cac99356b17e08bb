"""Which vertices a person gets next, and the leases on them.

Under the person's lock and those of the apexes: people who ask at the same moment never take more vertices than
wanted. They share the recording's lock, so that nothing reopens vertices meanwhile.
"""

from __future__ import annotations

from datetime import timedelta
from functools import cache
from typing import Any
from uuid import UUID

from sqlalchemy import Integer, Select, Uuid, bindparam, delete, select, update
from sqlalchemy.orm import Session

from service.annotations.answer_queries import has_answered, is_live
from service.annotations.locks import lock_person, lock_recording
from service.annotations.task_queries import Seeker
from service.annotations.views import Subject, subjects
from service.db.annotations import MarkingFrontier, MarkingTask
from service.db.detections import Detection, Vertex, VertexFrame
from service.db.ids import new_id
from service.db.recordings import Sensor
from service.db.session import upserting
from service.detections.views import marked_corners

# Those ahead run out a little earlier, one after the other: whoever holds several gets them in the same order again.
_APART = timedelta(seconds=0.5)


def next_tasks(
    session: Session,
    detection: Detection,
    camera: Sensor,
    person_id: UUID,
    lease_s: float,
    skip: UUID | None = None,
    ahead: int = 0,
) -> list[Subject]:
    """The tasks that the person holds with fresh leases, and newly leased ones, until there are ``1 + ahead``.

    Fewer where so many are not left for them. What they skipped, or let the lease of run out, comes again after
    everything that they have not seen. The task named by ``skip`` is given back and not returned by this call.
    """
    clock = lock_person(session, person_id)
    mine = (MarkingTask.detection_id == detection.id, MarkingTask.person_id == person_id)
    if skip is not None:
        give_back = update(MarkingTask).where(MarkingTask.id == skip, *mine).values(leased_until=clock)
        session.execute(give_back.execution_options(synchronize_session=False))
    corners = marked_corners(detection)
    names = {"detection": detection.id, "person": person_id, "camera": camera.id, "corners": corners}
    held = session.execute(_held(), names | {"most": 1 + ahead}).all()
    leased = [row.vertex_id for row in held]
    if len(leased) < 1 + ahead:
        wanted = lock_recording(session, detection.recording_id, shared=True)
        passed = [one for one in (skip, *(row.id for row in held)) if one is not None]
        whose = (session, detection.recording_id, detection.id, camera.id, person_id)
        leased += Seeker(*whose, wanted, corners, passed).take(1 + ahead - len(leased))
    if not leased:
        return []
    common = {"detection_id": detection.id, "sensor_id": camera.id, "person_id": person_id, "created_at": clock}
    until = clock + timedelta(seconds=lease_s)
    rows = [
        common | {"id": new_id(), "vertex_id": vertex_id, "leased_until": until - _APART * place}
        for place, vertex_id in enumerate(leased)
    ]
    session.execute(_leasing(session.get_bind().dialect.name), rows)
    found = subjects(session, person_id, vertices=leased, camera_id=camera.id)
    return sorted(found, key=lambda one: leased.index(one.task.vertex_id))


@cache
def _held() -> Select[Any, Any]:
    """Tasks of a person's live leases with their vertices."""
    person = bindparam("person", type_=Uuid())
    of_camera = (VertexFrame.vertex_id == Vertex.id) & (VertexFrame.sensor_id == MarkingTask.sensor_id)
    return (
        select(MarkingTask.id, MarkingTask.vertex_id)
        .join(Vertex, Vertex.id == MarkingTask.vertex_id)
        .join(VertexFrame, of_camera)
        .where(MarkingTask.detection_id == bindparam("detection"), MarkingTask.person_id == person)
        .where(MarkingTask.sensor_id == bindparam("camera"), is_live(MarkingTask), ~has_answered(person))
        .where(Vertex.corner.in_(bindparam("corners", expanding=True)))
        # One that was taken back comes first.
        .order_by(MarkingTask.leased_until.desc())
        .limit(bindparam("most", type_=Integer()))
    )


@cache
def _leasing(dialect: str) -> Any:
    lease = upserting(dialect, MarkingTask)
    return lease.on_conflict_do_update(
        index_elements=["vertex_id", "sensor_id", "person_id"],
        set_={"leased_until": lease.excluded.leased_until, "answered_at": None},
    )


def reopen(session: Session, recording_id: UUID) -> None:
    """Say that vertices of this recording take answers again; before anything that refers to it is written."""
    lock_recording(session, recording_id)
    gone = delete(MarkingFrontier).where(MarkingFrontier.recording_id == recording_id)
    session.execute(gone.execution_options(synchronize_session=False))
