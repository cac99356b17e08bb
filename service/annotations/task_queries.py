"""Which vertex is open to a person. The search starts where the last one was found."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any
from uuid import UUID

from sqlalchemy import ColumnElement, Integer, Select, Uuid, and_, bindparam, exists, func, select
from sqlalchemy.orm import Session

from service.annotations.answer_queries import answers_of_others, has_answered, leases_of_others
from service.db.annotations import MarkingFrontier, MarkingTask
from service.db.clock import now
from service.db.detections import Apex, Vertex, VertexFrame

# A rank beyond all: a detection has far fewer vertices.
_END = 2**30
# The next open vertex is mostly within so many ranks; stretches that others have answered may be longer.
_NEAR = 200
# How often all vertices are looked at for a person for whom nothing is left. 100,000 take half a second.
_LOOK_S = 60.0


_CAMERA, _PERSON = bindparam("camera", type_=Uuid()), bindparam("person", type_=Uuid())


@dataclass(frozen=True)
class Seeker:
    """A person who marks the vertices of a detection in one camera, under their own lock."""

    session: Session
    recording_id: UUID
    detection_id: UUID
    camera_id: UUID
    person_id: UUID
    marks_wanted: int
    corners: Sequence[str]
    # Tasks of theirs that they hold, or have just given back.
    passed: Sequence[UUID]

    def take(self, count: int) -> list[UUID]:
        """Open vertices, ``count`` at most, that nobody else can lease until the transaction ends.

        People who ask at the same moment find the same vertices. Each locks the apexes that nobody has locked, looks
        again whether their vertices are open, and seeks others in place of the rest.
        """
        taken: list[UUID] = []
        tried: dict[UUID, int] = {}
        while len(taken) < count and (sought := self._seek(count - len(taken), tried)):
            tried |= sought
            taken += self._claim([*sought], wait=False)
        if tried and not taken:  # all are being leased or answered by others, who may be the last ones
            taken = self._claim([*tried][:count], wait=True)
        missed = [rank for vertex_id, rank in tried.items() if vertex_id not in taken]
        frontier = self.session.get(MarkingFrontier, self._key) if missed else None
        if frontier is not None:
            frontier.rank = min(frontier.rank, *missed)
        return taken

    def _claim(self, vertices: Sequence[UUID], *, wait: bool) -> list[UUID]:
        """Those of the vertices whose apexes could be locked, and that are still open then."""
        locked = self.session.scalars(_locking(wait=wait), {"vertices": vertices}).all()
        still = _open().where(Vertex.id.in_(locked))
        open_now = set(self.session.scalars(still, self._names | {"tried": []})) if locked else set()
        return [one for one in vertices if one in open_now]

    def _seek(self, count: int, tried: Mapping[UUID, int]) -> dict[UUID, int]:
        """Open vertices with their ranks: those new to the person by rank, then those that they saw longest ago.

        The first search looks at all vertices. So does one that finds nothing, but not again for a minute.
        """
        frontier, was_nothing_lately = self._frontier()
        if frontier is not None:
            found = self._new(frontier, count, tried)
            if len(found) < count:
                found |= self._seen(count - len(found), tried, MarkingTask.answered_at.is_(None))
            if found or was_nothing_lately:
                return found
        frontier = self._no_frontier()
        found = self._new(frontier, count, tried)
        if len(found) < count:
            found |= self._seen(count - len(found), tried)
        if not found and not tried:
            frontier.nothing_at = now()  # pyright: ignore[reportAttributeAccessIssue] - the database's own clock
            self.session.flush()
        return found

    @property
    def _key(self) -> dict[str, UUID]:
        return {"detection_id": self.detection_id, "sensor_id": self.camera_id, "person_id": self.person_id}

    @property
    def _names(self) -> dict[str, Any]:
        names = {"camera": self.camera_id, "person": self.person_id, "detection": self.detection_id}
        return names | {"corners": self.corners, "wanted": self.marks_wanted}

    def _frontier(self) -> tuple[MarkingFrontier | None, bool]:
        """The frontier if it holds still, and whether the last look at all vertices, a moment ago, found nothing."""
        row = select(MarkingFrontier).filter_by(**self._key, marks_wanted=self.marks_wanted)
        row = row.add_columns(MarkingFrontier.nothing_at > now(-_LOOK_S))
        found = self.session.execute(row, execution_options={"populate_existing": True}).first()
        return (found[0], bool(found[1])) if found else (None, False)

    def _no_frontier(self) -> MarkingFrontier:
        """A frontier before all vertices."""
        own = {"recording_id": self.recording_id, "marks_wanted": self.marks_wanted, "rank": 0, "nothing_at": None}
        return self.session.merge(MarkingFrontier(**self._key, **own))

    def _new(self, frontier: MarkingFrontier, count: int, tried: Mapping[UUID, int]) -> dict[UUID, int]:
        """The first open vertices from the frontier on that the person had no task for; the frontier moves there."""
        first = frontier.rank
        # Not past a vertex that somebody else holds: they may give it back, even while this looks.
        held = self.session.scalar(_first_leased(), self._names | {"first": first})
        found: list[Any] = []
        # The next ones first: the database knows that they are few, and looks each up.
        for begin, end in ((first, first + _NEAR), (first + _NEAR, 2 * _END - 1)):
            if len(found) < count:
                part = {"first": begin, "end": end, "count": count - len(found), "tried": [*tried]}
                found += self.session.execute(_new(), self._names | part)
        held = _END if held is None else held
        frontier.rank = min(found[-1].rank if len(found) == count else _END, held)
        return {row.id: row.rank for row in found}

    def _seen(self, count: int, tried: Mapping[UUID, int], *which: ColumnElement[bool]) -> dict[UUID, int]:
        """The open vertices whose tasks the person had longest ago."""
        seen = _open().join(MarkingTask, _is_own()).where(*which)
        if self.passed:
            seen = seen.where(MarkingTask.id.not_in(self.passed))
        order = (MarkingTask.leased_until, Vertex.rank, Vertex.corner.desc())
        rows = self.session.execute(seen.order_by(*order).limit(count), self._names | {"tried": [*tried]})
        return {row.id: row.rank for row in rows}


def _is_own() -> ColumnElement[bool]:
    """Whether a task is the person's, of the enclosing query's ``Vertex`` in the camera."""
    is_of = and_(MarkingTask.vertex_id == Vertex.id, MarkingTask.sensor_id == _CAMERA)
    return and_(is_of, MarkingTask.person_id == _PERSON)


@cache
def _new() -> Select[Any, Any]:
    """Open vertices between two ranks that the person had no task for."""
    had = exists().where(_is_own())
    ranks = (Vertex.rank >= bindparam("first"), Vertex.rank < bindparam("end"))
    # The corners of a sweep have its rank, so they come one after the other: top, right, left, bottom.
    new = _open().where(~had, *ranks).order_by(Vertex.rank, Vertex.corner.desc())
    return new.limit(bindparam("count", type_=Integer()))


@cache
def _open() -> Select[Any, Any]:
    """Id and rank of the vertices with a frame of the camera that take an answer of this person."""
    lease = leases_of_others(_CAMERA, _PERSON)
    return (
        select(Vertex.id, Vertex.rank)
        .select_from(Vertex)
        .join(VertexFrame, and_(VertexFrame.vertex_id == Vertex.id, VertexFrame.sensor_id == _CAMERA))
        .outerjoin(lease, lease.c.apex_id == Vertex.apex_id)
        .where(
            Vertex.detection_id == bindparam("detection"),
            Vertex.corner.in_(bindparam("corners", expanding=True)),
            Vertex.id.not_in(bindparam("tried", expanding=True)),
            ~has_answered(_PERSON),
            answers_of_others(_PERSON) + func.coalesce(lease.c.people, 0) < bindparam("wanted", type_=Integer()),
        )
    )


@cache
def _locking(*, wait: bool) -> Select[UUID]:
    """Lock the apexes of vertices; without ``wait`` of those that nobody has locked."""
    rows = select(Vertex.id).join(Apex, Apex.id == Vertex.apex_id).order_by(Apex.id)
    rows = rows.where(Vertex.id.in_(bindparam("vertices", expanding=True)))
    return rows.with_for_update(key_share=True, of=Apex, skip_locked=not wait)


@cache
def _first_leased() -> Select[Any]:
    """The lowest rank from ``first`` on of what others hold."""
    lease = leases_of_others(_CAMERA, _PERSON)
    held = select(func.min(Vertex.rank)).join(lease, lease.c.apex_id == Vertex.apex_id)
    return held.where(Vertex.detection_id == bindparam("detection"), Vertex.rank >= bindparam("first"))
