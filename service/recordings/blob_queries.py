"""The objects of the store that a recording's rows name."""

from __future__ import annotations

from uuid import UUID

from sqlalchemy import select
from sqlalchemy.orm import Session

from service.platform.db.recordings import PackedSweeps, Sensor
from service.platform.db.studies import Study, StudyFile


def study_keys(session: Session, recording_id: UUID) -> list[str]:
    """The keys of the files that a recording's studies made."""
    copies = select(StudyFile.blob_key).join(Study, Study.id == StudyFile.study_id)
    return list(session.scalars(copies.where(Study.recording_id == recording_id)))


def sensor_keys(session: Session, recording_id: UUID) -> list[str]:
    """The keys of a recording's sensors' files, and of its packed sweeps."""
    packed = select(PackedSweeps.blob_key).join(Sensor, Sensor.id == PackedSweeps.sensor_id)
    return [
        *session.scalars(select(Sensor.blob_key).where(Sensor.recording_id == recording_id)),
        *session.scalars(packed.where(Sensor.recording_id == recording_id)),
    ]
