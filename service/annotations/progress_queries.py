"""What people said of a detection's vertices, and the answers that a person may see."""

from __future__ import annotations

from collections import Counter, defaultdict
from typing import Any
from uuid import UUID

from sqlalchemy import ColumnElement, Select, and_, case, func, or_, select
from sqlalchemy.orm import Session

from apexcal.documents.marking import OwnPair, PersonAnswers, Tally
from service.annotations.answer_queries import answers_of, answers_of_others, has_answered
from service.annotations.consensus import Opinion
from service.platform.db.annotations import Disclosure, Mark, Verdict
from service.platform.db.detections import Vertex, VertexFrame
from service.platform.db.people import Person

# The pages fit a camera to so many.
_MOST_PAIRS = 100


def tally(session: Session, detection_id: UUID, camera_id: UUID) -> Tally:
    """What people said of a detection's vertices in one camera, in numbers."""
    reviewed = func.sum(case((is_reviewed(), 1), else_=0))
    answers = session.execute(
        answers_of(detection_id, camera_id, Verdict.person_id, Verdict.verdict, func.count(), reviewed).group_by(
            Verdict.person_id, Verdict.verdict
        )
    ).all()
    verdicts: Counter[str] = Counter()
    people: Counter[UUID] = Counter()
    for person, verdict, count, _ in answers:
        verdicts[verdict] += count
        people[person] += count
    names = session.execute(select(Person.id, Person.name).where(Person.id.in_(list(people))).order_by(Person.name))
    return Tally(
        answers=verdicts.total(),
        confirmed=verdicts["confirmed"],
        rejected=verdicts["rejected"],
        unsure=verdicts["unsure"],
        marks=verdicts["confirmed"],
        reviewed=sum(int(row[3]) for row in answers),
        people=[PersonAnswers(name=name, answers=people[person]) for person, name in names],
    )


def own_pairs(session: Session, detection_id: UUID, camera_id: UUID, person_id: UUID) -> list[OwnPair]:
    """A person's newest marks with the vertices that they confirmed by them, the oldest first."""
    statement = (
        answers_of(detection_id, camera_id, Vertex, VertexFrame, Mark)
        .where(Verdict.person_id == person_id, Verdict.verdict == "confirmed")
        .order_by(Mark.updated_at.desc(), Mark.id)
        .limit(_MOST_PAIRS)
    )
    return [
        OwnPair(vertex_id=vertex.id, x=at.x, y=at.y, z=at.z, u=mark.u, v=mark.v)
        for vertex, frame, mark in reversed(session.execute(statement).all())
        for at in (frame if frame.x is not None else vertex,)
    ]


def opinions_of(session: Session, detection_id: UUID, camera_id: UUID) -> dict[UUID, list[Opinion]]:
    """Everybody's opinions on each vertex of a detection, in one camera."""
    opinions: dict[UUID, list[Opinion]] = defaultdict(list)
    statement = answers_of(
        *(detection_id, camera_id, Vertex.id, Verdict.verdict, Mark.u, Mark.v, is_reviewed(), Verdict.person_id)
    )
    for vertex_id, verdict, u, v, reviewed, person in session.execute(statement):
        mark = (u, v) if verdict == "confirmed" else None
        opinions[vertex_id].append(Opinion(verdict, mark, reviewed=bool(reviewed), person=person))
    return opinions


def is_reviewed() -> ColumnElement[bool]:
    """Whether an answer of :func:`answers_of` was given after something of others' was told to its person."""
    return or_(Verdict.reviewed, and_(Verdict.verdict == "confirmed", Mark.reviewed))


def visible_answers(
    detection_id: UUID, camera_id: UUID, person_id: UUID, wanted: int, *, everyone: bool
) -> Select[*tuple[Any, ...]]:
    """Answers with their parts: all of them, or a person's own and those on vertices that are complete for them.

    That is, which they confirmed or rejected, and which have as many answers as ``wanted``: of such a vertex nobody
    is asked any more.
    """
    first_told = (
        select(func.min(Disclosure.told_at))
        .where(Disclosure.person_id == Verdict.person_id, Disclosure.corner == Vertex.corner)
        .correlate(Verdict, Vertex, VertexFrame)
    )
    of_frame = first_told.where(
        Disclosure.sensor_id == VertexFrame.sensor_id, Disclosure.frame_index == VertexFrame.frame_index
    ).scalar_subquery()
    of_sweep = first_told.where(
        Disclosure.recording_id == Verdict.recording_id, Disclosure.sweep_index == Vertex.sweep_index
    ).scalar_subquery()
    told_at = case((of_frame < of_sweep, of_frame), else_=func.coalesce(of_sweep, of_frame))
    statement = answers_of(
        *(detection_id, camera_id, Verdict, Vertex.id, VertexFrame.frame_index, Mark, Person.name),
        *(is_reviewed(), told_at, Vertex.sweep_index, Vertex.corner),
    )
    statement = statement.join(Person, Person.id == Verdict.person_id)
    if everyone:
        return statement
    is_complete = and_(has_answered(person_id, decided=True), answers_of_others(person_id) >= wanted - 1)
    return statement.where(or_(Verdict.person_id == person_id, is_complete))
