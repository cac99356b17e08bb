"""Kinds of analyses: the row that a request of each kind makes, and how it is shown."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final, NamedTuple, cast

from apexcal.documents.analyses import (
    AnalysisView,
    OffsetView,
    PreviewRequest,
    PreviewView,
    RecordingQuestion,
    SuggestionView,
)
from apexcal.documents.analysis_kinds import AnalysisRequest, AnyAnalysis
from apexcal.documents.copies import CopyView
from apexcal.documents.machine_marks import MarksView
from apexcal.documents.pixel_points import PixelPointsView
from apexcal.documents.reports import ReportView
from apexcal.documents.sweeps import PackingView
from apexcal.documents.validations import PairValidationView, RoadValidationView
from service.analyses import clock_offsets, copies, machine_marks, pixel_points, reports, validations
from service.detections.queries import ready_recording
from service.platform.auth.access import Access
from service.platform.db.analyses import Analysis
from service.platform.db.base import Json
from service.platform.db.jobs import Job
from service.platform.job_status.views import job_view


def _question(access: Access, request: RecordingQuestion) -> Analysis:
    """An analysis for which the worker needs no more than the recording. Raises :class:`Problem` 404, 403, 409."""
    recording = ready_recording(access, request.recording_id, "engineer")
    return Analysis(fleet_id=recording.fleet_id, vehicle_id=recording.vehicle_id, recording_id=recording.id, asked={})


def _preview(access: Access, request: PreviewRequest) -> Analysis:
    row = _question(access, request)
    row.asked = {"region": request.region}
    return row


def _shown(*names: str) -> Callable[[Analysis], Json]:
    """These members of what was asked."""
    return lambda row: {name: row.asked[name] for name in names if name in row.asked}


class _Kind(NamedTuple):
    """``plan`` checks a request and makes the row; ``view`` is its answer, with ``members`` of its own."""

    plan: Callable[[Access, Any], Analysis]
    view: type[AnalysisView]
    members: Callable[[Analysis], Json] = _shown()


_ROAD: Final = _Kind(validations.plan_on_recording, RoadValidationView, _shown("camera"))
_KINDS: Final[Mapping[str, _Kind]] = {
    "preview": _Kind(_preview, PreviewView, _shown("region")),
    "suggestion": _Kind(_question, SuggestionView),
    "packing": _Kind(_question, PackingView),
    "clock_offset": _Kind(clock_offsets.plan, OffsetView, clock_offsets.members),
    "calibrated_copy": _Kind(copies.plan, CopyView, _shown("results", "poses", "for_viewers")),
    "machine_marks": _Kind(machine_marks.plan, MarksView, machine_marks.members),
    "pixel_points": _Kind(pixel_points.plan, PixelPointsView, _shown("camera")),
    "report": _Kind(reports.plan, ReportView),
    "pair_validation": _Kind(validations.plan_on_pairs, PairValidationView, _shown("camera")),
    "lane_validation": _ROAD,
    "edge_validation": _ROAD,
}
_COMMON: Final = ("kind", *(name for name in AnalysisView.model_fields if name != "job"))


def plan_of(access: Access, request: AnalysisRequest) -> Analysis:
    """The row of a request, which is not written yet. Raises :class:`Problem` as the kind does."""
    row = _KINDS[request.kind].plan(access, request)
    row.kind = request.kind
    return row


def view_of(row: Analysis, job: Job | None, *, with_pairs: bool = False) -> AnyAnalysis:
    """An analysis with its job, and with what it says of single pairs."""
    kind = _KINDS[row.kind]
    members: Json = {name: getattr(row, name) for name in _COMMON} | {"result": row.result}
    if with_pairs and row.result is not None:
        members["result"] = row.result | (row.single_pairs or {})
    return cast("AnyAnalysis", kind.view(**members | kind.members(row), job=job and job_view(job)))
