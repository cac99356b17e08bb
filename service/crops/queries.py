"""The machine's marks of a camera, and what people said of them on pages of crops."""

from __future__ import annotations

import math
from collections import defaultdict
from dataclasses import dataclass
from uuid import UUID

from sqlalchemy import select
from sqlalchemy.orm import Session

from apexcal.documents.crops import (
    LEAST_MARKS,
    MOST_SHIFT_SHARE,
    CropProgress,
    ExpectedCorner,
    expected_pixel,
    side_of,
)
from apexcal.documents.machine_marks import MarkPlace
from service.annotations.consensus import Opinion
from service.annotations.tally_queries import opinions_of
from service.crops.shifts import MOST_MISSED
from service.crops.trust import ShiftCount, wrong_rate
from service.platform.db.analyses import Analysis
from service.platform.db.annotations import CropPage
from service.platform.db.base import Json
from service.platform.db.recordings import CameraFrame, Sensor

# Differences whose mean is known to 0.45 of one difference's deviation, 1 / sqrt(5).
LEAST_BLIND = 5
# Deviations that errors of two Gaussian coordinates exceed once in a thousand.
_ONCE_IN_A_THOUSAND = math.sqrt(-2.0 * math.log(1e-3))
# Nobody's marks are assumed to be better, pixels.
_LEAST_SIGMA_PX = 1.0


def newest_marks(session: Session, detection_id: UUID, camera: str) -> Analysis | None:
    """The last analysis that marked a detection's corners in a camera."""
    answered = select(Analysis.id, Analysis.asked).where(
        Analysis.detection_id == detection_id, Analysis.kind == "machine_marks", Analysis.result.is_not(None)
    )
    rows = session.execute(answered.order_by(Analysis.created_at.desc(), Analysis.id.desc()))
    newest = next((row.id for row in rows if row.asked["camera"] == camera), None)
    return session.get(Analysis, newest) if newest else None


def marks_of(analysis: Analysis) -> list[Json]:
    """Return an analysis's rows of vertices with their marks or reasons; empty until it is done."""
    columns: Json = (analysis.result or {}).get("marks", {})
    return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]


def shown_marks(session: Session, analysis: Analysis, camera: Sensor) -> dict[UUID, Json]:
    """The marks of an analysis that people can look at, by vertex: those inside of their frames."""
    frame = select(CameraFrame.width, CameraFrame.height).where(CameraFrame.sensor_id == camera.id).limit(1)
    width, height = next(iter(session.execute(frame)), (0, 0))
    return {
        UUID(mark["vertex_id"]): mark
        for mark in marks_of(analysis)
        if mark["reason"] is None and 0.0 <= mark["u"] < width and 0.0 <= mark["v"] < height
    }


def expected_corners(session: Session, detection_id: UUID, camera: str) -> list[ExpectedCorner]:
    """Return where to look for each vertex that the machine marked: its mark, moved at random, always alike.

    Of a vertex with two places both.
    """
    analysis = newest_marks(session, detection_id, camera)
    marks = [] if analysis is None else marks_of(analysis)
    return [_expected(mark) for mark in marks if not mark["reason"] or mark.get("places")]


def _expected(mark: Json) -> ExpectedCorner:
    side_px = side_of(mark["edge_px"])
    if mark["reason"]:
        first, second = (MarkPlace(**spot) for spot in mark["places"])
        within_px = 0.5 * (math.dist((first.u, first.v), (second.u, second.v)) + side_px)
        middle = {"u": 0.5 * (first.u + second.u), "v": 0.5 * (first.v + second.v)}
        return ExpectedCorner(vertex_id=mark["vertex_id"], **middle, within_px=within_px, places=[first, second])
    u, v = expected_pixel(mark)
    sigma_px = math.hypot(_LEAST_SIGMA_PX, max(mark["sigma_u"], mark["sigma_v"]))
    within_px = MOST_SHIFT_SHARE * side_px + _ONCE_IN_A_THOUSAND * sigma_px
    return ExpectedCorner(vertex_id=mark["vertex_id"], u=u, v=v, within_px=within_px)


def mean_sigma_px(mark: Json) -> float:
    """Deviation of a coordinate (px), the root mean square of both."""
    return (0.5 * (mark["sigma_u"] ** 2 + mark["sigma_v"] ** 2)) ** 0.5


@dataclass(frozen=True)
class PageOutcome:
    """The outcome of an answered page. Without ``accepted`` only the number of missed shifts counts."""

    confirmed: list[UUID]
    rejected: list[UUID]
    shifts: ShiftCount

    @property
    def accepted(self) -> bool:
        """Whether few enough shifted marks were missed."""
        return self.shifts.missed < MOST_MISSED


