"""Writes what an accepted page of crops says as answers: a confirmed mark counts wherever a mark by hand does."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any, NamedTuple
from uuid import UUID

from sqlalchemy import delete, func, or_, select
from sqlalchemy.orm import Session

from service.annotations.locks import lock_recording
from service.annotations.mark_actions import set_standing, write_answer
from service.annotations.task_actions import reopen
from service.annotations.views import is_machine
from service.crops.queries import PageOutcome, judgements, marks_of, mean_sigma_px
from service.platform.db.analyses import Analysis
from service.platform.db.annotations import Answer, CropPage, MarkingProgress
from service.platform.db.base import Json, new_id
from service.platform.db.detections import Vertex, VertexFrame
from service.platform.db.recordings import Sensor


class _SeenCorner(NamedTuple):
    """The apex, frame and corner that a vertex's mark belongs to."""

    vertex_id: UUID
    apex_id: UUID
    frame_index: int
    corner: str


def keep_outcome(session: Session, page: CropPage, outcome: PageOutcome, camera: Sensor) -> None:
    """Write the page's confirmations, and take back those of marks that more people reject. The person is locked.

    What the person said of a vertex by hand meanwhile holds.
    """
    lock_recording(session, camera.recording_id)
    marks = {UUID(row["vertex_id"]): row for row in marks_of(session.get_one(Analysis, page.analysis_id))}
    sides = {UUID(crop["vertex_id"]): crop["side_px"] for crop in page.crops}
    for corner in _seen_corners(session, camera, outcome.confirmed):
        _confirm(session, page, camera, corner, _columns(marks[corner.vertex_id], sides[corner.vertex_id]))
    judged = judgements(session, camera.id, page.analysis_id)
    for corner in _seen_corners(session, camera, [*filter(judged.is_rejected, outcome.rejected)]):
        _take_back(session, camera, corner)
    session.execute(delete(MarkingProgress).where(MarkingProgress.sensor_id == camera.id))


def _columns(mark: Json, side_px: float) -> Json:
    pixel = {"u": mark["u"], "v": mark["v"]}
    return pixel | {"machine_sigma_px": mean_sigma_px(mark), "crop_side_px": side_px}


def _seen_corners(session: Session, camera: Sensor, vertices: Collection[UUID]) -> list[_SeenCorner]:
    rows = session.execute(
        select(Vertex.id, Vertex.apex_id, VertexFrame.frame_index, Vertex.corner)
        .join(VertexFrame, VertexFrame.vertex_id == Vertex.id)
        .where(VertexFrame.sensor_id == camera.id, Vertex.id.in_(vertices))
        .order_by(Vertex.id)
    )
    return [_SeenCorner(*row) for row in rows]


def _confirm(session: Session, page: CropPage, camera: Sensor, corner: _SeenCorner, mark: Json) -> None:
    of_frame = _of_frame(camera, corner)
    own = (Answer.person_id == page.person_id, or_(Answer.apex_id == corner.apex_id, of_frame))
    stands = or_(Answer.is_mark & of_frame, Answer.is_verdict & (Answer.apex_id == corner.apex_id))
    rows = [*session.scalars(select(Answer).where(*own, stands))]
    before = next((row for row in rows if row.is_mark and row.frame_index == corner.frame_index), None)
    verdict = next((row for row in rows if row.is_verdict), None)
    by_hand = [row for row in rows if row.sensor_id == camera.id and not is_machine(row)]
    if any(row.verdict or row.is_mark for row in by_hand):
        return
    if verdict is not None and verdict.verdict != "confirmed":
        reopen(session, page.person_id, camera.recording_id, corner.apex_id)
    in_camera = select(func.max(Answer.version)).where(*own, Answer.sensor_id == camera.id)
    whose = {"recording_id": camera.recording_id, "person_id": page.person_id, "sensor_id": camera.id}
    where = {"apex_id": corner.apex_id, "frame_index": corner.frame_index, "corner": corner.corner}
    version = (session.scalar(in_camera) or 0) + 1
    answer = {"id": new_id(), "version": version, "verdict": "confirmed", "reviewed": True}
    write_answer(session, whose | where | answer | mark, before, verdict)


def _take_back(session: Session, camera: Sensor, corner: _SeenCorner) -> None:
    """Take back the confirmations that stand for a corner in a frame, because its mark was rejected."""
    standing = select(Answer).where(_of_frame(camera, corner), Answer.is_mark, Answer.machine_sigma_px.is_not(None))
    for row in session.scalars(standing).all():
        reopen(session, row.person_id, camera.recording_id, corner.apex_id)
        set_standing(session, row.id, is_mark=False)


def _of_frame(camera: Sensor, corner: _SeenCorner) -> Any:
    in_frame = (Answer.sensor_id == camera.id) & (Answer.frame_index == corner.frame_index)
    return in_frame & (Answer.corner == corner.corner)
