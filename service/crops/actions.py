"""Giving a person a page of crops, and taking their answer to it: once per id.

The person's lock is held, so that two browser tabs of one person come one after the other. Two people who ask at the
same moment come one after the other too, and get other marks.
"""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime, timedelta
from random import SystemRandom
from uuid import UUID

from sqlalchemy import select
from sqlalchemy.orm import Session

from apexcal.documents.corners import CornerName
from apexcal.documents.crops import LEAST_MARKS, CropAnswer, CropSheet, CropVerdict, CropView, expected_pixel, side_of
from apexcal.documents.machine_marks import TILE_COLUMNS
from service.annotations.disclosure_actions import keys_of, record_disclosures
from service.annotations.locks import lock_person
from service.annotations.tally_queries import opinions_of
from service.crops.confirmation_actions import keep_outcome
from service.crops.pictures import image_of, limits_in, tile_of
from service.crops.queries import (
    PageOutcome,
    has_hand_answer,
    judgements,
    newest_marks,
    outcome_of,
    progress_of,
    shown_marks,
)
from service.crops.shifts import DrawnCrop, ShownMark, draw_page
from service.platform.auth.access import Access
from service.platform.db.analyses import Analysis
from service.platform.db.annotations import CropPage
from service.platform.db.base import Json
from service.platform.db.detections import Detection, Vertex, VertexFrame
from service.platform.db.recordings import CameraFrame, Recording, Sensor
from service.platform.http.problems import Problem, conflict, not_found, unprocessable

# The pages too take a person for away who has touched nothing for ten minutes; then others get the marks.
_AWAY = timedelta(minutes=10)


def next_page(session: Session, detection: Detection, camera: Sensor, person_id: UUID) -> CropPage | None:
    """The page that the person has not answered yet, or a new one; None where no mark needs a look of theirs.

    What they answer afterwards on its vertices counts as reviewed.

    Raises:
        Problem: 409 ``no_marks``, ``too_few_marks``, ``blind_marks_first``.
    """
    clock = lock_person(session, person_id)
    analysis = newest_marks(session, detection.id, camera.name)
    if analysis is None:
        raise _no_marks(camera.name)
    # The recording first, as whoever deletes it does.
    if session.get(Recording, camera.recording_id, with_for_update={"read": True, "key_share": True}) is None:
        raise not_found()
    session.execute(select(Analysis.id).where(Analysis.id == analysis.id).with_for_update(key_share=True))
    unanswered = select(CropPage).where(CropPage.analysis_id == analysis.id, CropPage.answered_at.is_(None))
    own = session.scalar(unanswered.where(CropPage.person_id == person_id))
    if own is not None:
        return own
    progress = progress_of(session, analysis, camera)
    if progress.marks < LEAST_MARKS:
        raise _too_few(progress.marks)
    if progress.blind_needed:
        raise _blind_first(progress.blind_needed)
    crops = _failed(session, analysis, person_id) or _new_crops(session, analysis, camera, clock - _AWAY)
    if not crops:
        return None
    of = {"detection_id": detection.id, "analysis_id": analysis.id, "sensor_id": camera.id, "person_id": person_id}
    page = CropPage(**of, crops=crops)
    session.add(page)
    record_disclosures(session, person_id, camera, keys_of(session, camera.id, _vertices(page)), "crops")
    return page


def _failed(session: Session, analysis: Analysis, person_id: UUID) -> list[Json]:
    """The crops of the person's last page, if it was not accepted, in another order.

    They are drawn where they were: of a crop that moved, everybody would know that one of both is shifted.
    """
    own = select(CropPage).where(CropPage.analysis_id == analysis.id, CropPage.person_id == person_id)
    last = session.scalar(own.order_by(CropPage.answered_at.desc(), CropPage.id.desc()).limit(1))
    if last is None or outcome_of(last).accepted:
        return []
    return SystemRandom().sample(last.crops, len(last.crops))


