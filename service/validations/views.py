"""Validations as their answers show them."""

from __future__ import annotations

from apexcal.documents.validations import SINGLE_PAIRS, ValidationView
from service.platform.db.jobs import Job
from service.platform.db.validations import Validation
from service.platform.job_status.views import job_view


def validation_view(row: Validation, job: Job | None, *, with_pairs: bool) -> ValidationView:
    """A validation with its job; with or without what it says of single pairs."""
    result = row.result
    if result is not None and row.kind == "pairs":
        result = result | ((row.single_pairs if with_pairs else None) or {name: [] for name in SINGLE_PAIRS})
    return ValidationView(
        id=row.id,
        vehicle_id=row.vehicle_id,
        kind=row.kind,  # pyright: ignore[reportArgumentType] - the routes write only kinds
        camera=row.camera,
        set_id=row.set_id,
        recording_id=row.recording_id,
        result_id=row.result_id,
        state=row.state,  # pyright: ignore[reportArgumentType] - a state as text
        result=result,  # pyright: ignore[reportArgumentType] - stored as it is
        problem=row.problem,  # pyright: ignore[reportArgumentType] - stored as it is
        job=job_view(job) if job else None,
        created_at=row.created_at,
    )
