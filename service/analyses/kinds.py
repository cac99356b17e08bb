"""Kinds of analyses: what a request of each kind is planned into, and how its row is shown."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final, NamedTuple

from apexcal.documents.analyses import PreviewView, SuggestionView
from apexcal.documents.analysis_kinds import AnalysisKind, AnalysisRequest, AnyAnalysis
from apexcal.documents.sweeps import PackingView
from service.analyses import clock_offsets, copies, machine_marks
from service.analyses.plan import Plan
from service.platform.auth.access import Access
from service.platform.db.analyses import Analysis
from service.platform.db.base import Json
from service.platform.db.jobs import Job
from service.platform.db.recordings import Recording
from service.platform.job_status.views import job_view


class _Kind(NamedTuple):
    """``plan`` checks a request and makes plain data for the worker; ``view`` gets the row and the common members."""

    plan: Callable[[Access, Recording, Any], Plan]
    view: Callable[[Analysis, Json], AnyAnalysis]


_KINDS: Final[Mapping[AnalysisKind, _Kind]] = {
    "preview": _Kind(
        lambda access, recording, request: Plan({"region": request.region}),
        lambda row, members: PreviewView(**members, region=row.asked["region"]),
    ),
    "suggestion": _Kind(
        lambda access, recording, request: Plan({}),
        lambda row, members: SuggestionView(**members),
    ),
    "packing": _Kind(
        lambda access, recording, request: Plan({}),
        lambda row, members: PackingView(**members),
    ),
    "clock_offset": _Kind(clock_offsets.plan, clock_offsets.view),
    "calibrated_copy": _Kind(copies.plan, copies.view),
    "machine_marks": _Kind(machine_marks.plan, machine_marks.view),
}


def plan_of(access: Access, recording: Recording, request: AnalysisRequest) -> Plan:
    """What the worker is given of a request. Raises :class:`Problem` as the kind does."""
    return _KINDS[request.kind].plan(access, recording, request)


def view_of(row: Analysis, job: Job | None) -> AnyAnalysis:
    """An analysis with its job."""
    names = ("id", "recording_id", "kind", "state", "result", "problem", "created_at")
    members: Json = {name: getattr(row, name) for name in names}
    kind: AnalysisKind = row.kind  # pyright: ignore[reportAssignmentType] - only kinds are written
    return _KINDS[kind].view(row, members | {"job": job_view(job) if job else None})
