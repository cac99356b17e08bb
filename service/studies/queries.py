"""Studies by their rows: one made and queued, one read, a page of those of a recording."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar
from urllib.parse import quote
from uuid import UUID

from fastapi import Response
from sqlalchemy import select

from apexcal.documents.roles import Role
from apexcal.documents.studies import StudyView
from service.platform.auth.access import Access
from service.platform.db.jobs import Job
from service.platform.db.recordings import Blob, Recording
from service.platform.db.studies import Study, StudyFile
from service.platform.http.pages import Page, Window, fetch
from service.platform.http.problems import Problem, not_found
from service.platform.jobs.queue import abandon
from service.platform.storage.blobs import condemn
from service.platform.storage.quota import counted
from service.studies.jobs import queue_study

View = TypeVar("View", bound=StudyView)


def list_studies(
    access: Access, recording_id: UUID, kind: str, window: Window, view: Callable[[Study, Job | None], View]
) -> Page[View]:
    """A page of a recording's studies of one kind, newest first."""
    recording = access.find(Recording, recording_id)
    statement = select(Study).where(Study.recording_id == recording.id, Study.kind == kind)
    rows, following = fetch(access.session, statement, Study.id, window, newest_first=True)
    jobs = {
        job.id: job for job in access.session.scalars(select(Job).where(Job.id.in_([row.job_id for row in rows])))
    }
    return Page(items=[view(row, jobs.get(row.job_id or 0)) for row in rows], next=following)


def new_study(
    access: Access, recording: Recording, kind: str, asked: dict[str, Any], detection_id: UUID | None = None
) -> tuple[Study, Job]:
    """A new study, and its job."""
    row = Study(
        fleet_id=recording.fleet_id,
        recording_id=recording.id,
        detection_id=detection_id,
        kind=kind,
        asked=asked,
    )
    access.session.add(row)
    access.session.flush()
    return row, queue_study(access.session, row)


def read_study(access: Access, study_id: UUID, kind: str) -> tuple[Study, Job | None]:
    """A study of this kind, and its job. Raises :class:`Problem` 404."""
    row = access.find(Study, study_id)
    if row.kind != kind:
        raise not_found()
    return row, access.session.get(Job, row.job_id) if row.job_id else None


def study_file(access: Access, study_id: UUID, kind: str, role: Role, what: str) -> tuple[StudyFile, int]:
    """The file that a study of this kind made, and its size.

    Raises :class:`Problem` 404, 403, and 409 ``WHAT_not_ready``, where ``what`` names the file for people.
    """
    row, _ = read_study(access, study_id, kind)
    access.need(row.fleet_id, role)
    made = access.session.get(StudyFile, row.id)
    if made is None:
        raise Problem(
            409,
            f"{what}_not_ready",
            f"This {what} is {row.state}; it has no file.",
            "Wait until its state is done.",
            state=row.state,
        )
    return made, access.session.get_one(Blob, made.blob_key).size


def disposition(made: StudyFile) -> str:
    """The header that names a file for who saves it."""
    return f"attachment; filename*=UTF-8''{quote(made.file_name, safe='')}"


def delete_study(access: Access, study_id: UUID, kind: str, role: Role) -> Response:
    """Delete a study with the file that it made, or end its making. Raises :class:`Problem` 404, 403."""
    row, _ = read_study(access, study_id, kind)
    access.need(row.fleet_id, role)
    session = access.session
    # Jobs first, as workers lock them before the rows that they work for.
    abandon(session, [row.id])
    recording = session.get(Recording, row.recording_id, with_for_update=True)
    made = session.get(StudyFile, row.id)
    if made is not None:
        condemn(session, [made.blob_key])
    session.delete(row)
    session.flush()
    if recording is not None:
        recording.taken_bytes = counted(session, recording, besides=row.job_id)
    return Response(status_code=204)
