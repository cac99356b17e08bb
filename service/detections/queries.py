"""Detections, their vertices, and the recordings and cameras that they need."""

from __future__ import annotations

from uuid import UUID

from sqlalchemy import Select, select

from apexcal.documents.corners import TOP
from apexcal.documents.roles import Role
from apexcal.documents.states import UNENDED, WorkState
from service.platform.auth.access import Access
from service.platform.db.detections import Detection, Vertex, VertexFrame
from service.platform.db.recordings import Sensor
from service.platform.http.problems import conflict


def done_detection(access: Access, detection_id: UUID, role: Role) -> Detection:
    """A detection whose vertices can be used.

    Raises:
        Problem: 409 ``detection_not_done`` while it is queued or running, or when it failed or was cancelled.
    """
    detection = access.find(Detection, detection_id, role)
    if detection.state == WorkState.DONE:
        return detection
    waits = detection.state in UNENDED
    raise conflict(
        "detection_not_done",
        f"The detection is {detection.state}; its corners can be used when it is done.",
        "Wait for its job, or run another detection." if waits else "Run another detection.",
        state=detection.state,
    )


def vertices_of(
    detection: Detection, camera: Sensor | None, quality: str | None = None, corner: str = TOP
) -> Select[Vertex]:
    """A detection's vertices of one corner; with a camera those that have a frame of it."""
    vertices = select(Vertex).where(Vertex.detection_id == detection.id, Vertex.corner == corner)
    if quality is not None:
        vertices = vertices.where(Vertex.quality == quality)
    if camera is None:
        return vertices
    return vertices.join(VertexFrame, VertexFrame.vertex_id == Vertex.id).where(VertexFrame.sensor_id == camera.id)
