"""The machine as one annotator: its marks beside the people's."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple
from uuid import UUID

from sqlalchemy.orm import Session

from apexcal.documents.crops import side_of
from service.annotations.consensus import Opinion
from service.crops.queries import judgements, marks_of, newest_marks
from service.crops.trust import widened_px


class MachineOpinion(NamedTuple):
    """The machine's opinion of a vertex; ``sigma_px`` is the deviation of a coordinate.

    ``confirmations`` are the opinions of people who confirmed its mark after they saw it. They add no mark.
    ``is_counted``: the pairs rest on it. Else it only shows how far the machine is from people's blind marks.
    """

    opinion: Opinion
    sigma_px: float
    confirmations: Sequence[Opinion]
    is_counted: bool


def machine_opinions(
    session: Session, detection_id: UUID, camera: str, *, unconfirmed: bool
) -> dict[UUID, MachineOpinion]:
    """The newest marks of the machine by vertex, without those that people rejected.

    ``unconfirmed``: those that nobody confirmed count too. Empty where the machine was not asked, or marked nothing.
    To the pairs the machine is a person of its own, whose marks are all off by one shift.
    """
    newest = newest_marks(session, detection_id, camera)
    if newest is None:
        return {}
    judged = judgements(session, newest.id)
    opinions: dict[UUID, MachineOpinion] = {}
    for mark in marks_of(newest):
        vertex_id = UUID(mark["vertex_id"])
        is_confirmed = judged.is_confirmed(vertex_id)
        if mark["reason"] is not None or judged.is_rejected(vertex_id):
            continue
        sigma_px = (0.5 * (mark["sigma_u"] ** 2 + mark["sigma_v"] ** 2)) ** 0.5
        people = sorted(judged.confirmed_by[vertex_id]) if is_confirmed else []
        if people:
            rates = [judged.counts[person].miss_rate for person in people]
            sigma_px = widened_px(sigma_px, side_of(mark["edge_px"]), judged.wrong_rate, rates)
        opinions[vertex_id] = MachineOpinion(
            Opinion("confirmed", (mark["u"], mark["v"]), person=newest.id),
            sigma_px,
            [Opinion("confirmed", reviewed=True, person=person) for person in people],
            unconfirmed or is_confirmed,
        )
    return opinions
