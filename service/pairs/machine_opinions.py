"""The machine as one annotator: its marks beside the people's."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple
from uuid import UUID

from sqlalchemy.orm import Session

from apexcal.documents.crops import side_of
from service.annotations.consensus import MACHINE, MachineShare, Opinion
from service.crops.queries import Judgements, judgements, marks_of, mean_sigma_px, newest_marks
from service.crops.trust import ShiftCount, widened_px
from service.platform.db.recordings import Sensor


class MachineOpinion(NamedTuple):
    """The machine's opinion of a vertex; ``sigma_px`` is the deviation of a coordinate.

    ``confirmations``: how many people confirmed its mark after they saw it. They add no mark.
    """

    opinion: Opinion
    sigma_px: float
    confirmations: int


def machine_opinions(
    session: Session, detection_id: UUID, camera: Sensor, opinions: Mapping[UUID, Sequence[Opinion]]
) -> dict[UUID, MachineOpinion]:
    """The machine's marks by vertex: those that people confirmed, and of the newest others but the rejected.

    ``opinions``: of :func:`opinions_of`, which have the confirmed ones. Empty where the machine was not asked, or
    marked nothing. To the pairs the machine is a person of its own, whose marks are all off by one shift.
    """
    newest = newest_marks(session, detection_id, camera.name)
    marks: dict[UUID, MachineOpinion] = {}
    if newest is not None:
        judged = judgements(session, camera.id, newest.id)
        for mark in marks_of(newest):
            vertex_id = UUID(mark["vertex_id"])
            if mark["reason"] is None and not judged.is_rejected(vertex_id):
                share = MachineShare(mean_sigma_px(mark), side_of(mark["edge_px"]))
                opinion = Opinion("confirmed", (mark["u"], mark["v"]), person=MACHINE, machine=share)
                marks[vertex_id] = MachineOpinion(opinion, share.sigma_px, 0)
    of_camera = judgements(session, camera.id)
    for vertex_id, of_vertex in opinions.items():
        for opinion in of_vertex:
            if opinion.machine:
                marks[vertex_id] = _confirmed(opinion, opinion.machine, of_vertex, of_camera)
    return marks


def _confirmed(
    opinion: Opinion, share: MachineShare, of_vertex: Sequence[Opinion], judged: Judgements
) -> MachineOpinion:
    people = sorted(
        each.person for each in of_vertex if each.person and each.verdict == "confirmed" and not each.mark
    )
    rates = [judged.counts.get(person, ShiftCount()).miss_rate for person in people]
    return MachineOpinion(opinion, widened_px(*share, judged.wrong_rate, rates), len(people))
