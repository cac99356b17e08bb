"""Analyses as they are read: a page of them, and the file of one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple
from urllib.parse import quote
from uuid import UUID

from sqlalchemy import select
from sqlalchemy.orm import Session

from apexcal.documents.analysis_kinds import AnalysisPage
from service.analyses.kinds import view_of
from service.annotations.disclosure_actions import disclose_pairs, may_see_pairs
from service.platform.auth.access import Access
from service.platform.db.analyses import Analysis, AnalysisFile
from service.platform.db.calibrations import CorrespondenceSet
from service.platform.db.jobs import Job
from service.platform.db.recordings import Blob
from service.platform.db.session import Database
from service.platform.http.pages import Window, fetch
from service.platform.http.problems import conflict


class AnalysisDownload(NamedTuple):
    """The file that an analysis made, looked up in a session that has ended. A page is shown, not saved."""

    key: str
    size: int
    file_name: str
    is_page: bool

    def disposition(self, *, save: bool) -> str:
        """The header that names the file. A name may hold any letter."""
        return f"{'attachment' if save else 'inline'}; filename*=UTF-8''{quote(self.file_name, safe='')}"


def list_analyses(
    access: Access, fleet_id: UUID | None, of: dict[str, UUID | None], kinds: Sequence[str], window: Window
) -> AnalysisPage:
    """A page of the person's fleets' analyses, newest first: those whose columns are as in ``of``, of these kinds."""
    statement = select(Analysis).filter_by(**{name: id for name, id in of.items() if id is not None})
    if kinds:
        statement = statement.where(Analysis.kind.in_(kinds))
    scopes = access.scopes(Analysis, fleet_id)
    rows, following = fetch(access.session, statement, Analysis.id, window, newest_first=True, any_of=scopes)
    of_rows = select(Job).where(Job.id.in_([row.job_id for row in rows]))
    jobs = {job.id: job for job in access.session.scalars(of_rows)}
    return AnalysisPage(items=[view_of(row, jobs.get(row.job_id or 0)) for row in rows], next=following)


def job_of(session: Session, row: Analysis) -> Job | None:
    """The job that answers an analysis, if it is still kept."""
    return session.get(Job, row.job_id) if row.job_id else None


def shown_pairs(access: Access, row: Analysis) -> CorrespondenceSet | None:
    """The set of whose single pairs an ended analysis may tell the person. None if there is none."""
    if row.set_id is None or row.result is None:
        return None
    pairs = access.session.get_one(CorrespondenceSet, row.set_id)
    return pairs if may_see_pairs(access, pairs) else None


def analysis_file(access: Access, database: Database, analysis_id: UUID) -> AnalysisDownload:
    """The file that an analysis made. Raises :class:`Problem` 404, 403, and 409 ``no_file``."""
    row = access.find(Analysis, analysis_id)
    file = access.session.get(AnalysisFile, row.id)
    if file is None:
        raise conflict(
            "no_file",
            f"This analysis ({row.kind}) is {row.state}; it has no file.",
            "A calibrated copy or a report has a file when its state is done; other kinds have none.",
            state=row.state,
        )
    # A copy is the recording's own data; a report shows single pairs.
    is_page, pairs = row.kind == "report", shown_pairs(access, row)
    if pairs is None:
        access.need(row.fleet_id, "reviewer" if is_page else "engineer")
    size = access.session.get_one(Blob, file.blob_key).size
    download = AnalysisDownload(file.blob_key, size, file.file_name, is_page)
    if pairs is not None:
        disclose_pairs(access, database, pairs, "result")
    return download
