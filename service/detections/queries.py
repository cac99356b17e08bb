"""Detections, their vertices, and the recordings and cameras that they need."""

from __future__ import annotations

from uuid import UUID

from sqlalchemy import Select, bindparam, select
from sqlalchemy.orm import Session

from apexcal.documents.corners import TOP
from apexcal.documents.roles import Role
from apexcal.documents.states import UNENDED, RecordingState, WorkState
from service.platform.auth.access import Access
from service.platform.db.detections import Detection, Vertex, VertexFrame
from service.platform.db.recordings import Recording, Sensor
from service.platform.http.problems import conflict, not_found

_CAMERAS = (
    select(Sensor).where(Sensor.recording_id == bindparam("recording"), Sensor.kind == "camera").order_by(Sensor.name)
)


def ready_recording(access: Access, recording_id: UUID, role: Role) -> Recording:
    """A recording whose sensors can be read.

    Raises:
        Problem: 409 ``recording_not_ready`` while it is being uploaded or ingested, or when that failed.
    """
    recording = access.find(Recording, recording_id, role)
    if recording.state == RecordingState.READY:
        return recording
    hint = "Wait until its state is ready; GET /v1/recordings/{id} says how far it is."
    if recording.state == RecordingState.FAILED:
        hint = "Its `problem` says what to do; then upload it anew, or retry it."
    raise conflict(
        "recording_not_ready",
        f"The recording {recording.name!r} is {recording.state}; its sweeps and frames cannot be read.",
        hint,
        state=recording.state,
    )


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
        f"The detection is {detection.state}; its vertices can be used when it is done.",
        "Wait for its job, or run another detection." if waits else "Run another detection.",
        state=detection.state,
    )


def find_camera(session: Session, recording_id: UUID, name: str) -> Sensor:
    """A recording's camera by its name in the rig. Raises :class:`Problem` 404 ``unknown_camera`` naming those."""
    cameras = session.scalars(_CAMERAS, {"recording": recording_id}).all()
    for camera in cameras:
        if camera.name == name:
            return camera
    raise not_found(
        "unknown_camera",
        f"The recording has no camera {name!r}.",
        f"Its cameras are {', '.join(camera.name for camera in cameras)}." if cameras else "It has no camera at all.",
        cameras=[camera.name for camera in cameras],
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