def _new_crops(session: Session, analysis: Analysis, camera: Sensor, away: datetime) -> list[Json]:
    """Crops of a page that nobody has now; of those who got one before ``away`` nobody waits for the answer."""
    unanswered = select(CropPage).where(CropPage.analysis_id == analysis.id, CropPage.answered_at.is_(None))
    others = session.scalars(unanswered.where(CropPage.created_at > away))
    elsewhere = {UUID(crop["vertex_id"]) for page in others for crop in page.crops}
    rows = shown_marks(session, analysis, camera)
    drawn = _draw(session, analysis, camera, {key: row for key, row in rows.items() if key not in elsewhere})
    return [
        # The digits of both alike: those of the machine's own could be fewer.
        {"vertex_id": str(mark.vertex_id), "side_px": mark.side_px, "shifted": shifted}
        | {"u": round(u, 3), "v": round(v, 3)}
        | {name: rows[mark.vertex_id].get(name) for name in TILE_COLUMNS}
        for mark, u, v, shifted in drawn
    ]


def _draw(session: Session, analysis: Analysis, camera: Sensor, marks: dict[UUID, Json]) -> list[DrawnCrop]:
    assert analysis.detection_id is not None
    judged = judgements(session, camera.id, analysis.id)
    answered = opinions_of(session, analysis.detection_id, camera.id)
    unjudged: list[ShownMark] = []
    confirmed: list[ShownMark] = []
    for vertex_id, (_, _, width, height) in _frames(session, camera, list(marks)).items():
        opinions = answered.get(vertex_id, [])
        if has_hand_answer(opinions) or (not opinions and judged.is_rejected(vertex_id)):
            continue
        mark = marks[vertex_id]
        side_px = side_of(mark["edge_px"])
        limits_px = limits_in(tile_of(mark), side_px, width, height)
        shown = ShownMark(vertex_id, mark["u"], mark["v"], side_px, *expected_pixel(mark), limits_px)
        (confirmed if opinions else unjudged).append(shown)
    return draw_page(unjudged, confirmed, SystemRandom()) if unjudged else []


def _frames(
    session: Session, camera: Sensor, vertices: Sequence[UUID]
) -> dict[UUID, tuple[CornerName, int, int, int]]:
    """Corner, index of the frame, its width and height of each vertex."""
    rows = session.execute(
        select(Vertex.id, Vertex.corner, CameraFrame.index, CameraFrame.width, CameraFrame.height)
        .join(VertexFrame, VertexFrame.vertex_id == Vertex.id)
        .join(
            CameraFrame,
            (CameraFrame.sensor_id == VertexFrame.sensor_id) & (CameraFrame.index == VertexFrame.frame_index),
        )
        .where(VertexFrame.sensor_id == camera.id, Vertex.id.in_(vertices))
        .order_by(Vertex.rank, Vertex.id)
    )
    return {vertex_id: (corner, *frame) for vertex_id, corner, *frame in rows}  # pyright: ignore[reportReturnType]


def _vertices(page: CropPage) -> Sequence[UUID]:
    return [UUID(crop["vertex_id"]) for crop in page.crops]


def sheet_of(session: Session, page: CropPage, camera: Sensor) -> CropSheet:
    """A page as its person sees it: nothing in it says which marks are shifted."""
    frames = _frames(session, camera, _vertices(page))
    crops: list[CropView] = []
    for index, crop in enumerate(page.crops):
        vertex_id = UUID(crop["vertex_id"])
        corner, *frame = frames[vertex_id]
        image = image_of(crop, index, page.id, camera, *frame)
        shown = {name: crop[name] for name in ("u", "v", "side_px")}
        crops.append(CropView(vertex_id=vertex_id, corner=corner, frame_index=frame[0], image=image, **shown))
    return CropSheet(id=page.id, person_id=page.person_id, camera=camera.name, crops=crops)


