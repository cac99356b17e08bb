"""Find vertices that are open to a person. The search starts where the last one ended."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any
from uuid import UUID

from sqlalchemy import ColumnElement, Integer, Select, Uuid, and_, bindparam, func, select
from sqlalchemy.orm import Session

from service.annotations.answer_queries import answers_closing, is_live, leases_of_others
from service.platform.db.annotations import MarkingFrontier, MarkingTask
from service.platform.db.base import Json
from service.platform.db.detections import Apex, Vertex, VertexFrame
from service.platform.db.session import put

# The frontier is written after it has moved this far; until then each search passes the vertices in between again.
_STEP = 30
# The next open vertex is mostly this near to the frontier. 100 people holding 3 vertices each occupy 100 vertices at
# 3 marks per vertex; between two of a person's answers they finish 33. Runs of vertices that
# others have answered may be longer.
_NEAR = 200

_CAMERA, _PERSON = bindparam("camera", type_=Uuid()), bindparam("person", type_=Uuid())
_WANTED = bindparam("wanted", type_=Integer())
_LEASE = leases_of_others(_CAMERA, _PERSON)


@dataclass(frozen=True)
class OpenVertexSearch:
    """A search for a detection's open vertices in one camera, for one person, under that person's lock.

    ``names``: ``detection``, ``camera``, ``person``, ``corners``, and ``wanted``, the number of marks for each
    vertex. ``passed``: vertices left out: the person holds or gets them anyway, or has just given them back.
    """

    session: Session
    recording_id: UUID
    names: Json
    passed: Sequence[UUID]

    def take(self, count: int) -> list[UUID]:
        """Return at most ``count`` open vertices that nobody else can lease until the transaction ends.

        People who ask at the same moment lock different apexes, check again that their vertices are open, and search
        for more in place of the others. If others hold all open vertices, it waits: these may be the last ones.
        """
        taken: list[UUID] = []
        tried: list[UUID] = [*self.passed]
        for wait in (False, True):
            while len(taken) < count and (sought := self._lock(count - len(taken), tried, wait=wait)):
                tried += sought
                open_now = set(self.session.connection().scalars(_still_open(), self.names | {"sought": sought}))
                taken += [vertex_id for vertex_id in sought if vertex_id in open_now]
            if taken:
                break
        return taken

    def half_share(self, most: int) -> int:
        """Return half of the person's share of the answers that open vertices still need, ``most`` at most."""
        connection = self.session.connection()
        people = 1 + (connection.scalar(_others(), self.names) or 0)
        per_vertex = self.names["wanted"]
        names = self.names | {"count": 2 * people * most}
        count = int(connection.scalar(_open_count(), names) or 0)
        return min(count * per_vertex // (2 * people), count // 2)

    def _lock(self, count: int, tried: Collection[UUID], *, wait: bool) -> list[UUID]:
        """Lock the apexes of open vertices: of those new to the person by rank, then of those seen longest ago."""
        rows: list[Any] = []
        for is_near in (True, False):
            if len(rows) < count:
                names = self.names | {"tried": [*tried], "count": count - len(rows)}
                rows += self.session.connection().execute(_new(is_near=is_near, wait=wait), names)
        # Some in between are leased, the others closed by answers.
        if rows and rows[0].rank - rows[0].frontier - rows[0].leased >= _STEP:
            self._advance(rows[0].frontier, rows[0].rank)
        if len(rows) < count:
            names = self.names | {"tried": [*tried], "count": count - len(rows)}
            rows += self.session.connection().execute(_seen(wait=wait), names)
        return [row.id for row in rows]

    def _advance(self, before: int, open_rank: int) -> None:
        """Move the frontier up to the first vertex that answers have not closed to the person, if that is far."""
        rank = self.session.connection().scalar(_first_not_closed(), self.names | {"open": open_rank})
        if rank is not None and rank - before >= _STEP:
            names = self.names
            key = {"detection_id": names["detection"], "sensor_id": names["camera"], "person_id": names["person"]}
            row = {"recording_id": self.recording_id, "marks_wanted": names["wanted"], "rank": rank}
            put(self.session, MarkingFrontier, key, row)


def _is_own() -> ColumnElement[bool]:
    """Whether a task is the person's, of the enclosing query's ``Vertex`` in the camera."""
    is_of = and_(MarkingTask.vertex_id == Vertex.id, MarkingTask.sensor_id == _CAMERA)
    return and_(is_of, MarkingTask.person_id == _PERSON)


def _had_no_task() -> ColumnElement[bool]:
    # PostgreSQL makes a join of NOT EXISTS, over all tasks of the person; this it looks up vertex by vertex.
    return select(func.count()).where(_is_own()).correlate(Vertex).scalar_subquery() == 0


def _frontier() -> ColumnElement[int]:
    """The rank from which on a vertex may be new to the person; 0 where it is not known."""
    of_detection = MarkingFrontier.detection_id == bindparam("detection")
    key = (of_detection, MarkingFrontier.sensor_id == _CAMERA, MarkingFrontier.person_id == _PERSON)
    holds = MarkingFrontier.marks_wanted == _WANTED
    return func.coalesce(select(MarkingFrontier.rank).where(*key, holds).scalar_subquery(), 0)


@cache
def _new(*, is_near: bool, wait: bool) -> Select[Any, Any, Any]:
    """Open vertices that the person had no task for, from the frontier on or farther, with locks on their apexes."""
    begin = _frontier()
    ranks = (Vertex.rank >= begin, Vertex.rank < begin + _NEAR) if is_near else (Vertex.rank >= begin + _NEAR,)
    # The corners of a sweep have its rank, so they come one after the other: top, right, left, bottom.
    new = _open().where(_had_no_task(), *ranks).order_by(Vertex.rank, Vertex.corner.desc())
    leased = select(func.count()).select_from(_LEASE).scalar_subquery()
    return _locking(new.add_columns(begin.label("frontier"), leased.label("leased")), wait=wait)


@cache
def _seen(*, wait: bool) -> Select[Any, Any]:
    """Open vertices whose tasks the person had longest ago and did not answer, with locks on their apexes."""
    statement = _open().join(MarkingTask, _is_own()).where(MarkingTask.answered_at.is_(None))
    return _locking(statement.order_by(MarkingTask.leased_until, Vertex.rank, Vertex.corner.desc()), wait=wait)


def _locking(rows: Any, *, wait: bool) -> Any:
    rows = rows.where(Vertex.id.not_in(bindparam("tried", expanding=True)))
    # For a LIMIT that is a parameter PostgreSQL expects a tenth of all rows, and sorts them first.
    rows = rows.limit(bindparam("count", type_=Integer(), literal_execute=True))
    return rows.join(Apex, Apex.id == Vertex.apex_id).with_for_update(key_share=True, of=Apex, skip_locked=not wait)


@cache
def _still_open() -> Select[Any, Any]:
    return _open().where(Vertex.id.in_(bindparam("sought", expanding=True)))


@cache
def _open() -> Select[Any, Any]:
    """Id and rank of the vertices that take an answer of this person, and that others do not hold."""
    rows = _paired(Vertex.id, Vertex.rank).outerjoin(_LEASE, _LEASE.c.apex_id == Vertex.apex_id)
    return rows.where(answers_closing(_PERSON, _WANTED) + func.coalesce(_LEASE.c.people, 0) < _WANTED)


@cache
def _others() -> Select[int]:
    """Count the other people who hold leases on vertices of the detection in the camera."""
    of = (MarkingTask.detection_id == bindparam("detection"), MarkingTask.sensor_id == _CAMERA)
    people = select(func.count(MarkingTask.person_id.distinct())).where(*of, MarkingTask.person_id != _PERSON)
    return people.where(is_live(MarkingTask))


@cache
def _open_count() -> Select[int]:
    few = _open().with_only_columns(Vertex.id).limit(bindparam("count", type_=Integer()))
    return select(func.count()).select_from(few.subquery())


@cache
def _first_not_closed() -> Select[int]:
    rows = _paired(Vertex.rank).where(_had_no_task(), answers_closing(_PERSON, _WANTED) < _WANTED)
    ranks = (Vertex.rank >= _frontier(), Vertex.rank <= bindparam("open"))
    return rows.where(*ranks).order_by(Vertex.rank).limit(1)


def _paired(*columns: Any) -> Select[*tuple[Any, ...]]:
    """Select vertices that are to be marked in the camera."""
    is_paired = and_(VertexFrame.vertex_id == Vertex.id, VertexFrame.sensor_id == _CAMERA)
    rows = select(*columns).select_from(Vertex).join(VertexFrame, is_paired)
    return rows.where(
        Vertex.detection_id == bindparam("detection"), Vertex.corner.in_(bindparam("corners", expanding=True))
    )
