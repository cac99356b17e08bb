"""Studies as their answers show them."""

from __future__ import annotations

from typing import Any

from apexcal.documents.base import stored
from apexcal.documents.copies import CopyView
from apexcal.documents.studies import OffsetView, PreviewView, SuggestionView
from apexcal.documents.sweeps import PackingView
from service.platform.db.jobs import Job
from service.platform.db.studies import Study
from service.platform.job_status.views import job_view

# An offset within so many of its standard deviations is no reason to move anything.
_CERTAIN = 2.0


def preview_view(row: Study, job: Job | None) -> PreviewView:
    """A preview with its job."""
    return PreviewView(**_members(row, job), region=row.asked["region"])


def suggestion_view(row: Study, job: Job | None) -> SuggestionView:
    """A suggestion with its job."""
    return SuggestionView(**_members(row, job))


def offset_view(row: Study, job: Job | None) -> OffsetView:
    """A clock offset with its job, and what to do with it."""
    return OffsetView(
        **_members(row, job),
        detection_id=row.detection_id,  # pyright: ignore[reportArgumentType] - an offset always has one
        camera=row.asked["camera"],
        marks=len(row.asked["marks"]["u"]),
        hint=_how_to_use(row.result, row.asked["camera"]) if row.result else None,
    )


def packing_view(row: Study, job: Job | None) -> PackingView:
    """A packing with its job."""
    return PackingView(**_members(row, job))


def copy_view(row: Study, job: Job | None) -> CopyView:
    """A calibrated copy with its job."""
    return CopyView(
        **_members(row, job),
        results=row.asked["results"],
        poses=stored(row.asked["poses"]),
        for_viewers=row.asked.get("for_viewers", False),
    )


def _how_to_use(result: dict[str, Any], camera: str) -> str:
    offset, sigma = result["offset_ns"] / 1e6, result["sigma_ns"] / 1e6
    shows = (
        f"The camera's clock is {abs(offset):.1f} ms {'ahead of' if offset >= 0 else 'behind'} the LiDAR's, "
        f"with a standard deviation of {sigma:.1f} ms"
    )
    if abs(offset) < _CERTAIN * sigma:
        return f"{shows}: the clocks agree within the error, and pairing.offset_ns = 0 will do."
    return (
        f"{shows}. Detect again with pairing.offset_ns = {result['offset_ns']}; "
        'pairing.mode = "interpolate" then moves each vertex to the very time of its frame. Marks are kept. '
        f"The offset is that of {camera} and goes for every camera: where their clocks differ, make one detection "
        "for each of them."
    )


def _members(row: Study, job: Job | None) -> dict[str, Any]:
    return {
        "id": row.id,
        "recording_id": row.recording_id,
        "state": row.state,
        "result": row.result,
        "problem": row.problem,
        "job": job_view(job) if job else None,
        "created_at": row.created_at,
    }
