"""What requests and answers about the reports of results look like."""

from __future__ import annotations

from typing import Literal
from uuid import UUID

from apexcal.documents.analyses import AnalysisView, StoredFile
from apexcal.documents.base import Received, Stored
from apexcal.documents.checks import CheckVerdict


class ReportRequest(Received):
    """Ask for the report of a result, which must be a fit to all pairs."""

    kind: Literal["report"]
    result_id: UUID


class ReportFile(StoredFile):
    """The report. ``verdict`` is the gravest of the checks that it shows, for the mount with its lens."""

    verdict: CheckVerdict


class ReportView(AnalysisView):
    """A result's report; when it is done, its file can be read."""

    kind: Literal["report"]
    result: Stored[ReportFile | None]
