"""Which vertex is open to a person. The search starts where the last one was found."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any
from uuid import UUID

from sqlalchemy import ColumnElement, Select, and_, exists, func, select
from sqlalchemy.orm import Session

from service.annotations.answer_queries import has_answered, leases_of_others, taken_by_others
from service.db.annotations import MarkingFrontier, MarkingTask
from service.db.clock import now
from service.db.detections import Vertex, VertexFrame

# A rank beyond all: a detection has far fewer vertices.
_END = 2**30
# The next open vertex is mostly within so many ranks; stretches that others have answered may be longer.
_NEAR = 200
# How often all vertices are looked at for a person for whom nothing is left. 100,000 take half a second.
_LOOK_S = 60.0


@dataclass(frozen=True)
class Seeker:
    """A person who marks the vertices of a detection in one camera, under the lock of its recording."""

    session: Session
    recording_id: UUID
    detection_id: UUID
    camera_id: UUID
    person_id: UUID
    marks_wanted: int
    corners: Sequence[str]
    # Tasks of theirs that they hold, or have just given back.
    passed: Sequence[UUID]

    def seek(self) -> UUID | None:
        """The open vertex of the lowest rank that is new to the person, else the open one that they saw longest ago.

        The first search looks at all vertices. So does one that finds nothing, but not again for a minute.
        """
        leases = leases_of_others(self.session, self.camera_id, self.person_id)
        frontier = self._frontier()
        if frontier is not None:
            found = self._new(frontier, leases) or self._seen(leases, MarkingTask.answered_at.is_(None))
            if found is not None or self._was_nothing_lately():
                return found
        frontier = self._no_frontier()
        found = self._new(frontier, leases) or self._seen(leases)
        if found is None:
            frontier.nothing_at = now()  # pyright: ignore[reportAttributeAccessIssue] - the database's own clock
            self.session.flush()
        return found

    @property
    def _key(self) -> tuple[UUID, UUID, UUID]:
        return self.detection_id, self.camera_id, self.person_id

    def _frontier(self) -> MarkingFrontier | None:
        found = self.session.get(MarkingFrontier, self._key, populate_existing=True)
        return found if found is not None and found.marks_wanted == self.marks_wanted else None

    def _no_frontier(self) -> MarkingFrontier:
        """A frontier before all vertices."""
        detection_id, camera_id, person_id = self._key
        return self.session.merge(
            MarkingFrontier(
                detection_id=detection_id,
                sensor_id=camera_id,
                person_id=person_id,
                recording_id=self.recording_id,
                marks_wanted=self.marks_wanted,
                rank=0,
                nothing_at=None,
            )
        )

    def _was_nothing_lately(self) -> bool:
        recent = select(MarkingFrontier.nothing_at > now(-_LOOK_S)).where(
            MarkingFrontier.detection_id == self.detection_id,
            MarkingFrontier.sensor_id == self.camera_id,
            MarkingFrontier.person_id == self.person_id,
        )
        return bool(self.session.scalar(recent))

    def _new(self, frontier: MarkingFrontier, leases: Mapping[UUID, int]) -> UUID | None:
        """The first open vertex from the frontier on that the person had no task for; the frontier moves there."""
        first = frontier.rank
        had = exists().where(
            MarkingTask.vertex_id == Vertex.id,
            MarkingTask.sensor_id == self.camera_id,
            MarkingTask.person_id == self.person_id,
        )
        # The corners of a sweep have its rank, so they come one after the other: top, right, left, bottom.
        new = self._open(leases).where(~had).order_by(Vertex.rank, Vertex.corner.desc()).limit(1)
        # The next ones first: the database knows that they are few, and looks each up.
        near = new.where(Vertex.rank >= first, Vertex.rank < first + _NEAR)
        far = new.where(Vertex.rank >= first + _NEAR)
        found = self.session.execute(near).first() or self.session.execute(far).first()
        # Not past a vertex that somebody else holds: they may give it back.
        frontier.rank = min(found.rank if found else _END, self._first_leased(leases, first))
        self.session.flush()
        return found.id if found else None

    def _seen(self, leases: Mapping[UUID, int], *which: ColumnElement[bool]) -> UUID | None:
        """The open vertex whose task the person had longest ago."""
        own = and_(
            MarkingTask.vertex_id == Vertex.id,
            MarkingTask.sensor_id == self.camera_id,
            MarkingTask.person_id == self.person_id,
        )
        seen = self._open(leases).join(MarkingTask, own).where(*which)
        if self.passed:
            seen = seen.where(MarkingTask.id.not_in(self.passed))
        found = self.session.execute(
            seen.order_by(MarkingTask.leased_until, Vertex.rank, Vertex.corner.desc()).limit(1)
        ).first()
        return found.id if found else None

    def _open(self, leases: Mapping[UUID, int]) -> Select[Any, Any]:
        """Id and rank of the vertices with a frame of the camera that take an answer of this person."""
        return (
            select(Vertex.id, Vertex.rank)
            .select_from(Vertex)
            .join(VertexFrame, and_(VertexFrame.vertex_id == Vertex.id, VertexFrame.sensor_id == self.camera_id))
            .where(
                Vertex.detection_id == self.detection_id,
                Vertex.corner.in_(self.corners),
                ~has_answered(self.person_id),
                taken_by_others(self.person_id, leases) < self.marks_wanted,
            )
        )

    def _first_leased(self, leases: Mapping[UUID, int], rank: int) -> int:
        """The lowest rank from ``rank`` on of what others hold."""
        if not leases:
            return _END
        held = select(func.min(Vertex.rank)).where(
            Vertex.detection_id == self.detection_id, Vertex.apex_id.in_(leases), Vertex.rank >= rank
        )
        lowest = self.session.scalar(held)
        return _END if lowest is None else lowest
