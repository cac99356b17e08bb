"""Detections and vertices, as the answers show them."""

from __future__ import annotations

from collections.abc import Sequence
from uuid import UUID

from sqlalchemy import select
from sqlalchemy.orm import Session

from apexcal.documents.base import stored
from apexcal.documents.detections import DetectionView, FrameOfVertex, Moved, VertexSummary, VertexView
from apexcal.documents.detectors import sentences_of
from service.platform.db.detections import Detection, Vertex, VertexFrame, marked_corners
from service.platform.db.recordings import Sensor
from service.platform.job_status.views import job_view, jobs_of

# What the list of vertices reads: covariances and corners are large.
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
    """Vertices with their frames: in one camera, or in all of them. ``joint``: with what their corners share."""
    frames = (
        select(VertexFrame, Sensor.name)
        .join(Sensor, Sensor.id == VertexFrame.sensor_id)
        .where(VertexFrame.vertex_id.in_([vertex.id for vertex in vertices]))
    )
    if camera is not None:
        frames = frames.where(VertexFrame.sensor_id == camera.id)
    of_vertex: dict[UUID, dict[str, FrameOfVertex]] = {vertex.id: {} for vertex in vertices}
    for frame, name in session.execute(frames):
        moved = Moved.model_validate(frame) if frame.x is not None else None
        of_vertex[frame.vertex_id][name] = FrameOfVertex(
            index=frame.frame_index, gap_ns=frame.gap_ns, moved=moved, corners=stored(frame.corners or [])
        )
    return [
        VertexView(
            **VertexSummary.model_validate(vertex, from_attributes=True).model_dump(),
            covariance=vertex.covariance,
            frames=of_vertex[vertex.id],
            corners=stored(vertex.corners or []),
            joint_covariance=_whole(vertex.corner_covariance) if joint else None,
        )
        for vertex in vertices
    ]


def _whole(lower: list[list[float]] | None) -> list[list[float]] | None:
    """A symmetric matrix of the rows of its lower triangle."""
    if lower is None:
        return None
    return [[lower[max(i, j)][min(i, j)] for j in range(len(lower))] for i in range(len(lower))]
