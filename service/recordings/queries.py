"""A recording's parts and cameras, what is known of its file, and recordings as the answers show them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any
from uuid import UUID

from sqlalchemy import bindparam, select
from sqlalchemy.orm import Session

from apexcal.documents.readings import Reading
from apexcal.documents.recordings import RecordingSummary, RecordingView, SensorView
from apexcal.documents.roles import Role
from apexcal.documents.states import RecordingState
from service.fleets.rigs import named_camera
from service.platform.auth.access import Access
from service.platform.db.fleets import RigCamera
from service.platform.db.recordings import Recording, Sensor, UploadPart
from service.platform.http.problems import conflict, unprocessable
from service.platform.job_status.views import job_views

_CAMERAS = (
    select(Sensor).where(Sensor.recording_id == bindparam("recording"), Sensor.kind == "camera").order_by(Sensor.name)
)


def reading_document(session: Session, rig_id: UUID, reading: Reading) -> dict[str, Any]:
    """Return the owner's statements about a recording as its row keeps them, without empty members.

    Raises:
        Problem: 422 ``unknown_camera``, where a topic is given for a camera that the rig does not have.
    """
    names = set(session.scalars(select(RigCamera.name).where(RigCamera.rig_id == rig_id)))
    # A rig without cameras gets the cameras that the reading names.
    strange = sorted(set(reading.topics.cameras) - names) if names else []
    if strange:
        raise unprocessable(
            "unknown_camera",
            f"A topic is given for {strange[0]!r}, and the rig has no camera of that name.",
            f"Its cameras are {', '.join(sorted(names))}.",
            cameras=sorted(names),
        )
    return reading.model_dump(exclude_defaults=True)


def parts_of(session: Session, row: Recording) -> Sequence[UploadPart]:
    """Return a recording's acknowledged parts in order."""
    return session.scalars(
        select(UploadPart).where(UploadPart.recording_id == row.id).order_by(UploadPart.number)
    ).all()


def ready_recording(access: Access, recording_id: UUID, role: Role) -> Recording:
    """A recording whose sensors can be read.

    Raises:
        Problem: 409 ``recording_not_ready`` while it is being uploaded or ingested, or when that failed.
    """
    recording = access.find(Recording, recording_id, role)
    require_ready(recording)
    return recording


def require_ready(recording: Recording) -> None:
    """Raises :class:`Problem` 409 ``recording_not_ready``."""
    if recording.state == RecordingState.READY:
        return
    hint = "Wait until its state is ready; GET /v1/recordings/{id} says how far it is."
    if recording.state == RecordingState.FAILED:
        hint = "Its `problem` says what to do; then upload it anew, or retry it."
    raise conflict(
        "recording_not_ready",
        f"The recording {recording.name!r} is {recording.state}; its sweeps and frames cannot be read.",
        hint,
        state=recording.state,
    )


def lidar_of(session: Session, recording_id: UUID) -> Sensor:
    """Return the LiDAR of a recording that was read."""
    return session.scalars(select(Sensor).where(Sensor.recording_id == recording_id, Sensor.kind == "lidar")).one()


def find_camera(session: Session, recording_id: UUID, name: str) -> Sensor:
    """Return a recording's camera by its name in the rig.

    Raises:
        Problem: 404 ``unknown_camera``, with the names of its cameras.
    """
    return named_camera(session.scalars(_CAMERAS, {"recording": recording_id}).all(), name, "The recording")


def summaries(session: Session, rows: Sequence[Recording]) -> list[RecordingSummary]:
    """Recordings with their jobs."""
    jobs = job_views(session, (row.job_id for row in rows))
    views: list[RecordingSummary] = []
    for row in rows:
        view = RecordingSummary.model_validate(row)
        view.job = jobs.get(row.job_id) if row.job_id is not None else None
        views.append(view)
    return views


def view(session: Session, row: Recording) -> RecordingView:
    """A recording with its job and sensors."""
    summary = summaries(session, [row])[0]
    sensors = session.scalars(select(Sensor).where(Sensor.recording_id == row.id).order_by(Sensor.name))
    return RecordingView(**summary.model_dump(), sensors=[SensorView.model_validate(sensor) for sensor in sensors])
