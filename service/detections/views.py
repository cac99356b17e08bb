"""Detections and vertices, as the answers show them."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from uuid import UUID

from sqlalchemy import and_, select
from sqlalchemy.orm import Session

from apexcal.documents.corners import CORNERS, TOP
from apexcal.documents.detections import (
    CornerView,
    DetectionView,
    FrameOfVertex,
    Moved,
    VertexSummary,
    VertexView,
)
from apexcal.documents.detectors import sentences_of
from service.platform.db.detections import Detection, Vertex, VertexFrame, marked_corners
from service.platform.db.recordings import Sensor
from service.platform.job_status.views import job_view, jobs_of

# What the list of vertices reads: covariances are large.
SUMMARY = tuple(getattr(Vertex, name) for name in VertexSummary.model_fields)


def detection_views(session: Session, rows: Sequence[Detection]) -> list[DetectionView]:
    """Detections with their jobs."""
    jobs = jobs_of(session, [row.id for row in rows])
    return [
        DetectionView.of(
            row,
            job=job_view(jobs[row.id]) if row.id in jobs else None,
            marked_corners=marked_corners(row),
            reasons=sentences_of(
                row.detector, row.counts.get("rejected", {}), row.counts.get("examples", {}), row.options
            ),
        )
        for row in rows
    ]


def vertex_views(
    session: Session, vertices: Sequence[Vertex], camera: Sensor | None, *, joint: bool = False
) -> list[VertexView]:
    """Vertices of a detection with their frames: in one camera, or in all of them. Tips show the other corners.

    ``joint``: with what these share.
    """
    of_camera = () if camera is None else (VertexFrame.sensor_id == camera.id,)
    rows = session.execute(
        select(Vertex, VertexFrame, Sensor.name)
        .outerjoin(VertexFrame, and_(VertexFrame.vertex_id == Vertex.id, *of_camera))
        .outerjoin(Sensor, Sensor.id == VertexFrame.sensor_id)
        .where(Vertex.detection_id.in_({vertex.detection_id for vertex in vertices}))
        .where(Vertex.rank.in_({vertex.rank for vertex in vertices}))
        .where(Vertex.sweep_index.in_({vertex.sweep_index for vertex in vertices}))
    )
    frames: dict[UUID, dict[str, VertexFrame]] = defaultdict(dict)
    of_sweep: dict[int, dict[str, Vertex]] = defaultdict(dict)
    for vertex, frame, name in rows:
        of_sweep[vertex.sweep_index][vertex.corner] = vertex
        if frame is not None:
            frames[vertex.id][name] = frame
    views = []
    for vertex in vertices:
        corners = of_sweep[vertex.sweep_index]
        others = [corners[name] for name in CORNERS if name in corners and name != vertex.corner == TOP]
        views.append(
            VertexView.of(
                vertex,
                frames={name: _frame_view(name, frame, others, frames) for name, frame in frames[vertex.id].items()},
                corners=[CornerView.of(other) for other in others],
                joint_covariance=_whole(vertex.corner_covariance) if joint else None,
            )
        )
    return views


def _frame_view(
    name: str, frame: VertexFrame, others: Sequence[Vertex], frames: Mapping[UUID, Mapping[str, VertexFrame]]
) -> FrameOfVertex:
    """A vertex's frame in the camera of this name, with the sweep's other corners where they were moved to it."""
    moved = [] if frame.x is None else [(other.corner, frames[other.id][name]) for other in others]
    return FrameOfVertex(
        index=frame.frame_index,
        gap_ns=frame.gap_ns,
        moved=None if frame.x is None else Moved.of(frame),
        corners=[CornerView.of(there, corner=corner) for corner, there in moved],
    )


def _whole(lower: list[list[float]] | None) -> list[list[float]] | None:
    """A symmetric matrix of the rows of its lower triangle."""
    if lower is None:
        return None
    return [[lower[max(i, j)][min(i, j)] for j in range(len(lower))] for i in range(len(lower))]
