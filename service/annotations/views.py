"""Views of tasks, marks and answers."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any, NamedTuple
from urllib.parse import quote
from uuid import UUID

from sqlalchemy import Select, and_, bindparam, or_, select
from sqlalchemy.orm import Session, defer

from apexcal.documents.detections import Moved, VertexSummary
from apexcal.documents.marking import MarkView, Own, Pixel, TaskFrame, TaskView
from service.annotations.answer_queries import is_paired
from service.annotations.disclosure_actions import is_told
from service.auth.access import Access
from service.db.annotations import Answer, Mark, MarkingTask, Verdict
from service.db.detections import Apex, Detection, Vertex, VertexFrame
from service.db.recordings import CameraFrame, Sensor
from service.http.problems import not_found


class Subject(NamedTuple):
    """A task with all that its answer touches: the vertex, its frame in the camera, and what its person said of it.

    ``told``: whether something of others' answers was told to the person.
    """

    task: MarkingTask
    vertex: Vertex
    camera: Sensor
    frame: CameraFrame
    pairing: VertexFrame
    mark: Mark | None
    verdict: Verdict | None
    fleet_id: UUID
    told: bool


def subjects(
    session: Session,
    person_id: UUID,
    *,
    task_id: UUID | None = None,
    vertices: Sequence[UUID] = (),
    camera_id: UUID | None = None,
    lock: bool = False,
) -> list[Subject]:
    """The subject of a person's task, or of those on these vertices in a camera.

    ``lock``: nobody else answers on their apexes until the transaction ends.
    """
    names = {"person": person_id, "task": task_id, "vertices": vertices, "camera": camera_id}
    rows = session.execute(_subjects(of_task=task_id is not None, lock=lock), names)
    return [Subject(*row) for row in rows]


@cache
def _subjects(*, of_task: bool, lock: bool) -> Select[*tuple[Any, ...]]:
    told = is_told(MarkingTask.person_id, VertexFrame.sensor_id, VertexFrame.frame_index, Vertex.corner)
    statement = (
        select(MarkingTask, Vertex, Sensor, CameraFrame, VertexFrame, Mark, Verdict, Detection.fleet_id, told)
        .select_from(MarkingTask)
        .join(Detection, Detection.id == MarkingTask.detection_id)
        .join(Vertex, Vertex.id == MarkingTask.vertex_id)
        .join(Sensor, Sensor.id == MarkingTask.sensor_id)
        .join(VertexFrame, and_(VertexFrame.vertex_id == Vertex.id, VertexFrame.sensor_id == Sensor.id))
        .join(CameraFrame, and_(CameraFrame.sensor_id == Sensor.id, CameraFrame.index == VertexFrame.frame_index))
        .outerjoin(Mark, and_(is_paired(Mark), Mark.person_id == MarkingTask.person_id))
        .outerjoin(Verdict, and_(Verdict.person_id == MarkingTask.person_id, Verdict.apex_id == Vertex.apex_id))
        .where(MarkingTask.person_id == bindparam("person"))
        .options(defer(Vertex.covariance), defer(Vertex.corners), defer(VertexFrame.corners))
        .execution_options(populate_existing=True)
    )
    if of_task:
        statement = statement.where(MarkingTask.id == bindparam("task"))
    else:
        is_one = MarkingTask.vertex_id.in_(bindparam("vertices", expanding=True))
        statement = statement.where(is_one, MarkingTask.sensor_id == bindparam("camera"))
    if not lock:
        return statement
    return statement.join(Apex, Apex.id == Vertex.apex_id).with_for_update(key_share=True, of=Apex)


def find_subject(access: Access, task_id: UUID) -> Subject:
    """What a person's own task asks, locked for an answer. Another person's tasks do not exist for them."""
    for subject in subjects(access.session, access.person.id, task_id=task_id, lock=True):
        access.need(subject.fleet_id, "annotator")
        return subject
    raise not_found()


def mark_view(mark: Mark) -> MarkView:
    """A mark's public members."""
    return MarkView(u=mark.u, v=mark.v, version=mark.version)


def task_views(session: Session, found: Sequence[Subject]) -> list[TaskView]:
    """Tasks of one person in one camera, with all that is needed to judge them and nothing of what others said."""
    if not found:
        return []
    last = {row.apex_id: row for row in own_answers(session, found[0], [one.vertex.apex_id for one in found])}
    return [_task_view(one, own_answer(one, last.get(one.vertex.apex_id))) for one in found]


def _task_view(found: Subject, own: Own) -> TaskView:
    task, vertex, camera, frame, pairing = found[:5]
    return TaskView(
        task_id=task.id,
        person_id=task.person_id,
        leased_until=task.leased_until,
        vertex=VertexSummary.model_validate(vertex, from_attributes=True),
        camera=camera.name,
        frame=TaskFrame(
            index=frame.index,
            stamp_ns=frame.stamp_ns,
            width=frame.width,
            height=frame.height,
            url=f"/v1/recordings/{camera.recording_id}/cameras/{quote(camera.name, safe='')}/frames/{frame.index}",
        ),
        gap_ns=pairing.gap_ns,
        moved=Moved.model_validate(pairing) if pairing.x is not None else None,
        predicted=None,
        own=own,
    )


def own_answers(session: Session, found: Subject, apexes: Sequence[UUID], id: UUID | None = None) -> list[Answer]:
    """All answers of a subject's person on these apexes in its camera, also those taken back, by version.

    With ``id``: and whose answer it may be.
    """
    whose = {"person": found.task.person_id, "sensor": found.camera.id, "apexes": apexes, "id": id}
    return list(session.scalars(_own_answers(), whose))


@cache
def _own_answers() -> Select[Any]:
    own = and_(
        Answer.person_id == bindparam("person"),
        Answer.apex_id.in_(bindparam("apexes", expanding=True)),
        Answer.sensor_id == bindparam("sensor"),
    )
    return select(Answer).where(or_(own, Answer.id == bindparam("id"))).order_by(Answer.version)


def own_answer(found: Subject, last: Answer | None) -> Own:
    """What a person says of a vertex, and where they marked it; also the mark of an answer that they took back."""
    mark: Mark | Answer | None = found.mark
    if mark is None and last is not None and last.frame_index == found.frame.index:
        mark = last
    # Without a version: the verdict of an answer in another camera.
    said = last or found.verdict
    u, v = (mark.u, mark.v) if mark else (None, None)
    return Own(
        version=last.version if last else 0,
        mark=None if u is None or v is None else Pixel(u=u, v=v),
        verdict=said.verdict if said else None,  # pyright: ignore[reportArgumentType] - only verdicts
    )
