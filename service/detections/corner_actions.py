"""Asking for marks of other corners than the tip: each corner gets a vertex of its own.

So tasks, answers, verdicts and disclosures of a corner are those of its vertex.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from typing import Any
from uuid import UUID

from sqlalchemy import delete, select
from sqlalchemy.orm import Session

from apexcal.documents.corners import CORNERS, TOP, CornerName, how_far
from service.db.annotations import MarkingFrontier
from service.db.base import Json
from service.db.detections import Apex, Detection, Vertex, VertexFrame
from service.db.ids import new_id
from service.db.recordings import Recording
from service.http.problems import Problem


def ask_corners(session: Session, detection: Detection, corners: Sequence[CornerName]) -> None:
    """Have these corners of a finished detection's vertices marked, and no others. What was marked stays.

    Raises:
        Problem: 409 ``corners_not_known``, no vertex states one of them.
    """
    # The lock: runs of one recording share its apexes, and nobody may be given a task meanwhile.
    lock = select(Recording.id).where(Recording.id == detection.recording_id).with_for_update(key_share=True)
    session.execute(lock)
    of_detection = select(Vertex).where(Vertex.detection_id == detection.id)
    tips = session.scalars(of_detection.where(Vertex.corner == TOP).order_by(Vertex.rank)).all()
    made = set(session.scalars(select(Vertex.corner).where(Vertex.detection_id == detection.id).distinct()))
    detection.marked_corners = [name for name in CORNERS if name in corners]
    for corner in CORNERS:
        if corner in corners and corner not in {TOP, *made}:
            _make(session, detection, tips, corner)
    # Whoever had no vertex left may have one now.
    session.execute(delete(MarkingFrontier).where(MarkingFrontier.detection_id == detection.id))
    session.flush()


def _make(session: Session, detection: Detection, tips: Sequence[Vertex], corner: CornerName) -> None:
    stated = [(tip, one) for tip in tips if (one := _named(tip.corners, corner)) is not None]
    if not stated:
        raise Problem(
            409,
            "corners_not_known",
            f"No vertex of this detection states the board's {corner} corner.",
            "Detect again with the detector refined and the board's size (options board_width_m, board_height_m).",
            corner=corner,
        )
    known: dict[int, list[Apex]] = defaultdict(list)
    for apex in session.scalars(
        select(Apex).where(Apex.recording_id == detection.recording_id, Apex.corner == corner)
    ):
        known[apex.sweep_index].append(apex)
    frames: dict[UUID, list[VertexFrame]] = defaultdict(list)
    of_tips = select(VertexFrame).join(Vertex, Vertex.id == VertexFrame.vertex_id)
    for frame in session.scalars(of_tips.where(Vertex.detection_id == detection.id, Vertex.corner == TOP)):
        frames[frame.vertex_id].append(frame)
    rows: list[Any] = []
    for tip, one in stated:
        apex = _same(known[tip.sweep_index], one)
        if apex is None:
            place = {axis: one[axis] for axis in "xyz"}
            apex = Apex(
                id=new_id(),
                recording_id=detection.recording_id,
                sweep_index=tip.sweep_index,
                corner=corner,
                **place,
            )
            session.add(apex)
        vertex = _vertex(tip, apex, one)
        session.add(vertex)
        rows += [_frame(frame, vertex.id, corner) for frame in frames[tip.id]]
    session.flush()
    session.add_all(rows)


def _vertex(tip: Vertex, apex: Apex, stated: Json) -> Vertex:
    return Vertex(
        id=new_id(),
        detection_id=tip.detection_id,
        apex_id=apex.id,
        rank=tip.rank,
        sweep_index=tip.sweep_index,
        time_ns=tip.time_ns,
        x=stated["x"],
        y=stated["y"],
        z=stated["z"],
        ring=tip.ring,
        points=tip.points,
        quality=tip.quality,
        flags=list(tip.flags),
        covariance=stated["covariance"],
        corner=stated["corner"],
    )


def _frame(of_tip: VertexFrame, vertex_id: UUID, corner: CornerName) -> VertexFrame:
    moved = _named(of_tip.corners, corner) or {}
    return VertexFrame(
        vertex_id=vertex_id,
        sensor_id=of_tip.sensor_id,
        frame_index=of_tip.frame_index,
        gap_ns=of_tip.gap_ns,
        x=moved.get("x"),
        y=moved.get("y"),
        z=moved.get("z"),
        covariance=moved.get("covariance"),
    )


def _named(corners: Sequence[Json] | None, name: CornerName) -> Json | None:
    return next((one for one in corners or () if one["corner"] == name), None)


def _same(apexes: Sequence[Apex], stated: Json) -> Apex | None:
    place = (stated["x"], stated["y"], stated["z"])
    near = [(away, apex) for apex in apexes if (away := how_far((apex.x, apex.y, apex.z), place)) is not None]
    return min(near, key=lambda pair: pair[0])[1] if near else None
