"""Analyses asked for and deleted."""

from __future__ import annotations

from uuid import UUID

from apexcal.documents.analysis_kinds import AnalysisRequest
from service.analyses.jobs import queue_analysis
from service.analyses.kinds import plan_of
from service.platform.auth.access import Access
from service.platform.db.analyses import Analysis, AnalysisFile
from service.platform.db.jobs import Job
from service.platform.db.recordings import Recording
from service.platform.jobs.queue import abandon
from service.platform.storage.blobs import condemn
from service.platform.storage.quota import counted


def ask_analysis(access: Access, recording: Recording, request: AnalysisRequest) -> tuple[Analysis, Job]:
    """A new analysis and its job. Raises :class:`Problem` as its kind does."""
    plan = plan_of(access, recording, request)
    row = Analysis(
        fleet_id=recording.fleet_id,
        recording_id=recording.id,
        detection_id=plan.detection_id,
        kind=request.kind,
        asked=plan.asked,
    )
    access.session.add(row)
    access.session.flush()
    return row, queue_analysis(access.session, row)


def delete_analysis(access: Access, analysis_id: UUID) -> None:
    """Delete an analysis with the file that it made, or end its making. Raises :class:`Problem` 404, 403."""
    row = access.find(Analysis, analysis_id, "engineer")
    session = access.session
    # Jobs first, as workers lock them before the rows that they work for.
    abandon(session, [row.id])
    recording = session.get(Recording, row.recording_id, with_for_update=True)
    made = session.get(AnalysisFile, row.id)
    if made is not None:
        condemn(session, [made.blob_key])
    session.delete(row)
    session.flush()
    if recording is not None:
        recording.taken_bytes = counted(session, recording, besides=row.job_id)
