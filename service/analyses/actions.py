"""Deletes analyses."""

from __future__ import annotations

from uuid import UUID

from service.analyses.jobs import tell_followers
from service.platform.auth.access import Access
from service.platform.db.analyses import Analysis, AnalysisFile
from service.platform.jobs.queue import abandon
from service.platform.storage.blobs import condemn
from service.platform.storage.quota import recounting


def delete_analysis(access: Access, analysis_id: UUID) -> None:
    """Delete an analysis with the file that it made, or end its making. Raises :class:`Problem` 404, 403."""
    row = access.find(Analysis, analysis_id)
    access.need(row.fleet_id, "reviewer" if row.kind == "report" else "engineer")
    session = access.session
    # Jobs first, as workers lock them before the rows that they work for.
    abandon(session, [row.id])
    with recounting(session, row.recording_id, besides=row.job_id):
        file = session.get(AnalysisFile, row.id)
        if file is not None:
            condemn(session, [file.blob_key])
        session.delete(row)
    tell_followers(session, row)
