"""The people who have answered a vertex, derived from the marks and verdicts that stand, not from tasks.

A person has answered a vertex for a camera when their verdict on its apex exists and, where that verdict is
``confirmed``, their mark in the paired frame too: one by hand, or the machine's that they confirmed. So answers
survive another detection run or another pairing.
"""

from __future__ import annotations

from typing import Any
from uuid import UUID

from sqlalchemy import CTE, ColumnElement, Select, and_, case, exists, func, or_, select

from service.platform.db.annotations import Answer, MarkingTask
from service.platform.db.base import lasting_alias
from service.platform.db.clock import now
from service.platform.db.detections import Vertex, VertexFrame

_verdict, _mark = lasting_alias(Answer), lasting_alias(Answer)
# What ``answers_of`` joins: the rows whose verdict stands, and those whose mark does.
VERDICT, MARK = lasting_alias(Answer, "verdict"), lasting_alias(Answer, "mark")


def has_answered(person: Any, *, decided: bool = False) -> ColumnElement[bool]:
    """Whether ``person`` has answered the enclosing query's ``Vertex`` in the frame of its ``VertexFrame``.

    ``decided``: and has not said ``unsure``, which would be a way to see what others said first.
    """
    only = (_verdict.verdict != "unsure",) if decided else ()
    # SQLAlchemy correlates with the nearest enclosing query by itself, and with none further out.
    return (
        exists()
        .where(is_on_apex(_verdict), _verdict.person_id == person, _is_complete(), *only)
        .correlate_except(_verdict)
    )


def answers_of_others(person_id: Any) -> ColumnElement[int]:
    """Count the other people who have answered the enclosing query's ``Vertex``."""
    return (
        select(func.count())
        .select_from(_verdict)
        .where(is_on_apex(_verdict), _verdict.person_id != person_id, _is_complete())
        .correlate_except(_verdict)
        .scalar_subquery()
    )


def answers_closing(person: Any, count: Any) -> ColumnElement[int]:
    """The number of answers on the enclosing query's ``Vertex``; one of ``person`` counts as ``count``."""
    counted = func.sum(case((_verdict.person_id == person, count), else_=1))
    answers = select(func.coalesce(counted, 0)).select_from(_verdict)
    return answers.where(is_on_apex(_verdict), _is_complete()).correlate_except(_verdict).scalar_subquery()


def leases_of_others(camera_id: Any, person_id: Any) -> CTE:
    """``apex_id`` and ``people``: how many others hold a live lease on it in a camera, and have not answered it.

    By apex and not by vertex: two detection runs of one recording share it, and its answers. They are few, some for
    each person who is marking, and the database finds them far quicker alone than vertex by vertex.
    """
    return (
        select(Vertex.apex_id, func.count(MarkingTask.person_id.distinct()).label("people"))
        .select_from(MarkingTask)
        .join(Vertex, Vertex.id == MarkingTask.vertex_id)
        .join(VertexFrame, and_(VertexFrame.vertex_id == Vertex.id, VertexFrame.sensor_id == camera_id))
        .where(
            MarkingTask.sensor_id == camera_id,
            MarkingTask.person_id != person_id,
            is_live(MarkingTask),
            ~has_answered(MarkingTask.person_id),
        )
        .group_by(Vertex.apex_id)
        .cte("lease")
    )


def has_machine_mark() -> ColumnElement[bool]:
    """Whether somebody's mark of the enclosing query's ``Vertex`` is the machine's, which they confirmed."""
    is_machine = _mark.machine_sigma_px.is_not(None)
    return exists().where(is_paired(_mark), is_machine).correlate_except(_mark)


def _is_complete() -> ColumnElement[bool]:
    """Whether ``_verdict`` has all that it needs: a confirmation needs the mark in the paired frame."""
    marked = exists().where(is_paired(_mark), _mark.person_id == _verdict.person_id).correlate_except(_mark)
    return or_(_verdict.verdict != "confirmed", marked)


def is_on_apex(answer: Any) -> ColumnElement[bool]:
    """Whether an answer's verdict is its person's on the apex of the enclosing query's ``Vertex``."""
    return and_(answer.apex_id == Vertex.apex_id, answer.is_verdict)


def is_paired(answer: Any) -> ColumnElement[bool]:
    """Whether an answer's mark is its person's on the enclosing query's ``Vertex``, in its ``VertexFrame``."""
    in_frame = and_(answer.sensor_id == VertexFrame.sensor_id, answer.frame_index == VertexFrame.frame_index)
    return and_(in_frame, answer.corner == Vertex.corner, answer.is_mark)


def is_live(task: Any) -> ColumnElement[bool]:
    """Whether a task is leased and not answered, by the database's clock."""
    return and_(task.answered_at.is_(None), task.leased_until > now())


def answers_of(detection_id: UUID, sensor_id: UUID, *columns: Any) -> Select[*tuple[Any, ...]]:
    """These columns of every answer on a detection's vertices in one camera, one row an answer.

    Of ``Vertex``, ``VertexFrame``, ``VERDICT`` and ``MARK``; the mark's are null where the verdict needs none.
    """
    return (
        select(*columns)
        .select_from(Vertex)
        .join(VertexFrame, and_(VertexFrame.vertex_id == Vertex.id, VertexFrame.sensor_id == sensor_id))
        .join(VERDICT, is_on_apex(VERDICT))
        .outerjoin(MARK, and_(is_paired(MARK), MARK.person_id == VERDICT.person_id))
        .where(Vertex.detection_id == detection_id, or_(VERDICT.verdict != "confirmed", MARK.id.is_not(None)))
    )