def outcome_of(page: CropPage) -> PageOutcome:
    """The outcome of an answered page."""
    wrong = set(page.wrong or ())
    own = [crop["vertex_id"] for crop in page.crops if not crop["shifted"]]
    shifted = [crop["vertex_id"] for crop in page.crops if crop["shifted"]]
    return PageOutcome(
        [UUID(vertex_id) for vertex_id in own if vertex_id not in wrong],
        [UUID(vertex_id) for vertex_id in own if vertex_id in wrong],
        ShiftCount(len(shifted), sum(vertex_id not in wrong for vertex_id in shifted)),
    )


@dataclass(frozen=True)
class Judgements:
    """Who confirmed and who rejected which vertex's mark, and the shifted marks that each person was shown."""

    confirmed_by: dict[UUID, set[UUID]]
    rejected_by: dict[UUID, set[UUID]]
    counts: dict[UUID, ShiftCount]

    def is_confirmed(self, vertex_id: UUID) -> bool:
        """Whether more people confirmed the mark than rejected it."""
        return len(self.confirmed_by.get(vertex_id, ())) > len(self.rejected_by.get(vertex_id, ()))

    def is_rejected(self, vertex_id: UUID) -> bool:
        """Whether people rejected the mark, and no more of them confirmed it."""
        return bool(self.rejected_by.get(vertex_id)) and not self.is_confirmed(vertex_id)

    @property
    def wrong_rate(self) -> float:
        """Probability that the machine's mark is wrong in this camera."""
        judged = {*self.confirmed_by, *self.rejected_by}
        return wrong_rate(sum(map(self.is_rejected, judged)), len(judged), self.counts.values())


def judgements(session: Session, camera_id: UUID, analysis_id: UUID | None = None) -> Judgements:
    """Return people's judgements on a camera's pages of crops, of all its marks or of one analysis's.

    Of two answers of a person the later one counts.
    """
    says: dict[UUID, dict[UUID, bool]] = defaultdict(dict)
    counts: defaultdict[UUID, ShiftCount] = defaultdict(ShiftCount)
    answered = select(CropPage).where(CropPage.sensor_id == camera_id, CropPage.answered_at.is_not(None))
    if analysis_id is not None:
        answered = answered.where(CropPage.analysis_id == analysis_id)
    for page in session.scalars(answered.order_by(CropPage.answered_at, CropPage.id)):
        outcome, before = outcome_of(page), counts[page.person_id]
        counts[page.person_id] = ShiftCount(
            before.shifted + outcome.shifts.shifted, before.missed + outcome.shifts.missed
        )
        if outcome.accepted:
            for vertex_id in outcome.confirmed:
                says[vertex_id][page.person_id] = True
            for vertex_id in outcome.rejected:
                says[vertex_id][page.person_id] = False
    confirmed_by, rejected_by = ({key: _saying(by, side) for key, by in says.items()} for side in (True, False))
    return Judgements(confirmed_by, rejected_by, dict(counts))


def _saying(by: dict[UUID, bool], side: bool) -> set[UUID]:
    return {person for person, answer in by.items() if answer is side}


def blind_opinions(opinions: list[Opinion]) -> list[Opinion]:
    """Return the vertices marked by hand by a person who knew nothing of others' marks."""
    by_hand = [opinion for opinion in opinions if opinion.verdict == "confirmed" and not opinion.machine]
    return [opinion for opinion in by_hand if opinion.mark and not opinion.reviewed]


def has_hand_answer(opinions: list[Opinion]) -> bool:
    """Whether somebody judged the vertex by hand; without, whoever has an opinion confirmed the machine's mark."""
    by_hand = [opinion for opinion in opinions if not opinion.machine]
    return any(opinion.mark or opinion.verdict != "confirmed" for opinion in by_hand)


def progress_of(session: Session, analysis: Analysis | None, camera: Sensor) -> CropProgress:
    """Return how many marks of an analysis people have looked at."""
    if analysis is None or analysis.detection_id is None:
        return CropProgress(marks=0, judged=0, blind_needed=0, next_blind=None, unmarked=0, next_unmarked=None)
    opinions = opinions_of(session, analysis.detection_id, camera.id)
    by_people = judgements(session, camera.id, analysis.id)
    marked = list(shown_marks(session, analysis, camera))
    others = [UUID(mark["vertex_id"]) for mark in marks_of(analysis) if mark["reason"] is not None]
    rejected = [vertex_id for vertex_id in marked if by_people.is_rejected(vertex_id) and vertex_id not in opinions]
    unmarked = [*rejected, *(vertex_id for vertex_id in others if vertex_id not in opinions)]
    blind = sum(bool(blind_opinions(opinions.get(vertex_id, []))) for vertex_id in marked)
    enough = min(LEAST_BLIND, len(marked)) if len(marked) >= LEAST_MARKS else 0
    return CropProgress(
        marks=len(marked),
        judged=sum(vertex_id in opinions for vertex_id in marked) + len(rejected),
        blind_needed=max(0, enough - blind),
        next_blind=next((vertex_id for vertex_id in marked if vertex_id not in opinions), None),
        unmarked=len(unmarked),
        next_unmarked=unmarked[0] if unmarked else None,
    )
