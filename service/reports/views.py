"""Reports as the answers show them."""

from __future__ import annotations

from typing import Any

from apexcal.documents.reports import ReportView
from service.platform.db.jobs import Job
from service.platform.db.reports import Report
from service.platform.job_status.views import job_view

_SHOWN = ("id", "fleet_id", "result_id", "state", "problem", "verdict", "made_at", "created_at")


def report_view(row: Report, job: Job | None) -> ReportView:
    """A report with its job."""
    members: dict[str, Any] = {name: getattr(row, name) for name in _SHOWN}
    size = row.size if row.blob_key else None
    return ReportView(**members, bytes=size, job=job_view(job) if job else None)
