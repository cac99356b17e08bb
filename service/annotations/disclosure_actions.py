"""Who was told something of others' answers, on which vertex, and when.

An annotator is told nothing of others before the vertex is complete and they have decided it themselves. Reviewers,
engineers and admins may look at any time. Each disclosure is written down before the answer goes out, by camera,
frame and corner: another detection may pair the same frame with another vertex. What the person answers there
afterwards is reviewed, and not independent.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, Literal, NamedTuple
from uuid import UUID

from sqlalchemy import ColumnElement, and_, exists, insert, or_, select
from sqlalchemy.orm import Session

from service.annotations.answer_queries import VERDICT, answers_of
from service.annotations.locks import lock_person
from service.platform.auth.access import Access
from service.platform.db.annotations import Answer, Disclosure
from service.platform.db.base import lasting_alias
from service.platform.db.calibrations import CorrespondenceSet
from service.platform.db.clock import utc_now
from service.platform.db.detections import Detection, Vertex, VertexFrame
from service.platform.db.recordings import Recording, Sensor
from service.platform.db.session import Database
from service.platform.http.problems import not_found

_PAIRED = _vertex, _frame, _detection = lasting_alias(Vertex), lasting_alias(VertexFrame), lasting_alias(Detection)

Place = Literal["marks", "tally", "pairs", "result", "calibration", "crops"]


class DisclosureKey(NamedTuple):
    """The subject of others' answers: a corner of the board in a frame, and in the sweep paired with it."""

    frame_index: int
    sweep_index: int
    corner: str


def is_told(person_id: Any, sensor_id: Any, frame_index: Any, corner: Any) -> ColumnElement[bool]:
    """Whether something of others' answers on a corner in a frame was told to the person. Every writer asks this.

    Told of the frame itself, or of a sweep that any detection pairs with it: a verdict on the sweep is for all
    cameras.
    """
    own = and_(Disclosure.person_id == person_id, Disclosure.corner == corner)
    of_frame = exists().where(own, Disclosure.sensor_id == sensor_id, Disclosure.frame_index == frame_index)
    of_sweep = exists().where(
        *(_frame.sensor_id == sensor_id, _frame.frame_index == frame_index, _vertex.id == _frame.vertex_id),
        *(_vertex.corner == corner, _detection.id == _vertex.detection_id, own),
        *(Disclosure.recording_id == _detection.recording_id, Disclosure.sweep_index == _vertex.sweep_index),
    )
    return or_(of_frame.correlate_except(Disclosure), of_sweep.correlate_except(*_PAIRED, Disclosure))


def answered_by_others(session: Session, detection_id: UUID, sensor_id: UUID, person_id: UUID) -> set[DisclosureKey]:
    """Return the keys of a detection's corners that somebody else has answered in a camera."""
    columns = (VertexFrame.frame_index, Vertex.sweep_index, Vertex.corner)
    statement = answers_of(detection_id, sensor_id, *columns).where(VERDICT.person_id != person_id)
    return {DisclosureKey(*row) for row in session.execute(statement.distinct())}


def keys_of(session: Session, sensor_id: UUID, vertices: Sequence[UUID]) -> set[DisclosureKey]:
    """Return the keys of the answers on these vertices in a camera."""
    columns = (VertexFrame.frame_index, Vertex.sweep_index, Vertex.corner)
    paired = select(*columns).join(Vertex, Vertex.id == VertexFrame.vertex_id)
    rows = session.execute(paired.where(VertexFrame.sensor_id == sensor_id, Vertex.id.in_(vertices)))
    return {DisclosureKey(*row) for row in rows}


def record_disclosures(
    session: Session, person_id: UUID, camera: Sensor, keys: Iterable[DisclosureKey], told_in: Place
) -> None:
    """Record disclosures in a session that writes. Earlier disclosures stay as they are."""
    # Under the person's lock nobody inserts the same rows between the look and the insert.
    lock_person(session, person_id)
    if session.get(Recording, camera.recording_id, with_for_update={"read": True, "key_share": True}) is None:
        raise not_found()
    common = {"recording_id": camera.recording_id, "person_id": person_id, "sensor_id": camera.id}
    common |= {"told_in": told_in, "told_at": utc_now()}
    news = sorted(_news(session, person_id, camera.id, keys))
    if news:
        session.execute(insert(Disclosure), [common | key._asdict() for key in news])


def disclose(
    access: Access, database: Database, camera: Sensor, keys: Iterable[DisclosureKey], told_in: Place
) -> None:
    """Record disclosures of a request that reads; call it after reading, before the answer is sent."""
    keys = set(keys)
    if not _news(access.session, access.person.id, camera.id, keys):
        return
    # Its connection goes back first: a request that held two could wait for others that do the same.
    access.session.close()
    with database.writing() as session:
        record_disclosures(session, access.person.id, camera, keys, told_in)


def disclose_pairs(access: Access, database: Database, pairs: CorrespondenceSet, told_in: Place) -> None:
    """Record the disclosures of pairs made of marks: every vertex of their detection in their camera."""
    if pairs.source != "annotations" or pairs.detection_id is None:
        return
    camera = access.session.scalar(
        select(Sensor).where(Sensor.recording_id == pairs.recording_id, Sensor.name == pairs.camera)
    )
    if camera is not None:
        whose = (access.session, pairs.detection_id, camera.id, access.person.id)
        # Pairs keep what was taken back since.
        disclose(access, database, camera, answered_by_others(*whose) | _ever_answered(*whose), told_in)


def may_see_pairs(access: Access, pairs: CorrespondenceSet) -> bool:
    """Whether the person may see single pairs: of those made of marks only reviewers, to whom they are disclosed."""
    return pairs.source == "import" or access.sees_answers(pairs.fleet_id)


def _ever_answered(session: Session, detection_id: UUID, sensor_id: UUID, person_id: UUID) -> set[DisclosureKey]:
    rows = session.execute(
        select(Answer.frame_index, Vertex.sweep_index, Vertex.corner)
        .join(Vertex, Vertex.apex_id == Answer.apex_id)
        .where(Vertex.detection_id == detection_id, Answer.sensor_id == sensor_id, Answer.person_id != person_id)
    )
    return {DisclosureKey(*row) for row in rows}


def _news(session: Session, person_id: UUID, sensor_id: UUID, keys: Iterable[DisclosureKey]) -> set[DisclosureKey]:
    disclosed = select(Disclosure.frame_index, Disclosure.sweep_index, Disclosure.corner).where(
        Disclosure.person_id == person_id, Disclosure.sensor_id == sensor_id
    )
    return set(keys) - {DisclosureKey(*row) for row in session.execute(disclosed)}
