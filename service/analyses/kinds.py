"""Kinds of analyses: the row that a request of each kind makes, and how it is shown."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final, NamedTuple, cast
from uuid import UUID

from apexcal.documents.analyses import (
    AnalysisView,
    OffsetView,
    PreviewRequest,
    PreviewView,
    ReportRequest,
    ReportView,
    SuggestionRequest,
    SuggestionView,
)
from apexcal.documents.analysis_kinds import AnalysisRequest, AnyAnalysis
from apexcal.documents.copies import CopyRequest, CopyView
from apexcal.documents.machine_marks import MarksView
from apexcal.documents.marking_precision import PrecisionView
from apexcal.documents.pixel_points import PixelPointsView
from apexcal.documents.remedies import RemediesRequest, RemediesView
from apexcal.documents.roles import Role
from apexcal.documents.validations import PairValidationView, RoadValidationView
from service.analyses import clock_offsets, machine_marks, pixel_points, precision, validations
from service.analyses.jobs import analysis_of
from service.platform.auth.access import Access
from service.platform.db.analyses import Analysis
from service.platform.db.base import Json
from service.platform.db.calibrations import FULL, Calibration, CalibrationRun, Result
from service.platform.db.jobs import Job
from service.platform.http.problems import conflict
from service.platform.job_status.views import job_view
from service.publications.check_queries import moment_checks
from service.recordings.queries import ready_recording


def _question(access: Access, request: PreviewRequest | SuggestionRequest) -> Analysis:
    """An analysis for which the worker needs no more than the recording. Raises :class:`Problem` 404, 403, 409."""
    return analysis_of(ready_recording(access, request.recording_id, "engineer"), request.kind, {})


def _preview(access: Access, request: PreviewRequest) -> Analysis:
    row = _question(access, request)
    row.asked = {"region": request.region}
    return row


def _copy(access: Access, request: CopyRequest) -> Analysis:
    """Make the row of a copy. Raises :class:`Problem` as ``plan_copy`` and ``plan_viewer_file`` do."""
    # Imported here: it needs NumPy, which takes a twentieth of the start.
    from service.analyses.copy_plan import plan_copy
    from service.analyses.viewer_plan import plan_viewer_file

    recording = ready_recording(access, request.recording_id, "engineer")
    question = (plan_viewer_file if request.for_viewers else plan_copy)(access.session, recording, request)
    return analysis_of(recording, request.kind, question)


def _report(access: Access, request: ReportRequest) -> Analysis:
    """A report of a fit to all pairs. Raises :class:`Problem` as `_of_result` does."""
    row, result = _of_result(access, request.result_id, "reviewer")
    # Only what the database holds now; checks of the fit and its calibration are read when the report is made.
    now = moment_checks(access.session, result).checks
    row.asked = {"checks": [check.model_dump(mode="json") for check in now]}
    return row


def _remedies(access: Access, request: RemediesRequest) -> Analysis:
    """Trials of a result's remedies. Raises :class:`Problem` as `_of_result` does."""
    return _of_result(access, request.result_id, "engineer")[0]


def _of_result(access: Access, result_id: UUID, role: Role) -> tuple[Analysis, Result]:
    """The row of a question to a fit to all pairs. Raises :class:`Problem` 404, 403, 409."""
    result = access.find(Result, result_id, role)
    if result.fold != FULL:
        raise conflict(
            "not_a_fit_to_all_pairs",
            "This result is from a fit that holds pairs out. Only fits to all pairs have reports and remedies.",
            "Ask for that of the model's fit to all pairs: its fold is -1.",
        )
    row = Analysis(
        fleet_id=result.fleet_id,
        vehicle_id=access.session.get_one(Calibration, result.calibration_id).vehicle_id,
        set_id=access.session.get_one(CalibrationRun, result.run_id).set_id,
        result_id=result.id,
        asked={},
    )
    return row, result


def _shown(*names: str) -> Callable[[Analysis], Json]:
    """Return these members of the request."""
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
    "clock_offset": _Kind(clock_offsets.plan, OffsetView, clock_offsets.members),
    "calibrated_copy": _Kind(_copy, CopyView, _shown("results", "poses", "for_viewers")),
    "machine_marks": _Kind(machine_marks.plan, MarksView, machine_marks.members),
    "precision": _Kind(precision.plan, PrecisionView, _shown("camera")),
    "pixel_points": _Kind(pixel_points.plan, PixelPointsView, _shown("camera")),
    "report": _Kind(_report, ReportView),
    "remedies": _Kind(_remedies, RemediesView),
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
    """Return an analysis with its job, and with its figures of single pairs if ``with_pairs``."""
    kind = _KINDS[row.kind]
    members: Json = {name: getattr(row, name) for name in _COMMON} | {"result": row.result}
    if with_pairs and row.result is not None:
        members["result"] = row.result | (row.single_pairs or {})
    return cast("AnyAnalysis", kind.view(**members | kind.members(row), job=job and job_view(job)))
