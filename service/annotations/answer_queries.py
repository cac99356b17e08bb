"""Who has answered a vertex, derived from marks and verdicts, not from tasks.

A person has answered a vertex for a camera when their verdict on its apex exists and, where that verdict is
``confirmed``, their mark in the paired frame too. So answers survive another detection run or another pairing.
"""

from __future__ import annotations

from typing import Any
from uuid import UUID

from sqlalchemy import CTE, ColumnElement, Select, and_, case, exists, func, or_, select
from sqlalchemy.orm import aliased

from service.platform.db.annotations import Mark, MarkingTask, Verdict
from service.platform.db.clock import now
from service.platform.db.detections import Vertex, VertexFrame

# Made once: aliases made anew make every statement a new one, and compiling it takes longer than running it.
_verdict, _mark = aliased(Verdict), aliased(Mark)


def has_answered(person: Any, *, decided: bool = False) -> ColumnElement[bool]:
    """Whether ``person`` has answered the enclosing query's ``Vertex`` in the frame of its ``VertexFrame``.

    ``decided``: and has not said ``unsure``, which would be a way to see what others said first.
    """
    only = (_verdict.verdict != "unsure",) if decided else ()
    # SQLAlchemy correlates with the nearest enclosing query by itself, and with none further out.
    return (
        exists()
        .where(_verdict.apex_id == Vertex.apex_id, _verdict.person_id == person, _is_complete(), *only)
        .correlate_except(_verdict)
    )


def answers_of_others(person_id: Any) -> ColumnElement[int]:
    """How many other people have answered the enclosing query's ``Vertex``."""
    return (
        select(func.count())
        .select_from(_verdict)
        .where(_verdict.apex_id == Vertex.apex_id, _verdict.person_id != person_id, _is_complete())
        .correlate_except(_verdict)
        .scalar_subquery()
    )


def answers_closing(person: Any, wanted: Any) -> ColumnElement[int]:
    """The number of answers on the enclosing query's ``Vertex``; one of ``person`` counts as ``wanted``."""
    counted = func.sum(case((_verdict.person_id == person, wanted), else_=1))
    answers = select(func.coalesce(counted, 0)).select_from(_verdict)
    return (
        answers.where(_verdict.apex_id == Vertex.apex_id, _is_complete()).correlate_except(_verdict).scalar_subquery()
    )


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


def _is_complete() -> ColumnElement[bool]:
    """Whether ``_verdict`` has all that it needs: a confirmation needs the mark in the paired frame."""
    marked = exists().where(is_paired(_mark), _mark.person_id == _verdict.person_id).correlate_except(_mark)
    return or_(_verdict.verdict != "confirmed", marked)


def is_paired(mark: Any) -> ColumnElement[bool]:
    """Whether a mark is of the corner of the enclosing query's ``Vertex``, in the frame of its ``VertexFrame``."""
    in_frame = and_(mark.sensor_id == VertexFrame.sensor_id, mark.frame_index == VertexFrame.frame_index)
    return and_(in_frame, mark.corner == Vertex.corner)


def is_live(task: Any) -> ColumnElement[bool]:
    """Whether a task is leased and not answered, by the database's clock."""
    return and_(task.answered_at.is_(None), task.leased_until > now())


def answers_of(detection_id: UUID, sensor_id: UUID, *columns: Any) -> Select[*tuple[Any, ...]]:
    """These columns of every answer on a detection's vertices in one camera, one row an answer.

    Of ``Vertex``, ``VertexFrame``, ``Verdict`` and ``Mark``; the mark's are null where the verdict needs none.
    """
    return (
        select(*columns)
        .select_from(Vertex)
        .join(VertexFrame, and_(VertexFrame.vertex_id == Vertex.id, VertexFrame.sensor_id == sensor_id))
        .join(Verdict, Verdict.apex_id == Vertex.apex_id)
        .outerjoin(Mark, and_(is_paired(Mark), Mark.person_id == Verdict.person_id))
        .where(Vertex.detection_id == detection_id, or_(Verdict.verdict != "confirmed", Mark.id.is_not(None)))
    )
