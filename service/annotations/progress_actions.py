"""Progress of the marking as counters: an answer by hand changes them, and nobody counts all vertices again.

Whatever else changes the vertices that are to be marked deletes the rows: the next look counts anew.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any
from uuid import UUID

from sqlalchemy import Select, Uuid, and_, bindparam, case, delete, func, insert, select
from sqlalchemy.orm import Session

from apexcal.documents.marking import Progress
from apexcal.documents.states import WorkState
from service.annotations.answer_queries import (
    MARK,
    VERDICT,
    answers_of,
    answers_of_others,
    has_answered,
    has_machine_mark,
)
from service.platform.auth.access import Access
from service.platform.db.annotations import MarkingProgress
from service.platform.db.base import lasting_alias
from service.platform.db.detections import Detection, Vertex, VertexFrame, marked_corners
from service.platform.db.recordings import Recording, Sensor
from service.platform.db.session import Database, upserting

_vertex, _frame = lasting_alias(Vertex), lasting_alias(VertexFrame)
_COUNTERS = ("answered", "complete", "mine")
_WANTED = (
    select(Recording.marks_per_vertex)
    .join(Detection, Detection.recording_id == Recording.id)
    .where(Detection.id == bindparam("detection"))
)


@contextmanager
def counted(
    session: Session,
    person_id: UUID,
    sensor_id: UUID,
    frame_index: int,
    corner: str,
    apex_id: UUID | None,
    *,
    is_first: bool = False,
) -> Iterator[None]:
    """Count what the block changes of a person's mark in a frame and of their verdict on an apex.

    The caller holds the person's lock, and nobody else answers on the apex meanwhile. The block writes a row that
    refers to the recording, so that nobody counts anew before the counters are changed, too. ``is_first``: there is
    neither a mark nor a verdict yet.
    """
    whose = (session, person_id, sensor_id, frame_index, corner, apex_id)
    rows = [] if is_first else _touched(*whose)
    before = {row[:2] for row in rows if row.answered}
    confirmed = {row[:2] for row in rows if row.confirmed}
    yield
    changes: dict[tuple[UUID, UUID], Counter[str]] = {}
    for row in _touched(*whose):
        sign = row.answered - (row[:2] in before)
        of_machine = row.confirmed or row[:2] in confirmed
        if not (sign or of_machine) or row.corner not in marked_corners(row):
            continue
        key = (row.detection_id, row.sensor_id)
        if of_machine or row.apex_id != apex_id:
            # Others may be answering on that apex, so their number is not known. Nor is `by_machine`.
            session.execute(delete(MarkingProgress).where(_of(*key)))
            continue
        change = changes.setdefault(key, Counter(dict.fromkeys(_COUNTERS, 0)))
        change["mine"] += sign
        change["answered"] += sign * (row.others == 0)
        change["complete"] += sign * (row.others == row.marks_per_vertex - 1)
    if changes:
        rows = [
            {"detection_id": detection, "sensor_id": sensor, "person_id": person_id, **change}
            for (detection, sensor), change in sorted(changes.items())
        ]
        session.connection().execute(_changing(session.get_bind().dialect.name), rows)


def read_progress(access: Access, database: Database, detection: Detection, camera: Sensor) -> Progress:
    """Progress of the marking in one camera, as the asker sees it."""
    session, person_id = access.session, access.person.id
    standing = progress_of(session, person_id, detection.id, camera.id)
    if standing is not None:
        return standing
    wanted_now = session.scalars(_WANTED, {"detection": detection.id}).one()
    if detection.state != WorkState.DONE:
        return _progress(*_count(session, detection, camera, person_id, wanted_now)[0])
    # Its connection goes back first: a request that held two could wait for others that do the same.
    session.close()
    with database.writing() as writing:
        # With the recording's lock no answer is under way, because each refers to it. Without, the count is not kept.
        recording = select(Recording.id).where(Recording.id == detection.recording_id)
        is_alone = writing.scalar(recording.with_for_update(skip_locked=True)) is not None
        counts, people = _count(writing, detection, camera, person_id, wanted_now)
        if not is_alone:
            return _progress(*counts)
        counters = (*counts[:4], counts[5])
        writing.execute(delete(MarkingProgress).where(_of(detection.id, camera.id)))
        own, names = (detection.id, camera.id), [column.key for column in MarkingProgress.__table__.columns]
        people.setdefault(person_id, 0)
        # The counters of all stand in the asker's row.
        rows = [
            (*own, person, *(counters if person == person_id else (None, None, None, 0, 0)), mine)
            for person, mine in people.items()
        ]
        writing.execute(insert(MarkingProgress), [dict(zip(names, row, strict=True)) for row in rows])
    return _progress(*counts)


def count_progress(session: Session, person_id: UUID, detection: Detection, camera: Sensor) -> Progress:
    """Progress by the counters, or counted anew without keeping that."""
    standing = progress_of(session, person_id, detection.id, camera.id)
    if standing is not None:
        return standing
    wanted_now = session.scalars(_WANTED, {"detection": detection.id}).one()
    return _progress(*_count(session, detection, camera, person_id, wanted_now)[0])


def progress_of(session: Session, person_id: UUID, detection_id: UUID, sensor_id: UUID) -> Progress | None:
    """Progress as the counters tell it to a person; None where all has to be counted again."""
    names = {"detection": detection_id, "sensor": sensor_id, "person": person_id}
    *sums, count = session.connection().execute(_sums(), names).one()
    return _progress(*sums) if sums[0] is not None and sums[1] == count else None


@cache
def _sums() -> Select[*tuple[Any, ...]]:
    """The counters' sums with a person's own, and how many marks of each vertex are wanted now."""
    row, total = MarkingProgress, func.sum
    mine = total(case((row.person_id == bindparam("person"), row.mine), else_=0))
    stated = (total(row.vertices), total(row.marks_wanted), total(row.by_machine))
    sums = (*stated, total(row.answered), mine, total(row.complete))
    return select(*sums, _WANTED.scalar_subquery()).where(_of(bindparam("detection"), bindparam("sensor")))


def _progress(vertices: int, marks_wanted: int, by_machine: int, answered: int, mine: int, complete: int) -> Progress:
    counts = {"answered": answered, "by_machine": by_machine, "mine": mine, "complete": complete}
    return Progress(vertices=vertices, marks_wanted=marks_wanted, **counts)


def _of(detection_id: Any, sensor_id: Any) -> Any:
    return (MarkingProgress.detection_id == detection_id) & (MarkingProgress.sensor_id == sensor_id)


def _touched(
    session: Session, person_id: UUID, sensor_id: UUID, frame_index: int, corner: str, apex_id: UUID | None
) -> list[Any]:
    """Vertices with frames, of all detections, that the mark or the verdict is of; who has answered them."""
    names = {"person": person_id, "sensor": sensor_id, "frame": frame_index, "corner": corner, "apex": apex_id}
    return list(session.connection().execute(_touched_statement(), names))


@cache
def _touched_statement() -> Select[*tuple[Any, ...]]:
    person, corner = bindparam("person", type_=Uuid()), bindparam("corner")
    of_frame = (
        select(_vertex.id)
        .join(_frame, _frame.vertex_id == _vertex.id)
        .where(_frame.sensor_id == bindparam("sensor"), _frame.frame_index == bindparam("frame"))
        .where(_vertex.corner == corner)
    )
    of_apex = select(_vertex.id).where(_vertex.apex_id == bindparam("apex"))
    return (
        select(
            *(Vertex.id, VertexFrame.sensor_id, Vertex.detection_id, Vertex.apex_id, Vertex.corner),
            *(Recording.marks_per_vertex, Detection.marked_corners),
            has_answered(person).label("answered"),
            has_machine_mark().label("confirmed"),
            answers_of_others(person).label("others"),
        )
        .join(VertexFrame, VertexFrame.vertex_id == Vertex.id)
        .join(Detection, Detection.id == Vertex.detection_id)
        .join(Recording, Recording.id == Detection.recording_id)
        .where(Vertex.id.in_(of_frame.union_all(of_apex)))
    )


@cache
def _changing(dialect: str) -> Any:
    upsert = upserting(dialect, MarkingProgress.__table__)
    more = {name: getattr(MarkingProgress, name) + getattr(upsert.excluded, name) for name in _COUNTERS}
    return upsert.on_conflict_do_update(index_elements=["detection_id", "sensor_id", "person_id"], set_=more)


def _count(
    session: Session, detection: Detection, camera: Sensor, person_id: UUID, per_vertex: int
) -> tuple[tuple[int, int, int, int, int, int], Counter[UUID]]:
    """The progress (`_progress`) of all rows, and the answers of each person."""
    is_asked = Vertex.corner.in_(marked_corners(detection))
    vertices = session.scalar(
        select(func.count())
        .select_from(Vertex)
        .join(VertexFrame, VertexFrame.vertex_id == Vertex.id)
        .where(Vertex.detection_id == detection.id, VertexFrame.sensor_id == camera.id, is_asked)
    )
    by_machine = and_(VERDICT.verdict == "confirmed", MARK.machine_sigma_px.is_not(None))
    columns = (Vertex.id, VERDICT.person_id, case((by_machine, 1), else_=0))
    rows = session.execute(answers_of(detection.id, camera.id, *columns).where(is_asked)).all()
    of_vertex, people = Counter(row[0] for row in rows), Counter(row[1] for row in rows)
    complete = sum(count >= per_vertex for count in of_vertex.values())
    confirmed = len(of_vertex) - len({row[0] for row in rows if not row[2]})
    return (vertices or 0, per_vertex, confirmed, len(of_vertex), people[person_id], complete), people
