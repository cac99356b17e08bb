"""The route of a result."""

from __future__ import annotations

from typing import Any
from uuid import UUID

from fastapi import Request
from fastapi.responses import Response
from sqlalchemy import select

from apexcal.documents.base import Stored
from apexcal.documents.results import ResultView
from apexcal.documents.roles import rank
from service.annotations.disclosure_actions import tell_pairs
from service.auth.access import ReadAccess
from service.calibration_runs.objection_queries import comparison, objections
from service.calibrations.views import result_document
from service.db.calibrations import FULL, Calibration, CalibrationRun, CorrespondenceSet, Result
from service.exports.answers import WantedFormat, exported
from service.exports.queries import of_result
from service.http.etags import Conditional
from service.http.problems import not_found
from service.http.router import Router

router = Router(tags=["calibrations"])


@router.get("/results/{result_id}", response_model=Stored[ResultView])
def read_result(
    result_id: UUID, access: ReadAccess, request: Request, wanted: WantedFormat, conditions: Conditional
) -> dict[str, Any] | Response:
    """The solver's whole document: parameters, errors of every stage, deviations, alarms; and its ids.

    ``objections`` is what speaks against publishing it now, null of a fit that is not to all pairs. Of pairs made of
    marks only reviewers see what tells of single pairs; what they answer afterwards on the vertices of these counts
    as reviewed. ``format``: its lens and mount in another format.
    """
    result = access.find(Result, result_id)
    if wanted is not None:
        return exported(wanted, of_result(access.session, result.id), conditions)
    found = access.session.execute(
        select(CalibrationRun, Calibration, CorrespondenceSet)
        .join(Calibration, Calibration.id == CalibrationRun.calibration_id)
        .join(CorrespondenceSet, CorrespondenceSet.id == CalibrationRun.set_id)
        .where(CalibrationRun.id == result.run_id)
    ).one_or_none()
    if found is None:
        # Deleted at this moment.
        raise not_found()
    run, calibration, pairs = found
    with_pairs = pairs.source == "import" or rank(access.role(result.fleet_id) or "") >= rank("reviewer")
    against = objections(access.session, result) if result.fold == FULL else None
    document = result_document(result, run, calibration, pairs, against, with_pairs=with_pairs)
    document["compared"] = comparison(access.session, result, calibration.vehicle_id) if result.fold == FULL else None
    if with_pairs:
        tell_pairs(access, request.app.state.database, pairs, "result")
    return document
