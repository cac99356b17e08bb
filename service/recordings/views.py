"""Recordings with their job and sensors, as the answers show them."""

from __future__ import annotations

from collections.abc import Sequence

from sqlalchemy import select
from sqlalchemy.orm import Session

from apexcal.documents.recordings import RecordingSummary, RecordingView, SensorView
from service.platform.db.recordings import Recording, Sensor
from service.platform.job_status.views import job_views


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
