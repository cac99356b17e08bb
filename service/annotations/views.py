"""Views of tasks and marks."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from datetime import datetime
from functools import cache
from itertools import chain, islice
from typing import Any, NamedTuple
from urllib.parse import quote
from uuid import UUID

from sqlalchemy import Select, and_, bindparam, func, select
from sqlalchemy.orm import Session

from apexcal.documents.detections import Moved, VertexSummary
from apexcal.documents.marking import MarkView, Own, Pixel, TaskFrame, TaskView
from service.annotations.answer_queries import is_on_apex, is_paired
from service.annotations.disclosure_actions import is_told
from service.detections.views import SUMMARY
from service.platform.auth.access import Access
from service.platform.db.annotations import Answer, MarkingTask
from service.platform.db.base import lasting_alias
from service.platform.db.detections import Apex, Detection, Vertex, VertexFrame
from service.platform.db.recordings import CameraFrame, Sensor
from service.platform.http.problems import not_found


class PriorAnswer(NamedTuple):
    """The parts of an earlier answer that the next one needs."""

    id: UUID
    version: int
    verdict: str | None
    u: float | None
    v: float | None
    sensor_id: UUID
    frame_index: int
    machine_sigma_px: float | None


class FrameFacts(NamedTuple):
    """A camera's frame, as far as a task shows it."""

    frame_index: int
    sensor_id: UUID
    stamp_ns: int
    width: int
    height: int


class Subject(NamedTuple):
    """A task with all that its answer touches; its person's standing mark and verdict, and their last answer.

    ``is_told``: something of others' answers was told to the person. ``moved``: the vertex at the frame's time.
    """

    task_id: UUID
    detection_id: UUID
    person_id: UUID
    leased_until: datetime
    fleet_id: UUID
    recording_id: UUID
    camera: str
    gap_ns: int
    is_told: bool
    apex_id: UUID
    frame: FrameFacts
    mark: PriorAnswer | None
    verdict: PriorAnswer | None
    last: PriorAnswer | None
    moved: Moved | None
    vertex: VertexSummary


_frame = lasting_alias(CameraFrame)
_mark, _verdict, _last, _any = (lasting_alias(Answer) for _ in range(4))


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
    # Rows of columns by the connection: objects of the session take twice the time of the whole statement.
    return [*map(_subject, session.connection().execute(_subjects(of_task=task_id is not None, lock=lock), names))]


def _subject(row: Sequence[Any]) -> Subject:
    columns = iter(row)
    counts = (len(part) for part in _PARTS)
    facts, frame, *answers, moved, vertex = ([*islice(columns, count)] for count in counts)
    mark, verdict, last = (PriorAnswer._make(answer) if answer[0] is not None else None for answer in answers)
    displacement = Moved(**dict(zip(Moved.model_fields, moved, strict=True))) if moved[0] is not None else None
    summary = VertexSummary(**dict(zip(VertexSummary.model_fields, vertex, strict=True)))
    return Subject._make([*facts, FrameFacts._make(frame), mark, verdict, last, displacement, summary])


def _columns(of: Any, names: Iterable[str]) -> tuple[Any, ...]:
    return tuple(getattr(of, name) for name in names)


_TOLD = is_told(MarkingTask.person_id, VertexFrame.sensor_id, VertexFrame.frame_index, Vertex.corner)
# What a subject is made of, in the order of its members.
_PARTS = (
    (
        *_columns(MarkingTask, ("id", "detection_id", "person_id", "leased_until")),
        *(Detection.fleet_id, Sensor.recording_id, Sensor.name, VertexFrame.gap_ns, _TOLD, Vertex.apex_id),
    ),
    _columns(_frame, ("index", *FrameFacts._fields[1:])),
    *(_columns(answer, PriorAnswer._fields) for answer in (_mark, _verdict, _last)),
    _columns(VertexFrame, Moved.model_fields),
    SUMMARY,
)


@cache
def _subjects(*, of_task: bool, lock: bool) -> Select[*tuple[Any, ...]]:
    """Tasks with their vertices, frames, and what their persons said."""
    person = MarkingTask.person_id
    newest = select(func.max(_any.version)).where(*_is_own(_any)).correlate_except(_any).scalar_subquery()
    statement = (
        select(*chain.from_iterable(_PARTS))
        .select_from(MarkingTask)
        .join(Detection, Detection.id == MarkingTask.detection_id)
        .join(Vertex, Vertex.id == MarkingTask.vertex_id)
        .join(Sensor, Sensor.id == MarkingTask.sensor_id)
        .join(VertexFrame, and_(VertexFrame.vertex_id == Vertex.id, VertexFrame.sensor_id == Sensor.id))
        .join(_frame, and_(_frame.sensor_id == Sensor.id, _frame.index == VertexFrame.frame_index))
        .outerjoin(_mark, and_(is_paired(_mark), _mark.person_id == person))
        .outerjoin(_verdict, and_(is_on_apex(_verdict), _verdict.person_id == person))
        .outerjoin(_last, and_(*_is_own(_last), _last.version == newest))
        .where(person == bindparam("person"))
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
    """Lock the subject of a person's own task for an answer. For them other people's tasks do not exist."""
    for subject in subjects(access.session, access.person.id, task_id=task_id, lock=True):
        access.need(subject.fleet_id, "annotator")
        return subject
    raise not_found()


def mark_view(mark: Answer) -> MarkView:
    """The mark of an answer that has one."""
    assert mark.u is not None and mark.v is not None
    return MarkView(u=mark.u, v=mark.v, version=mark.version)


def is_machine(answer: Answer | PriorAnswer) -> bool:
    """Whether an answer's mark is the machine's, which the person confirmed."""
    return answer.machine_sigma_px is not None


def task_view(subject: Subject) -> TaskView:
    """A person's task, with all that is needed to judge it and nothing of what others said."""
    frame, address = subject.frame, f"/v1/recordings/{subject.recording_id}/cameras/{quote(subject.camera, safe='')}"
    return TaskView.of(
        subject,
        frame=TaskFrame(
            index=frame.frame_index,
            stamp_ns=frame.stamp_ns,
            width=frame.width,
            height=frame.height,
            url=f"{address}/frames/{frame.frame_index}",
        ),
        own=own_answer(subject),
        ahead=[],
    )


def own_answer(subject: Subject) -> Own:
    """A person's verdict and mark of a vertex; also the mark of an answer that they took back."""
    last, mark = subject.last, subject.mark
    if mark is None and last is not None and last.frame_index == subject.frame.frame_index:
        mark = last
    if mark is not None and is_machine(mark):
        mark = None  # its pixel would tell which crops are shifted
    # With no answer in this camera, the verdict of one in another camera.
    answer = last or subject.verdict
    u, v = (mark.u, mark.v) if mark else (None, None)
    return Own(
        version=own_version(subject),
        mark=None if u is None or v is None else Pixel(u=u, v=v),
        verdict=answer.verdict if answer else None,  # pyright: ignore[reportArgumentType] - only verdicts
    )


def own_version(subject: Subject) -> int:
    """The version of what a person said last of a vertex, by an answer or by a mark alone; 0 for nothing."""
    return max(subject.last.version if subject.last else 0, subject.mark.version if subject.mark else 0)
