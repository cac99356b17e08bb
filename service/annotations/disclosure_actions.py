"""Who was told something of others' answers, on which vertex, and when.

An annotator is told nothing of others before the vertex is complete and they have decided it themselves. Reviewers,
engineers and admins may look at any time. Each disclosure is written down before the answer goes out. What the person
answers on that vertex afterwards is reviewed, and not independent.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal
from uuid import UUID

from sqlalchemy import Select, exists, select
from sqlalchemy.orm import Session

from service.annotations.answer_queries import answers_of
from service.auth.access import Access
from service.db.annotations import Disclosure, Verdict
from service.db.calibrations import CorrespondenceSet
from service.db.clock import now
from service.db.detections import Vertex, VertexFrame
from service.db.recordings import Recording, Sensor
from service.db.session import Database
from service.http.problems import not_found

Place = Literal["marks", "tally", "pairs", "result", "calibration"]


def was_told(session: Session, person_id: UUID, apex_id: UUID) -> bool:
    """Whether the person knows something of others' answers on this apex, in any camera: a verdict is for all."""
    told = exists().where(Disclosure.person_id == person_id, Disclosure.apex_id == apex_id)
    return bool(session.scalar(select(told)))


def was_told_of_frame(session: Session, person_id: UUID, sensor_id: UUID, frame_index: int, corner: str) -> bool:
    """Whether the person knows something of others' answers on any vertex of a corner paired with this frame."""
    told = exists().where(
        Disclosure.person_id == person_id,
        Vertex.apex_id == Disclosure.apex_id,
        Vertex.corner == corner,
        VertexFrame.vertex_id == Vertex.id,
        VertexFrame.sensor_id == sensor_id,
        VertexFrame.frame_index == frame_index,
    )
    return bool(session.scalar(select(told)))


def answered_by_others(session: Session, detection_id: UUID, sensor_id: UUID, person_id: UUID) -> set[UUID]:
    """The apexes of a detection that somebody else has answered in a camera."""
    statement = answers_of(detection_id, sensor_id, Vertex.apex_id).where(Verdict.person_id != person_id)
    return set(session.scalars(statement.distinct()))


def keep(session: Session, person_id: UUID, camera: Sensor, apexes: Iterable[UUID], told_in: Place) -> None:
    """Record that these are disclosed, in a session that writes. Earlier disclosures stay as they are."""
    # Under the recording's lock nobody else inserts the same rows between the look and the insert.
    if session.get(Recording, camera.recording_id, with_for_update={"key_share": True}) is None:
        raise not_found()
    session.add_all(
        Disclosure(
            recording_id=camera.recording_id,
            person_id=person_id,
            apex_id=apex_id,
            sensor_id=camera.id,
            told_in=told_in,
            told_at=now(),
        )
        for apex_id in sorted(_news(session, person_id, camera.id, apexes))
    )


def tell(access: Access, database: Database, camera: Sensor, apexes: Iterable[UUID], told_in: Place) -> None:
    """The same for a request that reads: call it after reading, before the answer goes out."""
    apexes = set(apexes)
    if not _news(access.session, access.person.id, camera.id, apexes):
        return
    # Its connection goes back first: a request that held two could wait for others that do the same.
    access.session.close()
    with database.writing() as session:
        keep(session, access.person.id, camera, apexes, told_in)


def tell_pairs(access: Access, database: Database, pairs: CorrespondenceSet, told_in: Place) -> None:
    """The same for pairs made of marks: they disclose every vertex of their detection in their camera."""
    if pairs.source != "annotations" or pairs.detection_id is None:
        return
    camera = access.session.scalar(
        select(Sensor).where(Sensor.recording_id == pairs.recording_id, Sensor.name == pairs.camera)
    )
    if camera is not None:
        others = answered_by_others(access.session, pairs.detection_id, camera.id, access.person.id)
        tell(access, database, camera, others, told_in)


def _news(session: Session, person_id: UUID, sensor_id: UUID, apexes: Iterable[UUID]) -> set[UUID]:
    return set(apexes) - set(session.scalars(_of(person_id, sensor_id)))


def _of(person_id: UUID, sensor_id: UUID) -> Select[UUID]:
    return select(Disclosure.apex_id).where(Disclosure.person_id == person_id, Disclosure.sensor_id == sensor_id)
