"""Hand out vertices to people, under leases.

The person and the apexes are locked, so people who ask at the same moment never take more vertices than wanted. They
share the recording's lock, so nothing reopens vertices meanwhile.
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
from service.annotations.task_queries import OpenVertexSearch
from service.annotations.views import Subject, subjects
from service.platform.db.annotations import MarkingFrontier, MarkingTask
from service.platform.db.base import new_id
from service.platform.db.detections import Detection, Vertex, VertexFrame, marked_corners
from service.platform.db.recordings import Sensor
from service.platform.db.session import upserting
from service.platform.http.problems import not_found

# Leases of tasks ahead end half a second apart. So whoever lost them gets the tasks in the same order again.
_APART = timedelta(seconds=0.5)
# Five tasks ahead bridge a slow network. More serve people without a network, as long as others have enough.
_FEW = 5


def next_tasks(
    session: Session,
    detection: Detection,
    camera: Sensor,
    person_id: UUID,
    lease_s: float,
    skip: UUID | None = None,
    ahead: int = 0,
    vertex_id: UUID | None = None,
) -> list[Subject]:
    """Return up to ``1 + ahead`` tasks: those that the person holds, with renewed leases, then newly leased ones.

    Beyond five ahead a person gets at most half of their share of the open vertices. Vertices that they skipped, or
    whose lease ran out, come again after all that they have not seen. The task ``skip`` is given back and not
    returned by this call. ``vertex_id`` comes first.

    Raises:
        Problem: 404 if the detection has no such vertex in the camera.
    """
    clock = lock_person(session, person_id)
    corners = marked_corners(detection)
    names = {"detection": detection.id, "person": person_id, "camera": camera.id, "corners": corners}
    passed: list[UUID] = []
    if skip is not None:
        passed += session.connection().scalars(_giving_back(), names | {"skipped": skip, "clock": clock})
    leased = [*session.connection().scalars(_held(), names | {"most": 1 + ahead})]
    if vertex_id is not None:
        if session.scalar(_in_camera(), names | {"vertex": vertex_id}) is None:
            raise not_found()
        leased = [vertex_id, *(other for other in leased if other != vertex_id)][: 1 + ahead]
    if len(leased) < 1 + ahead:
        per_vertex = lock_recording(session, detection.recording_id, shared=True)
        search = OpenVertexSearch(session, detection.recording_id, names | {"wanted": per_vertex}, [*passed, *leased])
        most = 1 + (ahead if ahead <= _FEW else max(_FEW, search.half_share(ahead)))
        leased += search.take(max(0, most - len(leased)))
    if not leased:
        return []
    common = {"detection_id": detection.id, "sensor_id": camera.id, "person_id": person_id, "created_at": clock}
    until = clock + timedelta(seconds=lease_s)
    rows = [
        common | {"id": new_id(), "vertex_id": vertex_id, "leased_until": until - _APART * index}
        for index, vertex_id in enumerate(leased)
    ]
    session.connection().execute(_leasing(session.get_bind().dialect.name), rows)
    tasks = subjects(session, person_id, vertices=leased, camera_id=camera.id)
    return sorted(tasks, key=lambda task: leased.index(task.vertex.id))


@cache
def _giving_back() -> Any:
    task: Any = MarkingTask.__table__
    own = (task.c.detection_id == bindparam("detection"), task.c.person_id == bindparam("person"))
    skipped = update(task).where(task.c.id == bindparam("skipped"), *own)
    return skipped.values(leased_until=bindparam("clock")).returning(task.c.vertex_id)


@cache
def _in_camera() -> Select[UUID]:
    """A vertex of the detection that has a frame of the camera."""
    of_camera = (VertexFrame.vertex_id == Vertex.id) & (VertexFrame.sensor_id == bindparam("camera"))
    own = select(Vertex.id).join(VertexFrame, of_camera).where(Vertex.detection_id == bindparam("detection"))
    return own.where(Vertex.id == bindparam("vertex", type_=Uuid()))


@cache
def _held() -> Select[UUID]:
    """The vertices of a person's live leases."""
    person = bindparam("person", type_=Uuid())
    of_camera = (VertexFrame.vertex_id == Vertex.id) & (VertexFrame.sensor_id == MarkingTask.sensor_id)
    return (
        select(MarkingTask.vertex_id)
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
    lease = upserting(dialect, MarkingTask.__table__)
    return lease.on_conflict_do_update(
        index_elements=["vertex_id", "sensor_id", "person_id"],
        set_={"leased_until": lease.excluded.leased_until, "answered_at": None},
    )


def reopen(session: Session, person_id: UUID, recording_id: UUID, apex_id: UUID) -> None:
    """Open an apex to answers again. Callers do this before they write a row that refers to the recording.

    The person's tasks on the apex, in all cameras and detections, count as not answered.
    """
    lock_recording(session, recording_id)
    gone = delete(MarkingFrontier).where(MarkingFrontier.recording_id == recording_id)
    session.execute(gone)
    of_apex = MarkingTask.vertex_id.in_(select(Vertex.id).where(Vertex.apex_id == apex_id))
    tasks = update(MarkingTask).where(MarkingTask.person_id == person_id, of_apex).values(answered_at=None)
    session.execute(tasks)
