"""What the detection routes ask of the database, and the rules on the way."""

from __future__ import annotations

from uuid import UUID

from sqlalchemy import Select, select
from sqlalchemy.orm import Session

from service.auth.access import Access
from service.auth.roles import Role
from service.db.detections import Detection, Vertex, VertexFrame
from service.db.digests import content_hash
from service.db.recordings import Recording, Sensor
from service.detections.detectors import resolve_options
from service.detections.schemas import DetectionRequest
from service.http.problems import Problem
from service.jobs.bundles import shards


def ready_recording(access: Access, recording_id: UUID, role: Role) -> Recording:
    """A recording whose sensors can be read.

    Raises:
        Problem: 409 ``recording_not_ready`` while it is being uploaded or ingested, or when that failed.
    """
    recording = access.find(Recording, recording_id, role)
    if recording.state == "ready":
        return recording
    hint = "Wait until its state is ready; GET /v1/recordings/{id} says how far it is."
    if recording.state == "failed":
        hint = "Its `problem` says what to do; then upload it anew, or retry it."
    raise Problem(
        409,
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
    if detection.state == "done":
        return detection
    waits = detection.state in ("queued", "running")
    raise Problem(
        409,
        "detection_not_done",
        f"The detection is {detection.state}; its vertices can be used when it is done.",
        "Wait for its job, or run another detection." if waits else "Run another detection.",
        state=detection.state,
    )


def find_camera(session: Session, recording_id: UUID, name: str) -> Sensor:
    """A recording's camera by its name in the rig. Raises :class:`Problem` 404 ``unknown_camera`` naming those."""
    cameras = list(
        session.scalars(
            select(Sensor).where(Sensor.recording_id == recording_id, Sensor.kind == "camera").order_by(Sensor.name)
        )
    )
    for camera in cameras:
        if camera.name == name:
            return camera
    raise Problem(
        404,
        "unknown_camera",
        f"The recording has no camera {name!r}.",
        f"Its cameras are {', '.join(camera.name for camera in cameras)}." if cameras else "It has no camera at all.",
        cameras=[camera.name for camera in cameras],
    )


def new_detection(recording: Recording, wanted: DetectionRequest, person_id: UUID) -> Detection:
    """The row of a detection, all its options resolved. Raises :class:`Problem` as ``resolve_options`` does."""
    options = resolve_options(wanted.detector, wanted.options)
    pairing = wanted.pairing.model_dump()
    content = {"region": wanted.region, "detector": wanted.detector, "options": options, "pairing": pairing}
    return Detection(
        fleet_id=recording.fleet_id,
        recording_id=recording.id,
        **content,
        content_hash=content_hash({"recording": recording.sha256 or recording.id.hex, **content}),
        state="queued",
        remaining=1,
        counts={},
        created_by=person_id,
    )


def shard_payloads(session: Session, recording: Recording, workers: int) -> list[dict[str, int]]:
    """What the jobs of a detection look at: each a range of sweeps, together all of them."""
    sweeps = session.scalar(select(Sensor.count).where(Sensor.recording_id == recording.id, Sensor.kind == "lidar"))
    return [{"first": part.start, "stop": part.stop} for part in shards(max(sweeps or 0, 1), workers)]


def vertices_of(detection: Detection, camera: Sensor | None, quality: str | None = None) -> Select[Vertex]:
    """A detection's vertices; with a camera only those that have a frame of it, with a quality only those."""
    vertices = select(Vertex).where(Vertex.detection_id == detection.id)
    if quality is not None:
        vertices = vertices.where(Vertex.quality == quality)
    if camera is None:
        return vertices
    return vertices.join(VertexFrame, VertexFrame.vertex_id == Vertex.id).where(VertexFrame.sensor_id == camera.id)
