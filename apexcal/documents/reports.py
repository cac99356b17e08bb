"""What answers about the reports of results look like."""

from __future__ import annotations

from datetime import datetime
from typing import Literal
from uuid import UUID

from apexcal.documents.base import Sent, Stored
from apexcal.documents.jobs import JobView, ProblemView
from apexcal.documents.states import WorkState

VerdictLevel = Literal["sound", "doubtful", "unsound"]


class ReportView(Sent):
    """A result's report: how far it is. ``made_at`` and ``bytes`` are of the newest one that was made.

    ``verdict``: ``unsound`` if something speaks against the result, ``doubtful`` if something needs a look, ``sound``
    otherwise.
    """

    id: UUID
    fleet_id: UUID
    result_id: UUID
    state: WorkState
    problem: Stored[ProblemView | None]
    job: JobView | None
    verdict: VerdictLevel | None
    bytes: int | None
    made_at: datetime | None
    created_at: datetime
