"""Views of tasks and marks."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any
from urllib.parse import quote
from uuid import UUID

from sqlalchemy import Row, Select, and_, bindparam, func, select
from sqlalchemy.orm import Session, aliased

from apexcal.documents.detections import Moved, VertexSummary
from apexcal.documents.marking import MarkView, Own, Pixel, TaskFrame, TaskView
from service.annotations.answer_queries import is_paired
from service.annotations.disclosure_actions import is_told
from service.detections.views import SUMMARY
from service.platform.auth.access import Access
from service.platform.db.annotations import Answer, Mark, MarkingTask, Verdict
from service.platform.db.detections import Apex, Detection, Vertex, VertexFrame
from service.platform.db.recordings import CameraFrame, Sensor
from service.platform.http.problems import not_found

# A task with all that its answer touches: the columns of `_subjects`.
Subject = Row[*tuple[Any, ...]]

_frame, _mark = aliased(CameraFrame, name="camera_frame"), aliased(Mark, name="mark")
_verdict, _last, _any = aliased(Verdict, name="verdict"), aliased(Answer, name="last"), aliased(Answer)


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
    return [*session.execute(_subjects(of_task=task_id is not None, lock=lock), names)]


@cache
def _subjects(*, of_task: bool, lock: bool) -> Select[*tuple[Any, ...]]:
    """Tasks with their vertices, frames, and what their persons said; a vertex's columns are those of a summary.

    ``told``: whether something of others' answers was told to the person. ``last``: the last answer of theirs.
    """
    person, corner = MarkingTask.person_id, Vertex.corner
    told = is_told(person, VertexFrame.sensor_id, VertexFrame.frame_index, corner).label("told")
    newest = select(func.max(_any.version)).where(*_is_own(_any)).correlate_except(_any).scalar_subquery()
    statement = (
        select(MarkingTask.id.label("task_id"), MarkingTask.detection_id, person, MarkingTask.leased_until)
        .add_columns(Detection.fleet_id, Sensor.recording_id, Sensor.name.label("camera"), VertexFrame.gap_ns)
        .add_columns(*(getattr(VertexFrame, name).label(f"moved_{name}") for name in Moved.model_fields))
        .add_columns(_frame, _mark, _verdict, _last, told, Vertex.apex_id, *SUMMARY)
        .select_from(MarkingTask)
        .join(Detection, Detection.id == MarkingTask.detection_id)
        .join(Vertex, Vertex.id == MarkingTask.vertex_id)
        .join(Sensor, Sensor.id == MarkingTask.sensor_id)
        .join(VertexFrame, and_(VertexFrame.vertex_id == Vertex.id, VertexFrame.sensor_id == Sensor.id))
        .join(_frame, and_(_frame.sensor_id == Sensor.id, _frame.index == VertexFrame.frame_index))
        .outerjoin(_mark, and_(is_paired(_mark), _mark.person_id == person))
        .outerjoin(_verdict, and_(_verdict.person_id == person, _verdict.apex_id == Vertex.apex_id))
        .outerjoin(_last, and_(*_is_own(_last), _last.version == newest))
        .where(person == bindparam("person"))
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


def _is_own(answer: Any) -> tuple[Any, ...]:
    """Whether an answer is the enclosing query's person's, on its ``Vertex`` in the task's camera."""
    of_person = (answer.person_id == MarkingTask.person_id, answer.sensor_id == MarkingTask.sensor_id)
    return (*of_person, answer.apex_id == Vertex.apex_id)


def find_subject(access: Access, task_id: UUID) -> Subject:
    """What a person's own task asks, locked for an answer. Another person's tasks do not exist for them."""
    for subject in subjects(access.session, access.person.id, task_id=task_id, lock=True):
        access.need(subject.fleet_id, "annotator")
        return subject
    raise not_found()


def mark_view(mark: Mark) -> MarkView:
    """A mark's public members."""
    return MarkView(u=mark.u, v=mark.v, version=mark.version)


def task_view(found: Subject) -> TaskView:
    """A person's task, with all that is needed to judge it and nothing of what others said."""
    frame, address = found.camera_frame, f"/v1/recordings/{found.recording_id}/cameras/{quote(found.camera, safe='')}"
    moved = {name: getattr(found, f"moved_{name}") for name in Moved.model_fields}
    return TaskView(
        task_id=found.task_id,
        person_id=found.person_id,
        leased_until=found.leased_until,
        vertex=VertexSummary.model_validate(found, from_attributes=True),
        camera=found.camera,
        frame=TaskFrame(
            index=frame.index,
            stamp_ns=frame.stamp_ns,
            width=frame.width,
            height=frame.height,
            url=f"{address}/frames/{frame.index}",
        ),
        gap_ns=found.gap_ns,
        moved=Moved(**moved) if found.moved_x is not None else None,
        predicted=None,
        own=own_answer(found),
    )


def own_answer(found: Subject) -> Own:
    """What a person says of a vertex, and where they marked it; also the mark of an answer that they took back."""
    last: Answer | None = found.last
    mark: Mark | Answer | None = found.mark
    if mark is None and last is not None and last.frame_index == found.camera_frame.index:
        mark = last
    # Without a version: the verdict of an answer in another camera.
    said = last or found.verdict
    u, v = (mark.u, mark.v) if mark else (None, None)
    return Own(
        version=last.version if last else 0,
        mark=None if u is None or v is None else Pixel(u=u, v=v),
        verdict=said.verdict if said else None,  # pyright: ignore[reportArgumentType] - only verdicts
    )
