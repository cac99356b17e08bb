"""Counts of the answers on a detection's vertices, and the answers that a person may see."""

from __future__ import annotations

from collections import Counter, defaultdict
from typing import Any
from uuid import UUID

from sqlalchemy import ColumnElement, Select, and_, case, func, or_, select
from sqlalchemy.orm import Session

from apexcal.documents.marking import AnsweredSweeps, PersonAnswers, Tally
from service.annotations.answer_queries import MARK, VERDICT, answers_of, answers_of_others, has_answered
from service.annotations.consensus import MACHINE, MachineShare, Opinion
from service.platform.db.annotations import Disclosure
from service.platform.db.detections import Vertex, VertexFrame
from service.platform.db.people import Person


def tally(session: Session, detection_id: UUID, camera_id: UUID) -> Tally:
    """Count the answers on a detection's vertices in one camera."""
    reviewed = func.sum(case((is_reviewed(), 1), else_=0))
    by_machine = func.sum(case((MARK.machine_sigma_px.is_not(None), 1), else_=0))
    columns = (VERDICT.person_id, VERDICT.verdict, func.count(), reviewed, by_machine)
    statement = answers_of(detection_id, camera_id, *columns).group_by(VERDICT.person_id, VERDICT.verdict)
    answers = session.execute(statement).all()
    verdicts: Counter[str] = Counter()
    people: Counter[UUID] = Counter()
    for person, verdict, count, *_ in answers:
        verdicts[verdict] += count
        people[person] += count
    names = session.execute(select(Person.id, Person.name).where(Person.id.in_(list(people))).order_by(Person.name))
    return Tally(
        answers=verdicts.total(),
        confirmed=verdicts["confirmed"],
        rejected=verdicts["rejected"],
        unsure=verdicts["unsure"],
        marks=verdicts["confirmed"] - sum(int(row[4]) for row in answers if row[1] == "confirmed"),
        reviewed=sum(int(row[3]) for row in answers),
        people=[PersonAnswers(name=name, answers=people[person]) for person, name in names],
    )


def answered_sweeps(session: Session, detection_id: UUID, camera_id: UUID, person_id: UUID) -> AnsweredSweeps:
    """Return the sweeps with answers in one camera, in order: those of anybody, and those of the person."""
    is_own = func.max(case((VERDICT.person_id == person_id, 1), else_=0))
    rows = session.execute(
        answers_of(detection_id, camera_id, Vertex.sweep_index, is_own)
        .group_by(Vertex.sweep_index)
        .order_by(Vertex.sweep_index)
    ).all()
    return AnsweredSweeps(sweeps=[row[0] for row in rows], mine=[row[0] for row in rows if row[1]])


def opinions_of(session: Session, detection_id: UUID, camera_id: UUID) -> dict[UUID, list[Opinion]]:
    """Return everybody's opinions on each judged vertex of a detection, in one camera.

    A person who confirmed the machine's mark has an opinion without a mark. The mark counts once as the machine's
    opinion, however many people confirmed it.
    """
    opinions: dict[UUID, list[Opinion]] = defaultdict(list)
    columns = (Vertex.id, VERDICT.verdict, MARK.u, MARK.v, MARK.machine_sigma_px, MARK.crop_side_px)
    # The machine may have run twice and moved a mark: the newest mark comes last, and counts.
    statement = answers_of(detection_id, camera_id, *columns, is_reviewed(), VERDICT.person_id).order_by(MARK.id)
    machine: dict[UUID, Opinion] = {}
    for vertex_id, verdict, u, v, sigma_px, side_px, reviewed, person in session.execute(statement):
        mark = (u, v) if verdict == "confirmed" else None
        if mark and sigma_px is not None:
            share = MachineShare(sigma_px, side_px)
            machine[vertex_id] = Opinion(verdict, mark, person=MACHINE, machine=share)
            mark = None
        opinions[vertex_id].append(Opinion(verdict, mark, reviewed=bool(reviewed), person=person))
    for vertex_id, opinion in machine.items():
        opinions[vertex_id].append(opinion)
    return opinions


def is_reviewed() -> ColumnElement[bool]:
    """Return whether the person of an answer of :func:`answers_of` knew others' answers when they gave it."""
    return or_(VERDICT.reviewed, and_(VERDICT.verdict == "confirmed", MARK.reviewed))


def visible_answers(
    detection_id: UUID, camera_id: UUID, person_id: UUID, per_vertex: int, *, everyone: bool
) -> Select[*tuple[Any, ...]]:
    """Select answers with their parts: all of them, or those that a person may see.

    A person sees their own answers, and others' on vertices that are complete for them: they confirmed or rejected
    the vertex, and it has ``per_vertex`` answers, so nobody is asked about it any more.
    """
    first_told = (
        select(func.min(Disclosure.told_at))
        .where(Disclosure.person_id == VERDICT.person_id, Disclosure.corner == Vertex.corner)
        .correlate(VERDICT, Vertex, VertexFrame)
    )
    of_frame = first_told.where(
        Disclosure.sensor_id == VertexFrame.sensor_id, Disclosure.frame_index == VertexFrame.frame_index
    ).scalar_subquery()
    of_sweep = first_told.where(
        Disclosure.recording_id == VERDICT.recording_id, Disclosure.sweep_index == Vertex.sweep_index
    ).scalar_subquery()
    told_at = case((of_frame < of_sweep, of_frame), else_=func.coalesce(of_sweep, of_frame))
    statement = answers_of(
        *(detection_id, camera_id, VERDICT, Vertex.id, VertexFrame.frame_index, MARK, Person.name),
        *(is_reviewed(), told_at, Vertex.sweep_index, Vertex.corner),
    )
    statement = statement.join(Person, Person.id == VERDICT.person_id)
    if everyone:
        return statement
    is_complete = and_(has_answered(person_id, decided=True), answers_of_others(person_id) >= per_vertex - 1)
    return statement.where(or_(VERDICT.person_id == person_id, is_complete))
