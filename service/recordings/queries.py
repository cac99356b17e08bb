"""A recording's parts and cameras, what is known of its file, and recordings as the answers show them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any
from uuid import UUID

from sqlalchemy import select
from sqlalchemy.orm import Session

from apexcal.documents.readings import Reading
from apexcal.documents.recordings import RecordingSummary, RecordingView, SensorView
from service.platform.auth.access import Access
from service.platform.db.fleets import RigCamera
from service.platform.db.recordings import Recording, Sensor, UploadPart
from service.platform.http.problems import not_found, unprocessable
from service.platform.job_status.views import job_views


def reading_document(session: Session, rig_id: UUID, reading: Reading) -> dict[str, Any]:
    """What is known of a recording, as its row keeps it, without empty members.

    Raises:
        Problem: 422 ``unknown_camera``, where a topic is given for a camera that the rig does not have.
    """
    names = set(session.scalars(select(RigCamera.name).where(RigCamera.rig_id == rig_id)))
    # A rig without cameras gets those that are named here.
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
    """A recording's acknowledged parts in order."""
    return session.scalars(
        select(UploadPart).where(UploadPart.recording_id == row.id).order_by(UploadPart.number)
    ).all()


def find_camera(access: Access, row: Recording, camera: str) -> Sensor:
    """A recording's camera by its name. Raises :class:`Problem` 404 ``no_such_camera`` naming those there are."""
    cameras = access.session.scalars(
        select(Sensor).where(Sensor.recording_id == row.id, Sensor.kind == "camera").order_by(Sensor.name)
    ).all()
    for sensor in cameras:
        if sensor.name == camera:
            return sensor
    names = ", ".join(sensor.name for sensor in cameras)
    raise not_found(
        "no_such_camera",
        f"The recording has no camera {camera!r}.",
        f"Its cameras: {names}." if names else f"It is {row.state}: cameras are known once it is ready.",
    )


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
