"""The machine as one annotator: its marks beside the people's."""

from __future__ import annotations

from typing import NamedTuple
from uuid import UUID

from sqlalchemy import select
from sqlalchemy.orm import Session

from service.annotations.consensus import Opinion
from service.platform.db.analyses import Analysis
from service.platform.db.base import Json


class MachineOpinion(NamedTuple):
    """The machine's opinion of a vertex; ``sigma_px`` is the deviation of a coordinate."""

    opinion: Opinion
    sigma_px: float


def machine_opinions(session: Session, detection_id: UUID, camera: str) -> dict[UUID, MachineOpinion]:
    """The newest marks of the machine by vertex; empty where it was not asked, or marked nothing.

    To the pairs the machine is a person of its own, whose marks are all off by one shift.
    """
    answered = select(Analysis).where(
        Analysis.detection_id == detection_id, Analysis.kind == "machine_marks", Analysis.result.is_not(None)
    )
    rows = session.scalars(answered.order_by(Analysis.created_at.desc(), Analysis.id.desc()))
    newest = next((row for row in rows if row.asked["camera"] == camera), None)
    if newest is None:
        return {}
    return {
        UUID(mark["vertex_id"]): MachineOpinion(
            Opinion("confirmed", (mark["u"], mark["v"]), person=newest.id),
            (0.5 * (mark["sigma_u"] ** 2 + mark["sigma_v"] ** 2)) ** 0.5,
        )
        for mark in marks_of(newest)
        if mark["reason"] is None
    }


def marks_of(analysis: Analysis) -> list[Json]:
    """All that an analysis says of vertices, marks and reasons; empty until it is done."""
    columns: Json = (analysis.result or {}).get("marks", {})
    return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
