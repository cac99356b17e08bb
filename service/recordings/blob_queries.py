"""The objects of the store that a recording's rows name."""

from __future__ import annotations

from uuid import UUID

from sqlalchemy import select
from sqlalchemy.orm import Session

from service.platform.db.analyses import Analysis, AnalysisFile
from service.platform.db.recordings import PackedSweeps, Sensor


def analysis_keys(session: Session, recording_id: UUID) -> list[str]:
    """The keys of the files that a recording's analyses made."""
    copies = select(AnalysisFile.blob_key).join(Analysis, Analysis.id == AnalysisFile.analysis_id)
    return list(session.scalars(copies.where(Analysis.recording_id == recording_id)))


def sensor_keys(session: Session, recording_id: UUID) -> list[str]:
    """The keys of a recording's sensors' files, and of its packed sweeps."""
    packed = select(PackedSweeps.blob_key).join(Sensor, Sensor.id == PackedSweeps.sensor_id)
    return [
        *session.scalars(select(Sensor.blob_key).where(Sensor.recording_id == recording_id)),
        *session.scalars(packed.where(Sensor.recording_id == recording_id)),
    ]
