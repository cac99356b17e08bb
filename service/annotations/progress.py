"""How far the marking of a detection is, and the answers that a person may see."""

from __future__ import annotations

from collections import Counter, defaultdict
from typing import Any
from uuid import UUID

from sqlalchemy import Select, func, or_, select
from sqlalchemy.orm import Session

from service.annotations.answered import answers_of, has_answered
from service.annotations.consensus import Opinion
from service.annotations.schemas import PersonAnswers, Pixel, Progress
from service.db.annotations import Mark, Verdict
from service.db.detections import Detection, Vertex, VertexFrame
from service.db.people import Person
from service.db.recordings import Recording, Sensor


def count_vertices(session: Session, detection_id: UUID, camera_id: UUID) -> int:
    """Vertices of a detection that have a frame of the camera."""
    return (
        session.scalar(
            select(func.count())
            .select_from(Vertex)
            .join(VertexFrame, VertexFrame.vertex_id == Vertex.id)
            .where(Vertex.detection_id == detection_id, VertexFrame.sensor_id == camera_id)
        )
        or 0
    )


def progress(session: Session, detection: Detection, camera: Sensor, person_id: UUID) -> Progress:
    """Progress of the marking in one camera, as ``person_id`` sees it."""
    wanted = session.get_one(Recording, detection.recording_id).marks_per_vertex
    answers = session.execute(
        answers_of(detection.id, camera.id, Verdict.person_id, Verdict.verdict, func.count()).group_by(
            Verdict.person_id, Verdict.verdict
        )
    ).all()
    per_vertex = session.scalars(answers_of(detection.id, camera.id, func.count()).group_by(Vertex.id)).all()
    verdicts: Counter[str] = Counter()
    people: Counter[UUID] = Counter()
    for person, verdict, count in answers:
        verdicts[verdict] += count
        people[person] += count
    names = session.execute(select(Person.id, Person.name).where(Person.id.in_(list(people))).order_by(Person.name))
    return Progress(
        vertices=count_vertices(session, detection.id, camera.id),
        marks_wanted=wanted,
        answered=len(per_vertex),
        answers=verdicts.total(),
        mine=people[person_id],
        complete=sum(count >= wanted for count in per_vertex),
        confirmed=verdicts["confirmed"],
        rejected=verdicts["rejected"],
        unsure=verdicts["unsure"],
        marks=verdicts["confirmed"],
        people=[PersonAnswers(name=name, answers=people[person]) for person, name in names],
    )


def opinions_of(session: Session, detection_id: UUID, camera_id: UUID) -> dict[UUID, list[Opinion]]:
    """Everybody's opinions on each vertex of a detection, in one camera."""
    opinions: dict[UUID, list[Opinion]] = defaultdict(list)
    statement = answers_of(detection_id, camera_id, Vertex.id, Verdict.verdict, Mark.u, Mark.v)
    for vertex_id, verdict, u, v in session.execute(statement):
        opinions[vertex_id].append(Opinion(verdict, (u, v) if verdict == "confirmed" else None))
    return opinions


def visible_answers(
    detection_id: UUID, camera_id: UUID, person_id: UUID, *, everyone: bool
) -> Select[*tuple[Any, ...]]:
    """Answers with their parts: all, or a person's own and those on vertices that they confirmed or rejected."""
    statement = answers_of(detection_id, camera_id, Verdict, Vertex.id, VertexFrame.frame_index, Mark, Person.name)
    statement = statement.join(Person, Person.id == Verdict.person_id)
    return (
        statement
        if everyone
        else statement.where(or_(Verdict.person_id == person_id, has_answered(person_id, decided=True)))
    )


def marks_of_others(session: Session, person_id: UUID, camera_id: UUID, frame_index: int) -> list[Pixel]:
    """What other people marked in a frame."""
    rows = session.execute(
        select(Mark.u, Mark.v)
        .where(Mark.sensor_id == camera_id, Mark.frame_index == frame_index, Mark.person_id != person_id)
        .order_by(Mark.id)
    )
    return [Pixel(u=u, v=v) for u, v in rows]
