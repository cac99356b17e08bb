"""What answers about the reports of results look like."""

from __future__ import annotations

from datetime import datetime
from uuid import UUID

from apexcal.documents.base import Sent, Stored
from apexcal.documents.checks import CheckVerdict
from apexcal.documents.jobs import JobView, ProblemView
from apexcal.documents.states import WorkState


class ReportView(Sent):
    """A result's report: how far it is. ``made_at`` and ``bytes`` are of the newest one that was made.

    ``verdict`` is the gravest of the checks that it shows, for the mount with its lens.
    """

    id: UUID
    fleet_id: UUID
    result_id: UUID
    state: WorkState
    problem: Stored[ProblemView | None]
    job: JobView | None
    verdict: CheckVerdict | None
    bytes: int | None
    made_at: datetime | None
    created_at: datetime
