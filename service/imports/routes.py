"""Calibrations of other programs: what their files hold, and how a result compares with them. Nothing is stored."""

from __future__ import annotations

from uuid import UUID

from fastapi import APIRouter

from apexcal.documents.imports import CalibrationFiles, ComparisonRequest, ReadFiles, StatedComparison
from service.auth.access import CurrentIdentity, ReadAccess
from service.calibration_runs.objection_queries import spread_of_result
from service.db.calibrations import Result

router = APIRouter(tags=["imports"])


@router.post("/calibration-files/reading")
def read_calibration_files(body: CalibrationFiles, identity: CurrentIdentity) -> ReadFiles:
    """Lenses and mounts in files of ROS, OpenCV, Kalibr or KITTI, with what is implausible of them."""
    # Imported here, as below: it needs NumPy and YAML, which take a twentieth of the start.
    from service.imports.views import files_view

    return files_view(body)


@router.post("/results/{result_id}/comparison")
def compare_with_stated(result_id: UUID, body: ComparisonRequest, access: ReadAccess) -> StatedComparison:
    """How far a result is from a mount or lens that is known otherwise, and whether that one is read the wrong way."""
    from service.imports.comparing import stated_comparison

    result = access.find(Result, result_id)
    return stated_comparison(body, result.document, spread_of_result(access.session, result))
