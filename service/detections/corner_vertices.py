"""Vertices of the corners that people are to mark: made beside the tips, for some ranks at a time."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from typing import Any
from uuid import UUID

from sqlalchemy import case, delete, insert, select, update
from sqlalchemy.orm import Session

from apexcal.documents.corners import TOP, CornerName, nearest
from service.platform.db.annotations import MarkingFrontier, MarkingProgress
from service.platform.db.base import Json, new_id
from service.platform.db.detections import Apex, Detection, Vertex, VertexFrame

Known = tuple[UUID, tuple[float, float, float]]
"""An apex's id and place."""


def make_corners(session: Session, detection: Detection, ranks: range) -> None:
    """Give the tips of these ranks a vertex for each asked corner that they state, unless there is one already.

    The caller holds the recording's lock: runs of one recording share its apexes.
    """
    of_ranks = (Vertex.detection_id == detection.id, Vertex.rank >= ranks.start, Vertex.rank < ranks.stop)
    there = {(rank, corner) for rank, corner in session.execute(select(Vertex.rank, Vertex.corner).where(*of_ranks))}
    tips = session.scalars(select(Vertex).where(*of_ranks, Vertex.corner == TOP)).all()
    corners = [name for name in detection.marked_corners or () if name != TOP]
    new = [
        (tip, stated)
        for tip in tips
        for corner in corners
        if (tip.rank, corner) not in there and (stated := named(tip.corners, corner)) is not None
    ]
    if not new:
        return
    near = _apexes(session, detection.lidar_id, {tip.sweep_index for tip, _ in new})
    frames: dict[UUID, list[VertexFrame]] = defaultdict(list)
    of_tips = select(VertexFrame).join(Vertex, Vertex.id == VertexFrame.vertex_id)
    for frame in session.scalars(of_tips.where(*of_ranks, Vertex.corner == TOP)):
        frames[frame.vertex_id].append(frame)
    apexes: list[Json] = []
    vertices: list[Json] = []
    paired: list[Json] = []
    for tip, stated in new:
        apex_id = nearest(near[tip.sweep_index, stated["corner"]], [stated[axis] for axis in "xyz"])
        if apex_id is None:
            apexes.append(_apex(tip, detection, stated))
            apex_id = apexes[-1]["id"]
        vertices.append(_vertex(tip, apex_id, stated))
        paired += [_frame(frame, vertices[-1]["id"], stated["corner"]) for frame in frames[tip.id]]
    rows: tuple[tuple[type[Any], list[Json]], ...] = ((Apex, apexes), (Vertex, vertices), (VertexFrame, paired))
    for table, values in rows:
        if values:
            session.execute(insert(table), values)
    _take_back_frontiers(session, detection, ranks.start)
    session.execute(delete(MarkingProgress).where(MarkingProgress.detection_id == detection.id))


def named(corners: Sequence[Json] | None, name: CornerName) -> Json | None:
    """What a vertex states of a corner."""
    return next((corner for corner in corners or () if corner["corner"] == name), None)


def _take_back_frontiers(session: Session, detection: Detection, rank: int) -> None:
    """Whoever had no vertex left from this rank on may have one now."""
    session.execute(
        update(MarkingFrontier)
        .where(MarkingFrontier.detection_id == detection.id)
        .values(rank=case((MarkingFrontier.rank > rank, rank), else_=MarkingFrontier.rank))
    )


def _apexes(session: Session, lidar_id: UUID, sweeps: set[int]) -> dict[tuple[int, str], list[Known]]:
    apexes: dict[tuple[int, str], list[Known]] = defaultdict(list)
    statement = select(Apex.sweep_index, Apex.corner, Apex.id, Apex.x, Apex.y, Apex.z).where(
        Apex.lidar_id == lidar_id, Apex.sweep_index.in_(sorted(sweeps)), Apex.corner != TOP
    )
    for sweep, corner, apex_id, x, y, z in session.execute(statement):
        apexes[sweep, corner].append((apex_id, (x, y, z)))
    return apexes


def _apex(tip: Vertex, detection: Detection, stated: Json) -> Json:
    position = {axis: stated[axis] for axis in "xyz"}
    return {
        "id": new_id(),
        "recording_id": detection.recording_id,
        "lidar_id": detection.lidar_id,
        "sweep_index": tip.sweep_index,
        "corner": stated["corner"],
        **position,
    }


def _vertex(tip: Vertex, apex_id: UUID, stated: Json) -> Json:
    of_tip = ("detection_id", "lidar_id", "rank", "sweep_index", "time_ns", "ring", "points", "quality", "flags")
    own = {name: stated[name] for name in (*"xyz", "covariance", "corner")}
    return {"id": new_id(), "apex_id": apex_id, **{name: getattr(tip, name) for name in of_tip}, **own}


def _frame(of_tip: VertexFrame, vertex_id: UUID, corner: CornerName) -> Json:
    moved = named(of_tip.corners, corner) or {}
    return {
        "vertex_id": vertex_id,
        **{name: getattr(of_tip, name) for name in ("sensor_id", "frame_index", "gap_ns")},
        **{name: moved.get(name) for name in (*"xyz", "covariance")},
    }
