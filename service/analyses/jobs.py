"""Jobs that answer an analysis: one for each."""

from __future__ import annotations

from collections.abc import Sequence
from uuid import UUID

from sqlalchemy import select
from sqlalchemy.orm import Session

from apexcal.documents.states import WorkState
from service.platform.broker.hints import hint
from service.platform.db.analyses import Analysis
from service.platform.db.base import Json
from service.platform.db.detections import Detection, Vertex, VertexFrame
from service.platform.db.jobs import Job
from service.platform.db.recordings import Recording, Sensor
from service.platform.jobs.kinds import Kind, failed_subject
from service.platform.jobs.queue import enqueue
from service.platform.storage.quota import counted

# Kinds whose jobs write files that count towards the quota.
_WRITING = ("packing", "calibrated_copy")


def queue_analysis(session: Session, row: Analysis) -> Job:
    """Queue the one job of an analysis whose row is there."""
    job = enqueue(session, kind=row.kind, fleet_id=row.fleet_id, subject_id=row.id)
    row.state, row.problem, row.job_id = WorkState.QUEUED, None, job.id
    return job


def queue_packing(session: Session, recording: Recording) -> tuple[Analysis, Job]:
    """Ask for a recording's sweeps to be packed."""
    row = Analysis(fleet_id=recording.fleet_id, recording_id=recording.id, kind="packing", asked={})
    session.add(row)
    session.flush()
    return row, queue_analysis(session, row)


def queue_marks(session: Session, detection: Detection) -> None:
    """Ask for the machine's marks in every camera in which the detection's vertices have frames."""
    paired = select(VertexFrame.sensor_id).join(Vertex).where(Vertex.detection_id == detection.id)
    for camera in session.scalars(select(Sensor.name).where(Sensor.id.in_(paired)).order_by(Sensor.name)):
        row = Analysis(
            fleet_id=detection.fleet_id,
            recording_id=detection.recording_id,
            detection_id=detection.id,
            kind="machine_marks",
            asked={"camera": camera, "model": "brown_conrady"},
        )
        session.add(row)
        session.flush()
        queue_analysis(session, row)


def _end(session: Session, analysis_id: UUID, state: WorkState, problem: Json | None) -> None:
    row = session.get(Analysis, analysis_id)
    if row is None:
        return
    row.state, row.problem = state, problem
    if state != WorkState.DONE and row.kind in _WRITING:
        recording = session.get(Recording, row.recording_id, with_for_update=True)
        if recording is not None:
            recording.taken_bytes = counted(session, recording, besides=row.job_id)
    hint(session, row.fleet_id, "recording", row.recording_id)


def _retry(session: Session, job: Job) -> Sequence[Job]:
    row = failed_subject(session, job, Analysis, "analysis")
    hint(session, row.fleet_id, "recording", row.recording_id)
    return [queue_analysis(session, row)]


KINDS = tuple(
    Kind(name, queue, _end, _retry, shown_by=Analysis.job_id)
    for name, queue in (
        ("preview", "detect"),
        ("suggestion", "detect"),
        ("clock_offset", "solve"),
        ("machine_marks", "detect"),
        ("packing", "ingest"),
        ("calibrated_copy", "ingest"),
    )
)