def find_page(access: Access, page_id: UUID, *, lock: bool = False) -> CropPage:
    """A person's own page, locked for an answer. Another person's pages do not exist for them."""
    if lock:
        lock_person(access.session, access.person.id)
    page = access.session.get(CropPage, page_id, with_for_update=True if lock else None)
    if page is None or page.person_id != access.person.id:
        raise not_found()
    access.need(access.session.get_one(Detection, page.detection_id).fleet_id, "annotator")
    return page


def judge(session: Session, page: CropPage, answer: CropAnswer) -> CropVerdict:
    """Write an answer to a page. The same id again changes nothing and gives the same verdict.

    Raises:
        Problem: 409 ``page_answered``, ``answer_id_used``, 422 ``not_on_page``.
    """
    wrong = sorted({str(vertex_id) for vertex_id in answer.wrong})
    strange = set(wrong) - {crop["vertex_id"] for crop in page.crops}
    if strange:
        raise unprocessable(
            "not_on_page", f"The vertex {min(strange)} is not on this page.", "Name vertices of the page's own crops."
        )
    camera, analysis = session.get_one(Sensor, page.sensor_id), session.get_one(Analysis, page.analysis_id)
    if page.answered_at is None:
        page.answer_id, page.wrong = answer.id, wrong
        page.answered_at = lock_person(session, page.person_id)
        session.flush()
        if outcome_of(page).accepted:
            keep_outcome(session, page, outcome_of(page), camera)
    elif page.answer_id != answer.id:
        raise conflict(
            "page_answered",
            "You have answered this page already, perhaps in another tab.",
            "Go on with the next page: POST /v1/detections/{id}/crops/next.",
        )
    elif page.wrong != wrong:
        raise conflict(
            "answer_id_used",
            f"The id {answer.id} belongs to another answer.",
            "Make a new random id for each answer; send the same id only with the same answer.",
        )
    outcome = outcome_of(page)
    return CropVerdict(
        id=answer.id,
        accepted=outcome.accepted,
        shifted=outcome.shifts.shifted,
        missed=outcome.shifts.missed,
        confirmed=len(outcome.confirmed) if outcome.accepted else 0,
        rejected=len(outcome.rejected) if outcome.accepted else 0,
        sentence=_sentence(outcome, accepts_all=not wrong),
        progress=progress_of(session, analysis, camera),
    )


def _sentence(outcome: PageOutcome, *, accepts_all: bool) -> str:
    shifted, missed = outcome.shifts.shifted, outcome.shifts.missed
    if not outcome.accepted:
        how = "You accepted every mark of the page" if accepts_all else f"You accepted {missed} wrong marks"
        return (
            f"{how}, but the service had shifted {shifted} of them on purpose. Nothing was confirmed. Look at each "
            "crop: the page comes again."
        )
    rejected = f", {len(outcome.rejected)} rejected" if outcome.rejected else ""
    if missed:
        return (
            f"{len(outcome.confirmed)} marks confirmed{rejected}. You missed {missed} of {shifted} shifted marks: "
            "what you confirm counts as less exact."
        )
    return f"{len(outcome.confirmed)} marks confirmed{rejected}. You saw all {shifted} shifted marks."


def _no_marks(camera: str) -> Problem:
    return conflict(
        "no_marks",
        f"The machine has not marked this detection's corners in {camera} yet.",
        "Wait until it has, or ask for its marks (an analysis of the kind machine_marks).",
    )


def _too_few(count: int) -> Problem:
    return conflict(
        "too_few_marks",
        f"The machine has {count} marks in this camera; a page of crops needs {LEAST_MARKS}.",
        "Mark these corners by hand (tasks of the detection).",
    )


def _blind_first(count: int) -> Problem:
    return conflict(
        "blind_marks_first",
        f"{count} more of the corners that the machine marked must be marked blind first: they show how far its "
        "marks are off in this recording.",
        "Mark them by hand, without seeing the machine's marks (tasks of the detection).",
        blind_needed=count,
    )
