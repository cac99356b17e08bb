"""Jobs that answer an analysis: one for each."""

from __future__ import annotations

from collections.abc import Collection, Sequence
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
from service.platform.jobs.kinds import Kind, existing, failed_subject
from service.platform.jobs.queue import enqueue
from service.platform.storage.quota import recounting

# Scores of pairs and points of pixels take milliseconds, so they do not wait on the queue of drives.
_QUEUES = {
    "preview": "detect",
    "suggestion": "detect",
    "clock_offset": "solve",
    "machine_marks": "detect",
    "precision": "solve",
    "calibrated_copy": "ingest",
    "pixel_points": "report",
    "report": "report",
    "remedies": "solve",
    "pair_validation": "report",
    "lane_validation": "detect",
    "edge_validation": "detect",
}


def analysis_of(recording: Recording, kind: str, question: Json, detection_id: UUID | None = None) -> Analysis:
    """Return a new row, not yet written, for a question to a recording."""
    owned = {"fleet_id": recording.fleet_id, "vehicle_id": recording.vehicle_id, "recording_id": recording.id}
    return Analysis(**owned, kind=kind, asked=question, detection_id=detection_id)


def queue_analysis(session: Session, row: Analysis) -> Job:
    """Queue the one job of an analysis, which is written if it is new."""
    session.add(row)
    session.flush()
    job = enqueue(session, kind=row.kind, fleet_id=row.fleet_id, subject_id=row.id)
    row.state, row.problem, row.job_id = WorkState.QUEUED, None, job.id
    tell_followers(session, row)
    return job


def tell_followers(session: Session, row: Analysis) -> None:
    """Tell the fleet's followers that an analysis changed, and with it its recording's page."""
    hint(session, row.fleet_id, "analysis", row.id)
    if row.recording_id is not None:
        hint(session, row.fleet_id, "recording", row.recording_id)


def queue_marks(session: Session, detection_id: UUID, detection: Detection) -> None:
    """Ask for the machine's marks in every camera in which the detection's vertices have frames."""
    recording = session.get_one(Recording, detection.recording_id)
    paired = select(VertexFrame.sensor_id).join(Vertex).where(Vertex.detection_id == detection_id)
    for camera in session.scalars(select(Sensor.name).where(Sensor.id.in_(paired)).order_by(Sensor.name)):
        question = {"camera": camera, "model": "brown_conrady"}
        queue_analysis(session, analysis_of(recording, "machine_marks", question, detection_id))


def _take(session: Session, analysis_id: UUID, result: Json) -> None:
    row = session.get_one(Analysis, analysis_id)
    row.result = result
    if row.kind == "precision":
        row.single_pairs = None  # the pairs that the fit was made of


def _end(session: Session, ids: Collection[UUID], state: WorkState, problem: Json | None) -> None:
    for row in existing(session, Analysis, ids):
        row.state, row.problem = state, problem
        if state != WorkState.DONE:
            with recounting(session, row.recording_id, besides=row.job_id):
                """The job's reserved bytes no longer count."""
        tell_followers(session, row)


def _retry(session: Session, job: Job) -> Sequence[Job]:
    return [queue_analysis(session, failed_subject(session, job, Analysis, "analysis"))]


KINDS = tuple(
    Kind(name, queue, _end, _retry, shown_by=Analysis.job_id, take=_take) for name, queue in _QUEUES.items()
)
