"""Analyses as they are read: one with its job, those of a recording, the file of one."""

from __future__ import annotations

from typing import NamedTuple
from urllib.parse import quote
from uuid import UUID

from sqlalchemy import select
from sqlalchemy.orm import Session

from apexcal.documents.analysis_kinds import AnalysisKind, AnalysisPage
from service.analyses.kinds import view_of
from service.platform.auth.access import Access
from service.platform.db.analyses import Analysis, AnalysisFile
from service.platform.db.jobs import Job
from service.platform.db.recordings import Blob, Recording
from service.platform.http.pages import Window, fetch
from service.platform.http.problems import Problem


class AnalysisDownload(NamedTuple):
    """The file that an analysis made, looked up in a session that has ended."""

    key: str
    size: int
    disposition: str


def list_analyses(access: Access, recording_id: UUID, kind: AnalysisKind | None, window: Window) -> AnalysisPage:
    """A page of a recording's analyses, newest first; of one kind, if that is named."""
    recording = access.find(Recording, recording_id)
    statement = select(Analysis).where(Analysis.recording_id == recording.id)
    if kind is not None:
        statement = statement.where(Analysis.kind == kind)
    rows, following = fetch(access.session, statement, Analysis.id, window, newest_first=True)
    of_rows = select(Job).where(Job.id.in_([row.job_id for row in rows]))
    jobs = {job.id: job for job in access.session.scalars(of_rows)}
    return AnalysisPage(items=[view_of(row, jobs.get(row.job_id or 0)) for row in rows], next=following)


def job_of(session: Session, row: Analysis) -> Job | None:
    """The job that answers an analysis, if it is still kept."""
    return session.get(Job, row.job_id) if row.job_id else None


def analysis_file(access: Access, analysis_id: UUID) -> AnalysisDownload:
    """The file that an analysis made. Raises :class:`Problem` 404, 403, and 409 ``no_file``."""
    row = access.find(Analysis, analysis_id, "engineer")
    made = access.session.get(AnalysisFile, row.id)
    if made is None:
        raise Problem(
            409,
            "no_file",
            f"This analysis ({row.kind}) is {row.state}; it has no file.",
            "A calibrated copy has a file when its state is done; other kinds have none.",
            state=row.state,
        )
    size = access.session.get_one(Blob, made.blob_key).size
    return AnalysisDownload(made.blob_key, size, f"attachment; filename*=UTF-8''{quote(made.file_name, safe='')}")
