"""Reports of results."""

from __future__ import annotations

from apexcal.documents.reports import ReportRequest
from service.platform.auth.access import Access
from service.platform.db.analyses import Analysis
from service.platform.db.calibrations import FULL, Calibration, CalibrationRun, Result
from service.platform.http.problems import Problem
from service.publications.check_queries import moment_checks


def plan(access: Access, request: ReportRequest) -> Analysis:
    """A report of a fit to all pairs. Raises :class:`Problem` 404, 403, 409 ``not_a_fit_to_all_pairs``."""
    result = access.find(Result, request.result_id, "reviewer")
    if result.fold != FULL:
        raise Problem(
            409,
            "not_a_fit_to_all_pairs",
            "This result is from a fit that holds pairs out. Only fits to all pairs have reports.",
            "Ask for the report of the model's fit to all pairs: its fold is -1.",
        )
    # What only the database tells now; checks of the fit and its calibration are read when the report is made.
    now = moment_checks(access.session, result).checks
    return Analysis(
        fleet_id=result.fleet_id,
        vehicle_id=access.session.get_one(Calibration, result.calibration_id).vehicle_id,
        set_id=access.session.get_one(CalibrationRun, result.run_id).set_id,
        result_id=result.id,
        asked={"checks": [one.model_dump(mode="json") for one in now]},
    )
